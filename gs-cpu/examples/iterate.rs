//! Times whole training steps on a random scene: `iterate [WIDTH HEIGHT COUNT SIGMA sum|over LEVEL THREADS]`.
#![allow(clippy::print_stdout)]
use std::time::Instant;

use glam::{Vec2, Vec3};
use gs_core::*;
use gs_cpu::*;

fn main() {
    let a: Vec<String> = std::env::args().skip(1).collect();
    let get = |i: usize, d: &str| a.get(i).cloned().unwrap_or(d.to_owned());
    let (w, h, n): (u32, u32, u32) =
        (get(0, "768").parse().unwrap(), get(1, "512").parse().unwrap(), get(2, "9000").parse().unwrap());
    let sigma: f32 = get(3, "4").parse().unwrap();
    let blend = if get(4, "sum") == "sum" { Blend::Sum } else { Blend::Over };
    let level: SimdLevel = get(5, "avx512").parse().unwrap();
    let threads: usize = get(6, "2").parse().unwrap();
    let unit = |i: u32, k: u32| {
        let x = (i * 9 + k + 1).wrapping_mul(0x9E37_79B9);
        ((x ^ (x >> 15)).wrapping_mul(0x85EB_CA6B) >> 8) as f32 / (1u32 << 24) as f32
    };
    let scene: PlanarScene = (0..n)
        .map(|i| PlanarGaussian {
            mean: Vec2::new(unit(i, 0) * w as f32, unit(i, 1) * h as f32),
            log_scale: Vec2::new(sigma.ln() + unit(i, 2) - 0.5, sigma.ln() + unit(i, 3) - 0.5),
            rotation: unit(i, 4) * 6.0,
            opacity_logit: if blend == Blend::Over { unit(i, 5) * 2.0 - 1.0 } else { f32::INFINITY },
            color: Vec3::new(unit(i, 6), unit(i, 7), unit(i, 8)) * 0.3,
        })
        .collect();
    let target = Image::from_fn(w, h, |x, y| [(x % 50) as f32 / 50.0, (y % 70) as f32 / 70.0, 0.5]).unwrap();
    let cpu = CpuRasterizer::new(CpuSettings { threads: Some(threads), level: Some(level) }).unwrap();
    let target = cpu.upload_target(&target).unwrap();
    let settings = RenderSettings::blended(blend);
    let mut cloud = cpu.upload(&scene, Chart::LocalFrame).unwrap();
    let canvas = Canvas::new(w, h);
    let frame = cpu.forward(&cloud, &canvas, &settings).unwrap();
    let pairs = frame.pairs();
    println!("{} pairs {pairs} entries {}", cpu.describe(), frame.entries());
    drop(frame);
    let rates =
        Adam { mean: adam::Group::constant(1e-4), scale: adam::Group::constant(1e-4), ..Adam::default() }.at(0.0);
    for (name, loss) in [("L2", Loss::L2), ("L1", Loss::L1), ("L1Dssim", Loss::PAPER)] {
        for binning in [Binning::Fresh, Binning::Reuse] {
            let step = TrainStep { settings: &settings, loss, rates: &rates, binning };
            for _ in 0..3 {
                cpu.train_step(&mut cloud, &canvas, &target, &step).unwrap();
            }
            let mut times = vec![];
            for _ in 0..40 {
                let t = Instant::now();
                cpu.train_step(&mut cloud, &canvas, &target, &step).unwrap();
                times.push(t.elapsed().as_secs_f64());
            }
            times.sort_by(f64::total_cmp);
            println!(
                "{name} {binning:?}: min {:.3} median {:.3} ms; {:.3} ns/pair",
                times[0] * 1e3,
                times[20] * 1e3,
                times[0] * 1e9 / pairs as f64
            );
        }
    }
    for loss in [Loss::L2, Loss::PAPER] {
        let profile = cpu.profile(&mut cloud, &canvas, &target, &settings, loss, 30).unwrap();
        for stage in &profile.stages {
            let mut t = stage.seconds.clone();
            t.sort_by(f64::total_cmp);
            println!(
                "{:12} min {:.3} median {:.3} ms {:.3} ns/pair",
                stage.stage,
                t[0] * 1e3,
                t[15] * 1e3,
                t[0] * 1e9 / profile.pairs as f64
            );
        }
    }
}
