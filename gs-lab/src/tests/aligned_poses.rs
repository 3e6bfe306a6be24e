//! Studies of wrong camera poses, whose held-out views are measured at aligned poses.

use std::num::NonZeroU32;

use gs_io::dataset::{DatasetSettings, read_dataset};
use gs_jobs::WorkSettings;
use gs_train::{
    Trainer3d,
    train::{Views, evaluate_aligned},
};
use pollster::FutureExt as _;

use super::scenes::{cpu, laid_out, place};
use crate::{
    Existing, Results, StudyFolder, conduct,
    result::EffectOf,
    study::{Matching, digest},
};

const STUDY: &str = "name = 'small'\nscenes = ['one']\nbudgets = [60]\nseeds = [3]\npreset = 'quick'\niterations = 100\n\
    match = ['count']\nalign-poses = true\n[dataset]\nholdout = 4\n[settings]\nrender.effects.sh-degree = 1\n\
    [[factor]]\nname = 'start'\n\
    level = [{ name = 'points', start = 'points' }, { name = 'random', start = 'random' }]\n\
    [[factor]]\nname = 'poses'\n\
    level = [{ name = 'true' }, { name = 'wrong', pose-error = { degrees = 2.0, percent = 2.0 } }]\n\
    [[factor]]\nname = 'refined'\n\
    level = [{ name = 'off', settings.refine-poses = 'off' }, { name = 'on', settings.refine-poses = 'on' }]\n";

/// Every arm, refined or not, has the numbers of the right halves of views whose cameras, as wrong as the
/// arm's, are aligned to the left halves.
#[test]
fn all_arms_are_measured_at_aligned_poses() {
    let place = place(1);
    let plan = laid_out(STUDY, place.path()).unwrap();
    let folder = StudyFolder::prepare(&place.path().join("out"), &plan, Existing::Refuse).unwrap();
    conduct(&plan, &[&cpu()], &folder, &WorkSettings::default(), &()).unwrap();
    let results = Results::read(&plan, &folder).unwrap();
    assert_eq!((plan.runs.len(), results.missing().count()), (8, 0));

    let settings = DatasetSettings::default().with(|s| s.test_every = NonZeroU32::new(4));
    let (dataset, on) = (read_dataset(place.path().join("one"), &settings).unwrap(), cpu());
    let given = Views::of_dataset(&dataset);
    for (run, record) in results.rows() {
        let (end, arm) = (record.unwrap().outcome.finished().unwrap(), plan.arm(run));
        let views = arm.pose_error.map_or(given.clone(), |error| error.applied(given.clone(), run.seed));
        let settings = run.settings.of_scene();
        let start = arm.start(&dataset, settings).of(&dataset).unwrap();
        let mut trainer = Trainer3d::from_views(&on, views.clone(), start, settings.clone()).block_on().unwrap();
        trainer.run(&mut ()).block_on().unwrap();
        let scene = trainer.scene().block_on().unwrap();
        assert_eq!(end.scene, digest::of_scene_3d(&scene));
        let expected = evaluate_aligned(&on, &scene, &views.test, &trainer.shown()).block_on().unwrap();
        let matched = expected.pose_matched.unwrap();
        assert_eq!((end.psnr, end.ssim, end.l1, end.ms_ssim), (matched.psnr, matched.ssim, matched.l1, None));
        assert_ne!(end.psnr, expected.psnr, "{}: whole views at the given poses", arm.name);
        assert_eq!(end.views.len(), 2);
        for (view, expected) in end.views.iter().zip(&expected.views) {
            let matched = expected.pose_matched.unwrap();
            assert_eq!((&view.name, view.psnr, view.l1), (&expected.name, matched.psnr, matched.l1));
        }
    }
    // Refinement and wrong poses change the scenes, from enough points.
    let scene = |name: &str| {
        let arm = plan.study.arms.iter().position(|arm| arm.name == name).unwrap();
        results.finished(arm, 60).next().unwrap().1.scene.clone()
    };
    let [off, on, wrong] = ["random+true+off", "random+true+on", "random+wrong+off"].map(scene);
    assert!(off != on && off != wrong);
    let effects: Vec<EffectOf> = results.effects(&[Matching::Count]).into_iter().map(|effect| effect.of).collect();
    let labels: Vec<String> = effects.iter().map(EffectOf::label).collect();
    for expected in ["start: random", "poses: wrong", "refined: on", "poses: wrong × refined: on"] {
        assert!(labels.iter().any(|label| label == expected), "{labels:?}");
    }
}

#[test]
fn poses_are_aligned_where_ends_of_scenes_are_compared() {
    let place = place(1);
    assert_ne!(
        laid_out(STUDY, place.path()).unwrap().runs[0].address,
        laid_out(&STUDY.replace("align-poses = true", ""), place.path()).unwrap().runs[0].address
    );
    let image = "name = 'x'\nimages = ['paper']\nbudgets = [9]\nseeds = [0]\nmatch = ['count']\nalign-poses = true\n\
        [[arm]]\nname = 'a'\n";
    for text in [STUDY.replace("match = ['count']\n", "").as_str(), image] {
        let message = laid_out(text, place.path()).unwrap_err().to_string();
        assert!(
            message.contains("align-poses is for scenes that are compared at their ends: leave it out"),
            "{message}"
        );
    }
}
