//! What effects cost: the time of a picture with each on and off, beside a scene that never had it; and of the same Gaussians in 2D and as a
//! 3D scene, seen through a camera.
//!
//! `cargo bench -p gs-cpu --bench effects`; `cargo xtask effects` compares kernels in which an effect was never written. The measurements of a table take turns; a row is the median, with the median of its difference from
//! the first row, and what two measurements of the first row differ by is the noise. Everything is drawn from a fixed seed.

#![allow(clippy::print_stdout)]

mod garden;
mod plane;
mod turns;

use garden::{SEED, garden};
use gs_core::{
    Blend, Effects, Error, Rasterizer, RenderSettings, Scene3d,
    effects::{Antialias, Background, Order},
    profile::Quantiles,
};
use gs_cpu::{CpuRasterizer, CpuSettings};
use plane::{fitted, in_the_plane};
use turns::{ROUNDS, Row, milliseconds, picture, table};

/// All off that a picture can do without.
fn all_off() -> Effects {
    Effects { blend: Blend::Over, order: Order::Index, ..Effects::default() }
}

fn in_space(cpu: &impl Rasterizer<Scene3d>) -> Result<(), Error> {
    let (scene, camera) = garden(250_000, (1920, 1080));
    let mut plain = scene.clone();
    plain.sh = scene.sh.chunks_exact(scene.sh_len()).map(|of_one| of_one[0]).collect();
    plain.sh_degree = 0;
    let none = all_off();
    let with = |effects: Effects| RenderSettings { effects, ..RenderSettings::default() };
    let row = |name: &str, scene: &Scene3d, effects: Effects| picture(name, cpu, scene, &camera, with(effects));
    let mut white = RenderSettings { effects: none, ..RenderSettings::default() }.on([1.0; 3]);
    white.effects.background = Background::Solid;
    let rows = [
        row("all off", &scene, none)?,
        row("a scene that never had harmonics", &plain, none)?,
        row("sh-degree 1", &scene, Effects { sh_degree: 1, ..none })?,
        row("sh-degree 2", &scene, Effects { sh_degree: 2, ..none })?,
        row("sh-degree 3", &scene, Effects { sh_degree: 3, ..none })?,
        row("order global", &scene, Effects { order: Order::Global, ..none })?,
        row("order per-pixel", &scene, Effects { order: Order::PerPixel, ..none })?,
        row("antialias dilate", &scene, Effects { antialias: Antialias::Dilate, ..none })?,
        row("antialias mip", &scene, Effects { antialias: Antialias::Mip, ..none })?,
        picture("background solid", cpu, &scene, &camera, white)?,
    ];
    table("250,000 Gaussians in 3D, 1920x1080 px, over", &rows)
}

/// The time of a picture with all effects off, ms, on a line for each scene: what `cargo xtask effects` compares with kernels in which an effect
/// was never written.
fn off(cpu: &CpuRasterizer) -> Result<(), Error> {
    let median = |row: Row<'_>| {
        let times = (0..=2 * ROUNDS).map(|_| milliseconds(&row)).collect::<Result<Vec<f64>, Error>>()?;
        println!("{}", Quantiles::of(&times).median);
        Ok::<_, Error>(())
    };
    let (scene, camera) = garden(250_000, (1920, 1080));
    let none = RenderSettings { effects: all_off(), ..RenderSettings::default() };
    median(picture("", cpu.for_3d(), &scene, &camera, none)?)?;
    let (scene, canvas) = fitted(70_000);
    median(picture("", cpu.for_2d(), &scene, &canvas, none)?)
}

fn main() -> Result<(), Error> {
    let cpu = CpuRasterizer::new(CpuSettings::default())?;
    if std::env::args().any(|argument| argument == "off") {
        return off(&cpu);
    }
    println!("{}, seed {SEED}", cpu.for_3d().describe());
    in_space(cpu.for_3d())?;
    [1_000, 9_000, 70_000].into_iter().try_for_each(|count| in_the_plane(cpu.for_2d(), cpu.for_3d(), count))
}
