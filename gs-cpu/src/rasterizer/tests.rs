//! Tests of the rasterizer that need its parts.

use glam::{Vec2, Vec3};
use gs_core::{Adam, Blend, Canvas, Gaussian2d, Participants, Scene, Scene2d, Wait};
use pollster::FutureExt as _;

use super::*;
use crate::{draw::strips_at_once, layout::Grid};

#[test]
fn too_many_tile_entries_are_an_error_and_leave_the_splats_unchanged() {
    let rasterizer = CpuRasterizer::new(CpuSettings::default()).unwrap();
    let cpu = rasterizer.for_2d();
    let gaussian = Gaussian2d {
        mean: Vec2::splat(20.0),
        log_scale: Vec2::splat(2.0),
        rotation: 0.0,
        opacity_logit: f32::INFINITY,
        color: Vec3::splat(0.5),
    };
    let scene: Scene2d = [gaussian; 4].into_iter().collect();
    let (view, settings) = (Canvas::new(40, 40), RenderSettings::blended(Blend::Sum));
    let target = cpu.upload_target(&Image::filled(40, 40, [0.3; 3]).unwrap()).unwrap();
    let rates = Adam::default().at(0.0);
    let step = TrainStep { settings: &settings, loss: Loss::L2, rates: &rates, binning: Binning::Reuse };
    // Four Gaussians in three strips each: twelve entries.
    let limit_next_pass = |most_entries: u32| {
        let pool = &rasterizer.resources.for_2d.pool;
        let mut workspace = pool.take();
        workspace.tiles.bins.most_entries = most_entries;
        pool.give(workspace);
    };
    let refused = |result: Result<(), Error>| {
        let message = result.unwrap_err().to_string();
        assert!(message.contains("12 pairs") && message.contains("at most 11"), "{message}");
    };

    let mut splats = cpu.upload(&scene, Parameterization::default()).unwrap();
    let before = cpu.save(&splats).block_on().unwrap();
    limit_next_pass(11);
    refused(cpu.forward(&splats, &view, &settings).block_on().map(drop));
    limit_next_pass(11);
    refused(cpu.solve_colors(&mut splats, &view, &target, &settings, 1).block_on());
    limit_next_pass(11);
    refused(cpu.train_step(&mut splats, &view, &target, &step).block_on());
    assert_eq!(cpu.save(&splats).block_on().unwrap(), before);

    let mut fresh = cpu.upload(&scene, Parameterization::default()).unwrap();
    let [mut found, mut expected] = [Vec::new(), Vec::new()];
    for (splats, losses) in [(&mut splats, &mut found), (&mut fresh, &mut expected)] {
        limit_next_pass(12);
        cpu.train_step(splats, &view, &target, &step).block_on().unwrap();
        cpu.losses(splats, Wait::All, losses).block_on().unwrap();
    }
    assert_eq!((found.len(), &found), (1, &expected), "a refused step has no loss");
    assert_eq!(cpu.save(&splats).block_on().unwrap(), cpu.save(&fresh).block_on().unwrap());
}

#[test]
fn gaussians_out_of_view_move_only_if_all_participate() {
    let rasterizer = CpuRasterizer::new(CpuSettings::default()).unwrap();
    let cpu = rasterizer.for_2d();
    let at = |x: f32| Gaussian2d {
        mean: Vec2::new(x, 9.0),
        log_scale: Vec2::splat(1.0),
        rotation: 0.3,
        opacity_logit: 0.5,
        color: Vec3::splat(0.5),
    };
    let scene: Scene2d = [at(8.0), at(900.0)].into_iter().collect();
    let target = cpu.upload_target(&Image::filled(16, 16, [0.2; 3]).unwrap()).unwrap();
    let settings = RenderSettings::blended(Blend::Over);
    for (participants, steps) in [(Participants::All, [2, 2]), (Participants::Visible, [2, 1])] {
        let mut splats = cpu.upload(&scene, Parameterization::default()).unwrap();
        // The first step sees both Gaussians, so both have moments.
        let wide = Canvas::new(1024, 16);
        let wide_target = cpu.upload_target(&Image::filled(1024, 16, [0.2; 3]).unwrap()).unwrap();
        let rates = Adam::default().with(|s| s.participants = participants).at(0.0);
        let step = TrainStep { settings: &settings, loss: Loss::L1, rates: &rates, binning: Binning::Fresh };
        cpu.train_step(&mut splats, &wide, &wide_target, &step).block_on().unwrap();
        let before = cpu.download(&splats).block_on().unwrap();
        cpu.train_step(&mut splats, &Canvas::new(16, 16), &target, &step).block_on().unwrap();
        let after = cpu.download(&splats).block_on().unwrap();
        assert_eq!(cpu.save(&splats).block_on().unwrap().integers("steps").unwrap(), steps);
        assert_ne!(after.gaussian(0), before.gaussian(0));
        assert_eq!(after.gaussian(1) == before.gaussian(1), participants == Participants::Visible);
    }
}

#[test]
fn draw_and_forward_give_the_same_bits() {
    let rasterizer = CpuRasterizer::new(CpuSettings { threads: Some(2), level: None }).unwrap();
    let cpu = rasterizer.for_2d();
    // Strips of 3 MiB each, so that they are drawn in several rounds; the last has 9 columns.
    let canvas = Canvas::new(249, 16_384);
    let at_once = strips_at_once(&Grid::new((249, 16_384), 64));
    assert!(at_once > 1 && at_once < 16, "{at_once} of 16 strips");
    let gaussian = |i: u32| Gaussian2d {
        mean: Vec2::new((i * 37 % 249) as f32 + 0.3, (i * 5003 % 16_384) as f32),
        log_scale: Vec2::new(3.0, 1.5),
        rotation: i as f32,
        opacity_logit: 1.0,
        color: Vec3::new(0.2, 0.4, 0.1) * (i % 7) as f32,
    };
    for blend in [Blend::Sum, Blend::Over] {
        let mut scene: Scene2d = (0..300).map(gaussian).collect();
        if blend == Blend::Sum {
            scene.opacity_logits.clear();
        }
        let settings = RenderSettings::blended(blend).on([0.5, 0.25, 0.125]);
        let splats = cpu.upload(&scene, Parameterization::default()).unwrap();
        let pass = cpu.forward(&splats, &canvas, &settings).block_on().unwrap();
        let expected = (cpu.image(&pass).block_on().unwrap(), cpu.culled(&pass));
        assert!(cpu.draw(&splats, &canvas, &settings).block_on().unwrap() == expected, "{blend:?}");
    }
}
