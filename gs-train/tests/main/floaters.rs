//! Edits of scenes by their views.

use gs_core::{Scene as _, Scene3d};
use gs_io::{Done, Edit, WorldFrame};
use gs_train::{
    Error,
    edit::{Floaters, ViewEditor},
    train::Views,
};
use pollster::FutureExt as _;

use crate::{
    fixture_3d::{rasterizer, render, thirty, views},
    planted::{Sizes, plant},
};

const PLANTED: usize = 8;

fn planted(views: &Views) -> Scene3d {
    let mut scene = thirty();
    plant(&rasterizer(), &mut scene, &views.train, &render(), (PLANTED, Sizes::World));
    scene
}

fn edited(scene: &Scene3d, views: Views, edits: &[&str]) -> (Result<Vec<Done>, Error>, Scene3d) {
    let (on, mut scene, mut frame) = (rasterizer(), scene.clone(), WorldFrame::WORLD);
    let mut editor = ViewEditor::new(&on, views, render());
    let edits = edits.iter().map(|text| text.parse::<Edit>().unwrap());
    let done = edits.map(|edit| editor.apply(&edit, &mut scene, &mut frame).block_on()).collect();
    (done, scene)
}

#[test]
fn planted_floaters_are_found_and_the_scene_stays() {
    let on = rasterizer();
    let views = views(&on);
    let scene = planted(&views);
    let found = Floaters::find(&on, &scene, &views, &render(), 0.05).block_on().unwrap();
    let (real, planted) = found.keep.split_at(30);
    let lost = real.iter().filter(|keep| !**keep).count();
    let left = planted.iter().filter(|keep| **keep).count();
    assert!(lost == 0 && left == 0, "{lost} lost, {left} left: {found}");
    assert_eq!(found.harmful + found.needless, PLANTED);
    let [before, after] = found.held_out.unwrap();
    assert!(after > before + 3.0, "{found}");
    assert!(found.to_string().starts_with("removed 8 Gaussians of 38 in front"), "{found}");
}

#[test]
fn a_scene_without_floaters_loses_no_more_than_allowed() {
    let on = rasterizer();
    // Images of another scene, so that the PSNR is finite.
    let views = views(&on);
    let mut scene = thirty();
    scene.opacity_logits.iter_mut().for_each(|logit| *logit += 0.3);
    for most in [0.0, 0.05] {
        let found = Floaters::find(&on, &scene, &views, &render(), most).block_on().unwrap();
        assert!(found.psnr[1] >= found.psnr[0] - most, "{found}");
    }
}

#[test]
fn views_move_with_the_scene() {
    let views = views(&rasterizer());
    let scene = planted(&views);
    let (done, there) = edited(&scene, views.clone(), &["turn=1,2,3:40", "scale=2.5", "move=3,-4,5", "floaters"]);
    let (here_done, here) = edited(&scene, views, &["floaters", "turn=1,2,3:40", "scale=2.5", "move=3,-4,5"]);
    assert_eq!((done.unwrap().len(), here_done.unwrap().len(), there.len()), (4, 4, 30));
    assert!(here.means.iter().zip(&there.means).all(|(a, b)| a.abs_diff_eq(*b, 1e-4)));
}

#[test]
fn contribution_is_the_largest_sum_of_weights() {
    let views = views(&rasterizer());
    let mut scene = thirty();
    // It is too transparent to be drawn.
    let clear = gs_core::Gaussian3d { opacity_logit: -9.0, ..scene.gaussian(0) };
    scene.push(clear);
    let (done, left) = edited(&scene, views.clone(), &["keep=contribution>0"]);
    assert_eq!((done.unwrap(), left), (vec![Done::Removed { gone: 1, of: 31 }], thirty()));
    // No view has more pixels.
    let (done, _) = edited(&scene, views, &["drop=contribution<=1920"]);
    assert_eq!(done.unwrap(), [Done::Removed { gone: 31, of: 31 }]);
}

#[test]
fn views_of_another_place_are_refused() {
    let view = views(&rasterizer()).train.remove(0);
    let behind = 3.0 * view.camera.position();
    let views = Views::new(vec![view], Vec::new());
    let mut scene = thirty();
    scene.means.iter_mut().for_each(|mean| *mean += behind);
    for edit in ["floaters", "keep=contribution>1"] {
        let error = edited(&scene, views.clone(), &[edit]).0.unwrap_err();
        assert!(matches!(error, Error::NothingSeen { gaussians: 30, views: 1 }), "{edit}: {error}");
    }
}
