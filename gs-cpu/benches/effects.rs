//! What effects cost: the time of a picture with each on and off, beside a scene that never had it; and of the same Gaussians in the plane and as a
//! scene in space, seen through a camera.
//!
//! `cargo bench -p gs-cpu --bench effects`; `cargo xtask effects` compares kernels in which an effect was never written. The measurements of a table take turns; a row is the median, with the median of its difference from
//! the first row, and what two measurements of the first row differ by is the noise. Everything is drawn from a fixed seed.

#![allow(clippy::print_stdout)]

mod garden;

use std::time::Instant;

use garden::{Random, SEED, garden};
use glam::{Vec2, Vec3};
use gs_core::{
    Blend, Camera, Canvas, Chart, Effects, Error, PlanarGaussian, PlanarScene, Rasterizer, RenderSettings, Scene,
    SpatialGaussian, SpatialScene,
    constants::SH_C0,
    effects::{Antialias, Background, Order},
    profile::Quantiles,
    scene::logit,
};
use gs_cpu::{CpuRasterizer, CpuSettings};

/// Measurements of a row.
const ROUNDS: usize = 15;

/// A row: its name, and what is measured.
type Row<'a> = (String, Box<dyn Fn() -> Result<(), Error> + 'a>);

/// All off that a picture can do without.
fn all_off() -> Effects {
    Effects { blend: Blend::Over, order: Order::Index, ..Effects::default() }
}

/// The time of a row, ms, after one that is not measured.
fn milliseconds((_, run): &Row<'_>) -> Result<f64, Error> {
    run()?;
    let started = Instant::now();
    run().map(|()| started.elapsed().as_secs_f64() * 1e3)
}

/// Measures rows in turns and prints them. Each runs once before it is measured, so that none finds its data in the cache, or not there, for
/// the sake of the row before it; the first is measured again after the last.
fn table(title: &str, rows: &[Row<'_>]) -> Result<(), Error> {
    let mut times = vec![Vec::new(); rows.len()];
    let mut again = Vec::new();
    for _ in 0..ROUNDS {
        for (row, times) in rows.iter().zip(&mut times) {
            times.push(milliseconds(row)?);
        }
        again.push(milliseconds(&rows[0])?);
    }
    let apart =
        |other: &[f64]| -> Vec<f64> { other.iter().zip(&times[0]).map(|(other, first)| other - first).collect() };
    let noise: Vec<f64> = apart(&again).into_iter().map(f64::abs).collect();
    println!(
        "\n## {title}\n\nnoise {:.2} ms\n\n| | ms | more than the first, ms | times the first |\n|---|---|---|---|",
        Quantiles::of(&noise).median
    );
    for ((name, _), of_row) in rows.iter().zip(&times) {
        let (time, more) = (Quantiles::of(of_row).median, Quantiles::of(&apart(of_row)).median);
        let ratios: Vec<f64> = of_row.iter().zip(&times[0]).map(|(time, first)| time / first).collect();
        println!("| {name} | {time:.2} | {more:+.2} | {:.2} |", Quantiles::of(&ratios).median);
    }
    Ok(())
}

/// A picture of a scene, again and again.
fn picture<'a, S: Scene, R: Rasterizer<S>>(
    name: &str,
    on: &'a R,
    scene: &S,
    view: &'a S::View,
    settings: RenderSettings,
) -> Result<Row<'a>, Error>
where
    R::Cloud: 'a,
{
    let cloud = on.upload(scene, Chart::ScaleRotation)?;
    Ok((name.to_owned(), Box::new(move || on.forward(&cloud, view, &settings).map(drop))))
}

fn in_space(cpu: &impl Rasterizer<SpatialScene>) -> Result<(), Error> {
    let (scene, camera) = garden(250_000, (1920, 1080));
    let mut plain = scene.clone();
    plain.sh = scene.sh.chunks_exact(scene.sh_len()).map(|of_one| of_one[0]).collect();
    plain.sh_degree = 0;
    let none = all_off();
    let with = |effects: Effects| RenderSettings { effects, ..RenderSettings::default() };
    let row = |name: &str, scene: &SpatialScene, effects: Effects| picture(name, cpu, scene, &camera, with(effects));
    let mut white = RenderSettings { effects: none, ..RenderSettings::default() }.on([1.0; 3]);
    white.effects.background = Background::Solid;
    let rows = [
        row("all off", &scene, none)?,
        row("a scene that never had harmonics", &plain, none)?,
        row("sh-degree 1", &scene, Effects { sh_degree: 1, ..none })?,
        row("sh-degree 2", &scene, Effects { sh_degree: 2, ..none })?,
        row("sh-degree 3", &scene, Effects { sh_degree: 3, ..none })?,
        row("order tile-depth", &scene, Effects { order: Order::TileDepth, ..none })?,
        row("order pixel-depth", &scene, Effects { order: Order::PixelDepth, ..none })?,
        row("antialias dilate", &scene, Effects { antialias: Antialias::Dilate, ..none })?,
        row("antialias mip", &scene, Effects { antialias: Antialias::Mip, ..none })?,
        picture("background solid", cpu, &scene, &camera, white)?,
    ];
    table("250,000 Gaussians in space, 1920x1080 px, over", &rows)
}

