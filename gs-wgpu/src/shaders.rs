//! The shaders: one file per stage, after a prelude of gs-core's constants and the files that it
//! imports.
//!
//! `#import FILE: names` says which names come from another file; the prelude's are in this file.
//! `#if NAME`, `#else` and `#endif` select the lines of a variant. Numbers that only one entry point
//! needs are WGSL overrides.

use std::fmt::Write;

use serde::{Deserialize, Serialize};

use gs_core::constants::{
    MAX_DERIVATIVE, MAX_ETA, MAX_RESIDUAL, MAX_XI, MIN_DETERMINANT_PX4, MIN_QUATERNION_NORM2, NOISE_OPACITY,
    NOISE_STEEPNESS, QUATERNION_SHRINK, SAFE_SQUARES, SH_C0, SH_C1, SH_C2, SH_C3, SSIM_C1, SSIM_C2, SSIM_MAX,
    SSIM_SIGMA, SSIM_WINDOW, VANISHING_MOMENT,
};

use crate::{
    collect::Collected,
    layout::{BY_COEFFICIENT, BY_GAUSSIAN, BY_HISTOGRAM, BY_SORT_BLOCK},
    target::EXCLUDED,
};

/// Columns of a tile.
pub(crate) const TILE_COLUMNS: u32 = 16;

/// Rows of a tile.
pub(crate) const TILE_ROWS: u32 = 16;

/// Rows per invocation of the blend kernels, as one vector.
pub(crate) const ROWS: u32 = 4;

/// Pixels per invocation of D-SSIM's kernels.
pub(crate) const SSIM_SEGMENT: u32 = 16;

/// Pixels per loop iteration of D-SSIM's kernels.
const SSIM_BLOCK: u32 = 4;

/// Entries per work group of `sort`.
pub(crate) const SORT_BLOCK: u32 = 1024;

/// Bits of a digit of the sort.
pub(crate) const SORT_BITS: u32 = 4;

/// The pass of a kernel that runs in both passes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub(crate) enum Pass {
    /// Draws the image.
    #[default]
    Forward,
    /// Computes the gradients of the entries from that of the image.
    Backward,
}

/// The variant of a pipeline.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub(crate) struct Variant {
    /// Blending is `Over`, not `Sum`.
    pub(crate) over: bool,
    /// The parameterization is `CovarianceFactor`.
    pub(crate) covariance_factor: bool,
    /// The scene is 3D, for `edit`.
    pub(crate) scene_3d: bool,
    /// Pixels have weights, for `loss`.
    pub(crate) weighted: bool,
    /// `project_bwd` also differentiates by the camera.
    pub(crate) camera: bool,
    /// Adam's moments of SH coefficients are in `MomentFormat::Bf16`; for `complete`, the target is in 8 bits.
    pub(crate) packed: bool,
    /// `project` counts tiles for new lists.
    pub(crate) lists: bool,
    /// Gaussians are sorted at each pixel.
    pub(crate) by_pixel: bool,
    /// The adapter computes on a CPU.
    pub(crate) on_cpu: bool,
    /// The kind of kernels.
    pub(crate) kernels: Kernels,
    /// The pass of `blend_by_depth`.
    pub(crate) pass: Pass,
    /// The further sums of the backward kernels.
    pub(crate) collected: Collected,
    /// The entry point's override, if it has one.
    pub(crate) constant: Option<(&'static str, u32)>,
}

/// Gaussians that a pixel of `blend_by_depth` holds in the order of its depths.
///
/// More need more registers, and more time per insertion. Fewer need more walks along the queue.
const HELD: u32 = 8;

/// Invocations per work group of D-SSIM's kernels.
pub(crate) const DSSIM_GROUP: u32 = 64;

/// Radius of SSIM's window, px.
const SSIM_RADIUS: u32 = SSIM_WINDOW as u32 / 2;

/// The kind of kernels that visit every pixel. Results differ by rounding only, and are
/// deterministic.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Kernels {
    /// Kernels for every adapter that WebGPU allows.
    #[default]
    Portable,
    /// Kernels in which subgroups compute sums over pixels.
    Subgroups,
}

/// A shader: the stage's file after those that it imports.
#[derive(Debug)]
pub(crate) struct Shader {
    pub(crate) name: &'static str,
    pub(crate) entry_points: &'static [&'static str],
}

macro_rules! shaders {
    ($($shared:literal),* $(,)?; $($name:literal: [$($entry:literal),* $(,)?]),* $(,)?) => {
        /// Every shader.
        pub(crate) const SHADERS: &[Shader] = &[$(Shader { name: $name, entry_points: &[$($entry),*] }),*];

        /// Every file, without what is in `show.rs`.
        const FILES: &[(&str, &str)] = &[
            $(($shared, include_str!(concat!("../shaders/", $shared, ".wgsl"))),)*
            $(($name, include_str!(concat!("../shaders/", $name, ".wgsl"))),)*
        ];
    };
}

