//! The wheels: the one for this machine in a fresh environment, and what the others hold.

use std::process::Command;

use super::bench::{Bench, Outcome, expect};
use xtask::{
    dist::systems::SYSTEMS,
    python,
    system::{entries, output, step},
};

/// What a user of the module does first.
const SCRIPT: &str = "
import gaussian_splats as gs, numpy as np
x = np.linspace(0, 1, 96, dtype=np.float32)
image = np.stack(np.broadcast_arrays(x[:, None], x[None, :], 0.5 + 0 * x[:, None] * x), axis=-1)
fit = gs.fit(image, 200)
assert fit.psnr > 30, fit.psnr
print('PSNR', fit.psnr)
";

pub(super) fn test(bench: &Bench<'_>) -> Result<Outcome, String> {
    let folder = bench.folder("wheels")?;
    let mut wheels = entries(bench.release)?;
    wheels.retain(|path| path.extension().is_some_and(|ending| ending == "whl"));
    expect(wheels.len() == SYSTEMS.len(), || format!("{} wheels", wheels.len()))?;
    for wheel in &wheels {
        let listed = output(bench.tools.command("python").args(["-m", "zipfile", "-l"]).arg(wheel))?;
        let windows = wheel.to_string_lossy().contains("win_amd64");
        let module = if windows { "_native.pyd" } else { "_native.abi3.so" };
        for part in [module, "_native.pyi", "py.typed", "licenses/", "sboms/"] {
            expect(listed.contains(part), || format!("{} has no {part}: {listed}", wheel.display()))?;
        }
    }
    let tag = if cfg!(windows) { "win_amd64".to_owned() } else { format!("_{}", std::env::consts::ARCH) };
    let Some(wheel) = wheels.iter().find(|wheel| wheel.to_string_lossy().contains(&format!("{tag}.whl"))) else {
        return Ok(Outcome::Skipped("no wheel is for this machine; what each holds is right".to_owned()));
    };
    step(python::environment(bench.tools.programs().join("python"), &folder)?.arg(wheel))?;
    let seen = output(
        Command::new(python::programs(&folder).join("python")).args(["-X", "dev", "-c", SCRIPT]).current_dir(&folder),
    )?;
    Ok(Outcome::Passed(format!(
        "a fit in a fresh environment, {}; the other wheels are complete, but not run",
        seen.trim()
    )))
}