/// As fitted to a photograph of 768x512 px: the more Gaussians, the smaller.
fn planar(count: u32) -> (PlanarScene, Canvas) {
    let mut random = Random(SEED);
    let (width, height) = (768, 512);
    let smaller = 0.5 * (count as f32 / 9_000.0).ln();
    let gaussian = |random: &mut Random| PlanarGaussian {
        mean: Vec2::new(random.unit() * width as f32, random.unit() * height as f32),
        log_scale: Vec2::new(1.6 + 0.5 * random.normal(), 0.9 + 0.5 * random.normal()) - smaller,
        rotation: std::f32::consts::PI * random.unit(),
        opacity_logit: logit(0.3 + 0.65 * random.unit()),
        color: Vec3::new(random.unit(), random.unit(), random.unit()),
    };
    ((0..count).map(|_| gaussian(&mut random)).collect(), Canvas::new(width, height))
}

/// The same Gaussians on a plane before a camera, one behind the other by a little, so that their order is that of the plane.
fn before_a_camera(scene: &PlanarScene, canvas: &Canvas) -> (SpatialScene, Camera) {
    let camera = Camera::looking_forward(canvas.width, canvas.height, 0.3);
    let mut flat = SpatialScene { sh_degree: 3, ..SpatialScene::default() };
    for (index, g) in scene.iter().enumerate() {
        let depth = 1.0 + 1e-6 * index as f32;
        let (sin, cos) = (0.5 * g.rotation).sin_cos();
        flat.push(SpatialGaussian {
            mean: ((g.mean - camera.center) / camera.focal * depth).extend(depth),
            log_scale: (g.log_scale + (depth / camera.focal.x).ln()).extend(-20.0),
            rotation: [cos, 0.0, 0.0, sin],
            opacity_logit: g.opacity_logit,
            sh: vec![(g.color - 0.5) / SH_C0],
        });
    }
    (flat, camera)
}

fn in_the_plane(cpu: &CpuRasterizer, count: u32) -> Result<(), Error> {
    let (scene, canvas) = planar(count);
    let (flat, camera) = before_a_camera(&scene, &canvas);
    let mut all = RenderSettings::blended(Blend::Over).on([1.0; 3]);
    all.effects = Effects { order: Order::TileDepth, sh_degree: 3, antialias: Antialias::Dilate, ..all.effects };
    let mut some = all;
    some.effects = Effects { sh_degree: 0, antialias: Antialias::None, ..all.effects };
    let mut exact = all;
    exact.effects.order = Order::PixelDepth;
    let rows = [
        picture("in the plane, sum", cpu.planar(), &scene, &canvas, RenderSettings::blended(Blend::Sum))?,
        picture("in the plane, over", cpu.planar(), &scene, &canvas, RenderSettings::blended(Blend::Over))?,
        picture("through a camera, tile-depth", cpu.spatial(), &flat, &camera, some)?,
        picture("through a camera, tile-depth, sh-degree 3, dilate", cpu.spatial(), &flat, &camera, all)?,
        picture("through a camera, pixel-depth, sh-degree 3, dilate", cpu.spatial(), &flat, &camera, exact)?,
    ];
    table(&format!("{count} Gaussians of an image, 768x512 px"), &rows)
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
    median(picture("", cpu.spatial(), &scene, &camera, none)?)?;
    let (scene, canvas) = planar(70_000);
    median(picture("", cpu.planar(), &scene, &canvas, none)?)
}

fn main() -> Result<(), Error> {
    let cpu = CpuRasterizer::new(CpuSettings::default())?;
    if std::env::args().any(|argument| argument == "off") {
        return off(&cpu);
    }
    println!("{}, seed {SEED}", cpu.spatial().describe());
    in_space(cpu.spatial())?;
    [1_000, 9_000, 70_000].into_iter().try_for_each(|count| in_the_plane(&cpu, count))
}