shaders! {
    "shared", "at_pixel", "counted", "least_depth", "moments", "noise", "queued", "random", "received",
    "scene3d/camera_sum", "scene3d/shared", "sources";
    "scene2d/project": ["project"],
    "scene3d/project": ["project_3d"],
    "scene3d/place": ["place"],
    "scan": ["scan_blocks", "scan_sums", "scan_spread"],
    "sizes": ["sizes", "stop_unfinished"],
    "bin": ["bin"],
    "sort": ["sort_count", "sort_scatter"],
    "ranges": ["ranges"],
    "blend": ["blend"],
    "queue": ["queue_up"],
    "units": ["units"],
    "blend_by_depth": ["blend_by_depth"],
    "loss": ["loss", "loss_sum"],
    "dssim": ["dssim_moments", "dssim_derivatives", "dssim_gradient"],
    "blend_bwd": ["blend_bwd"],
    "scene2d/project_bwd": ["project_bwd"],
    "scene3d/project_bwd": ["project_bwd_3d"],
    "scene3d/camera_gradient": ["camera_gradient_3d"],
    "scene2d/adam": ["adam"],
    "scene3d/adam": ["adam_3d"],
    "scene3d/adam_color": ["adam_color_3d"],
    "scene2d/noise": ["add_noise"],
    "scene3d/noise": ["add_noise_3d"],
    "complete": ["complete"],
    "edit": ["edit"],
    "scene3d/edit_color": ["edit_color"],
    "scene2d/solve_colors": [
        "solve_start", "solve_product", "solve_step", "solve_direction", "solve_end", "solve_scalars",
    ],
}

/// The name under which files import the constants of [`prelude`].
const PRELUDE: &str = "prelude";

/// The text of a file.
fn source_of(name: &str) -> &'static str {
    FILES.iter().find(|(file, _)| *file == name).unwrap_or_else(|| panic!("no shader file {name}")).1
}

/// The files and names that a text imports.
fn imports(source: &str) -> impl Iterator<Item = (&str, impl Iterator<Item = &str>)> {
    let lines = source.lines().filter_map(|line| line.strip_prefix("#import ")?.split_once(": "));
    lines.map(|(file, names)| (file, names.split(", ")))
}

/// Adds a file after those that it imports, each once.
fn add_file(name: &'static str, files: &mut Vec<&'static str>) {
    if !files.contains(&name) {
        for (file, _) in imports(source_of(name)).filter(|(file, _)| *file != PRELUDE) {
            add_file(file, files);
        }
        files.push(name);
    }
}

/// The shader with an entry point of this name.
pub(crate) fn shader_of(entry_point: &str) -> &'static Shader {
    SHADERS.iter().find(|s| s.entry_points.contains(&entry_point)).expect("every entry point is listed")
}

/// Numbers per entry that `blend_bwd` writes.
pub(crate) fn stride(variant: Variant) -> u32 {
    gradients(variant) + variant.collected.numbers()
}

/// Numbers per entry that are gradients.
fn gradients(variant: Variant) -> u32 {
    if variant.over { 9 } else { 8 }
}

impl Shader {
    /// The stage's file after those that it imports.
    pub(crate) fn sources(&self) -> impl Iterator<Item = &'static str> {
        let mut files = vec!["shared"];
        add_file(self.name, &mut files);
        files.into_iter().map(source_of)
    }

    /// The complete text of a variant.
    pub(crate) fn text(&self, variant: Variant) -> String {
        let sources = self.sources().map(|source| preprocess(source, variant));
        std::iter::once(prelude(variant)).chain(sources).collect()
    }
}

