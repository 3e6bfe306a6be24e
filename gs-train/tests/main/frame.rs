//! The frame of the views, relative to the world of their data set.

use crate::fixture_3d::{rasterizer, short, views};
use gs_io::WorldFrame;
use gs_train::{
    Trainer3d,
    train::{Start, TrainSummary, Views},
};
use pollster::FutureExt as _;

#[test]
fn the_frame_of_the_views_is_that_of_checkpoint_and_summary() {
    let rasterizer = rasterizer();
    let frame = WorldFrame { origin: glam::DVec3::new(4.5e6, -0.1, 3.0), unit: 100.0 };
    let folder = tempfile::tempdir().unwrap();
    for frame in [frame, WorldFrame::WORLD] {
        let views = Views { frame, ..views(&rasterizer) };
        let mut trainer = Trainer3d::from_views(&rasterizer, views, Start::Random, short(1)).block_on().unwrap();
        trainer.run(&mut ()).block_on().unwrap();
        let file = folder.path().join("checkpoint.safetensors");
        gs_io::write_checkpoint(&file, &trainer.checkpoint().block_on().unwrap()).unwrap();
        let gs_io::AnyScene::ThreeD(read) = gs_io::read_scene(&file, gs_io::Values::Checked).unwrap().scene else {
            panic!("a 2D scene")
        };
        assert_eq!(read.trained_with.frame, frame);
        let evaluation = trainer.evaluate(&|_, _, _| Ok(())).block_on().unwrap();
        assert_eq!(TrainSummary::new(&trainer, evaluation).block_on().unwrap().frame, frame);
    }
}
