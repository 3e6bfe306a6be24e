//! Images of several exposures and white balances.

use crate::fixture_3d::{LENS, changed, rasterizer, short, thirty, views};
use gs_core::Image;
use gs_density::Policy;
use gs_io::dataset::PosedImage;
use gs_train::{
    Trainer3d,
    train::{Exposure, Start, Views},
};
use pollster::FutureExt as _;

/// These views as cameras with other exposures and white balances took them.
fn tinted(views: Views) -> Views {
    changed(views, |i, posed| {
        let gain = [0, 1, 2].map(|k| 0.5 + 0.1 * ((i * 5 + k * 3) % 6) as f32);
        let tint = |x, y| {
            let color = posed.image.pixel(x, y);
            [0, 1, 2].map(|k| gain[k] * color[k] + 0.02 * (i % 3) as f32)
        };
        PosedImage { image: Image::from_fn(LENS.0, LENS.1, tint).unwrap(), ..posed }
    })
}

#[test]
fn differences_in_exposure_are_corrected_where_there_are_any() {
    let rasterizer = rasterizer();
    let run = |views: Views, exposure: Exposure| {
        let mut settings = short(600);
        settings.exposure = exposure;
        settings.policy = Policy::None;
        settings.render.effects.sh_degree = 0;
        settings.adam.color.learning_rate *= 4.0;
        let mut grey = thirty();
        grey.sh.fill(glam::Vec3::ZERO);
        let mut trainer = Trainer3d::from_views(&rasterizer, views, Start::Scene(grey), settings).block_on().unwrap();
        trainer.run(&mut ()).block_on().unwrap();
        let matched = trainer.evaluate(&|_, _, _| Ok(())).block_on().unwrap().color_matched.unwrap();
        (matched.psnr, trainer.exposure())
    };
    let all = || views(&rasterizer);
    let (without, none) = run(tinted(all()), Exposure::Off);
    let (corrected, report) = run(tinted(all()), Exposure::Affine);
    let (decided, found) = run(tinted(all()), Exposure::Auto);
    let (plain, agree) = run(all(), Exposure::Auto);
    assert!(corrected > without + 4.0 && decided > without + 4.0, "{without}, {corrected}, {decided} dB");
    assert!(
        none.is_none() && report.unwrap().used && found.unwrap().used && !agree.unwrap().used,
        "{found:?} {agree:?}"
    );
    assert_eq!(run(all(), Exposure::Off).0, plain, "images that agree are trained on as they are");
}

#[test]
fn exposure_of_a_single_image_is_refused() {
    let rasterizer = rasterizer();
    let single = || {
        let mut views = views(&rasterizer);
        views.train.truncate(1);
        views
    };
    let begun = |exposure| {
        Trainer3d::from_views(&rasterizer, single(), Start::Scene(thirty()), short(40).with(|s| s.exposure = exposure))
            .block_on()
    };
    let refused = begun(Exposure::Affine).unwrap_err().to_string();
    assert!(refused.contains("exposure") && refused.contains("single"), "{refused}");
    let mut alone = begun(Exposure::Auto).unwrap();
    alone.run(&mut ()).block_on().unwrap();
    assert!(!alone.exposure().unwrap().used);
}