/// The constants, printed so that they parse to the same bits.
fn prelude(variant: Variant) -> String {
    // The partial sums of a batch of entries fit into 16 KiB.
    let (gradients, stride) = (gradients(variant), stride(variant));
    let invocations = TILE_COLUMNS * (TILE_ROWS / ROWS);
    let parts = if variant.kernels == Kernels::Subgroups { invocations / 4 } else { invocations };
    let batch = (16 * 1024 / 4 / (stride * parts)).min(8);
    let mut text = format!(
        "const TILE_COLUMNS: u32 = {TILE_COLUMNS}u;\nconst TILE_ROWS: u32 = {TILE_ROWS}u;\nconst ROWS: u32 = {ROWS}u;\n\
         const HELD: u32 = {HELD}u;\nconst EXCLUDED: u32 = {EXCLUDED}u;\nconst STRIDE: u32 = {stride}u;\nconst GRADIENTS: u32 = {gradients}u;\nconst BATCH: u32 = {batch}u;\n\
         const SORT_BLOCK: u32 = {SORT_BLOCK}u;\n\
         const SSIM_SEGMENT: u32 = {SSIM_SEGMENT}u;\nconst SSIM_BLOCK: u32 = {SSIM_BLOCK}u;\nconst DSSIM_GROUP: u32 = {DSSIM_GROUP}u;\nconst SSIM_RADIUS: u32 = {SSIM_RADIUS}u;\n\
         const SSIM_C1: f32 = {SSIM_C1:?};\nconst SSIM_C2: f32 = {SSIM_C2:?};\n\
         const NOISE_STEEPNESS: f32 = {NOISE_STEEPNESS:?};\nconst NOISE_OPACITY: f32 = {NOISE_OPACITY:?};\n",
    );
    let list = |numbers: &[f32]| numbers.iter().map(|c| format!("{c:?}")).collect::<Vec<_>>().join(", ");
    write!(
        text,
        "const SH_C0: f32 = {SH_C0:?};\nconst SH_C1: f32 = {SH_C1:?};\nconst SH_C2 = array<f32, 5>({});\nconst SH_C3 = array<f32, 7>({});\n",
        list(&SH_C2),
        list(&SH_C3),
    )
    .expect("a string takes everything");
    let words = size_of::<u32>() as u64;
    for (name, bytes) in [
        ("BY_GAUSSIAN", BY_GAUSSIAN),
        ("BY_SORT_BLOCK", BY_SORT_BLOCK),
        ("BY_HISTOGRAM", BY_HISTOGRAM),
        ("BY_COEFFICIENT", BY_COEFFICIENT),
    ] {
        writeln!(text, "const {name}: u32 = {}u;", bytes / words).expect("a string takes everything");
    }
    writeln!(text, "const WINDOW = array<f32, {SSIM_WINDOW}>({});", list(&ssim_window()))
        .expect("a string takes everything");
    guards(&mut text);
    text
}

/// The thresholds of the shaders' guards.
fn guards(text: &mut String) {
    let [safe_least, safe_most] = SAFE_SQUARES;
    for (name, value) in [
        ("MIN_DETERMINANT_PX4", MIN_DETERMINANT_PX4),
        ("MIN_QUATERNION_NORM2", MIN_QUATERNION_NORM2),
        ("QUATERNION_SHRINK", QUATERNION_SHRINK),
        ("SAFE_SQUARE_LEAST", safe_least),
        ("SAFE_SQUARE_MOST", safe_most),
        ("MAX_EXPONENT_2", 126.0),
        ("MAX_EXPONENT_E", 87.0),
        ("MAX_RESIDUAL", MAX_RESIDUAL),
        ("SSIM_MAX", SSIM_MAX),
        ("MAX_DERIVATIVE", MAX_DERIVATIVE),
        ("MAX_XI", MAX_XI),
        ("MAX_ETA", MAX_ETA),
        ("VANISHING_MOMENT", VANISHING_MOMENT),
    ] {
        writeln!(text, "const {name}: f32 = {value:?};").expect("a string takes everything");
    }
}

/// SSIM's Gaussian window, `[SSIM_WINDOW]`, sum 1.
fn ssim_window() -> [f32; SSIM_WINDOW] {
    let raw: [f64; SSIM_WINDOW] = std::array::from_fn(|i| {
        let d = i as f64 - (SSIM_WINDOW / 2) as f64;
        (-d * d / (2.0 * f64::from(SSIM_SIGMA).powi(2))).exp()
    });
    let sum: f64 = raw.iter().sum();
    raw.map(|v| (v / sum) as f32)
}

/// Keeps the lines whose conditions hold (`#if NAME`, `#else`, `#endif`), and repeats the lines
/// between `#each x NAME` and `#end` with `@x` replaced by 0, 1, …, NAME − 1.
fn preprocess(source: &str, variant: Variant) -> String {
    let holds = |name: &str| match name {
        "OVER" => variant.over,
        "COVARIANCE_FACTOR" => variant.covariance_factor,
        "LISTS" => variant.lists,
        "SCENE_3D" => variant.scene_3d,
        "WEIGHTED" => variant.weighted,
        "PACKED" => variant.packed,
        "CAMERA" => variant.camera,
        "PER_PIXEL" => variant.by_pixel,
        "ON_CPU" => variant.on_cpu,
        "BACKWARD" => variant.pass == Pass::Backward,
        "ABSOLUTE" => variant.collected == Collected::AbsoluteGradients,
        "COUNT" => variant.collected == Collected::PixelCounts,
        "ERROR" => variant.collected == Collected::PixelErrors,
        "COLLECTS" => variant.collected != Collected::Nothing,
        "OVER_OR_ERROR" => variant.over || variant.collected == Collected::PixelErrors,
        "SUBGROUPS" => variant.kernels == Kernels::Subgroups,
        other => panic!("#if {other}: no such condition"),
    };
    let mut conditions: Vec<bool> = Vec::new();
    let mut text = String::with_capacity(source.len());
    for line in source.lines() {
        let trimmed = line.trim();
        if let Some(name) = trimmed.strip_prefix("#if ") {
            conditions.push(holds(name));
        } else if trimmed == "#else" {
            let last = conditions.last_mut().expect("#else is within #if");
            *last = !*last;
        } else if trimmed == "#endif" {
            conditions.pop().expect("#endif ends an #if");
        } else if conditions.iter().all(|&c| c) && !trimmed.starts_with("#import ") {
            text.push_str(line);
        }
        text.push('\n');
    }
    assert!(conditions.is_empty(), "an #if without #endif");
    repeat(&text)
}

/// Expands `#each`, which may be nested.
fn repeat(source: &str) -> String {
    let mut text = String::with_capacity(source.len());
    let mut lines = source.lines();
    while let Some(line) = lines.next() {
        let Some(head) = line.trim().strip_prefix("#each ") else {
            text.push_str(line);
            text.push('\n');
            continue;
        };
        let (name, count) = head.split_once(' ').expect("#each has a name and a number");
        let indices: Vec<u32> = match count {
            "EIGHT" => (0..8).collect(),
            "HELD" => (0..HELD).collect(),
            "HELD_LESS_ONE" => (0..HELD - 1).collect(),
            "SSIM_BLOCK" => (0..SSIM_BLOCK).collect(),
            "SSIM_RADIUS" => (0..SSIM_RADIUS).collect(),
            "SSIM_SPAN" => (0..2 * SSIM_RADIUS).collect(),
            other => panic!("#each {name} {other}: no such number"),
        };
        let mut body = String::new();
        let mut depth = 1;
        for line in lines.by_ref() {
            match line.trim() {
                "#end" => depth -= 1,
                inner if inner.starts_with("#each ") => depth += 1,
                _ => {}
            }
            if depth == 0 {
                break;
            }
            body.push_str(line);
            body.push('\n');
        }
        assert_eq!(depth, 0, "#each {name} without #end");
        for index in indices {
            text += &repeat(&body.replace(&format!("@{name}"), &index.to_string()));
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every identifier of a text without its comments and imports.
    fn words(text: &str) -> impl Iterator<Item = &str> {
        let code = text.lines().filter(|line| !line.starts_with('#'));
        let code = code.map(|line| line.split("//").next().unwrap_or_default());
        code.flat_map(|line| line.split(|c: char| !c.is_alphanumeric() && c != '_'))
    }

    /// The names that a text declares outside functions and structs.
    fn declared(text: &str) -> impl Iterator<Item = &str> {
        let lines = text.lines().filter_map(|line| {
            let kinds = ["fn ", "struct ", "const ", "override "];
            let of_kind = kinds.iter().find_map(|kind| line.strip_prefix(kind));
            of_kind.or_else(|| {
                Some(line)
                    .filter(|line| line.starts_with(['@', 'v']))
                    .and_then(|line| line.split_once("> "))
                    .map(|(_, name)| name)
            })
        });
        lines.filter_map(|line| line.split(|c: char| !c.is_alphanumeric() && c != '_').next())
    }

    #[test]
    fn files_import_the_names_that_they_use() {
        let prelude = prelude(Variant::default());
        for (name, text) in FILES {
            let imported: Vec<(&str, &str)> =
                imports(text).flat_map(|(file, names)| names.map(move |name| (file, name))).collect();
            for (file, import) in &imported {
                let source = if *file == PRELUDE { &prelude } else { source_of(file) };
                assert!(declared(source).any(|declared| declared == *import), "{name}: {file} has no {import}");
                assert!(words(text).any(|word| word == *import), "{name} does not use {import}");
            }
            // Names in lower case may be those of variables.
            let known = FILES.iter().flat_map(|(_, source)| declared(source)).chain(declared(&prelude));
            for used in known.filter(|known| known.starts_with(char::is_uppercase) && words(text).any(|w| w == *known))
            {
                let is_named =
                    declared(text).chain(imported.iter().map(|(_, import)| *import)).any(|name| name == used);
                assert!(is_named, "{name} does not import {used}");
            }
        }
    }
}
