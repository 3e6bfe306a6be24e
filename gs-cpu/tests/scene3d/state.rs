//! Edits, and saving and restoring.

use glam::Vec3;
use gs_core::Rasterizer as _;
use gs_core::{
    Adam, EditPlan, Loss, Optimizer, Parameterization, Participants, Scene, Scene3d, SplatsState, TrainStep,
    edit::{AfterEdit, Birth, Change, Moments, Origin, Place, PruneCause, Removal},
    effects::{Order, Statistics},
    rasterizer::Binning,
    scene::sigmoid,
};
use pollster::FutureExt as _;

use crate::scenes::{camera, image, rasterizer, scene, settings};

const CHARTS: [Parameterization; 2] = [Parameterization::ScaleRotation, Parameterization::CovarianceFactor];

fn train<R: Optimizer<Scene3d>>(r: &R, splats: &mut R::Splats, steps: usize, participants: Participants) {
    let mut settings = settings(Order::Global, 1);
    settings.effects.statistics = Statistics::MeanGradient;
    let target = r.upload_target(&image(60, 50)).unwrap();
    let rates = Adam { min_scale: 1e-4, participants, ..Adam::default() }.at(0.0);
    let step = TrainStep { settings: &settings, loss: Loss::L1, rates: &rates, binning: Binning::Fresh };
    for _ in 0..steps {
        r.train_step(splats, &camera(60, 50), &target, &step).block_on().unwrap();
    }
}

#[test]
fn a_restored_splats_goes_on_as_the_saved_one() {
    let r = rasterizer(2);
    let r = r.for_3d();
    for (degree, parameterization) in
        (0..=3).flat_map(|degree| CHARTS.map(|parameterization| (degree, parameterization)))
    {
        let scene = scene(50, degree, 4.0);
        let mut splats = r.upload(&scene, parameterization).unwrap();
        assert!(
            parameterization == Parameterization::CovarianceFactor || r.download(&splats).block_on().unwrap() == scene
        );
        train(r, &mut splats, 3, Participants::All);
        let saved = r.save(&splats).block_on().unwrap();
        assert_eq!(saved.matrix("sh").unwrap().0, 3 * (usize::from(degree) + 1).pow(2));
        let mut restored = r.restore(&saved).unwrap();
        assert_eq!(r.save(&restored).block_on().unwrap(), saved);
        train(r, &mut splats, 2, Participants::All);
        train(r, &mut restored, 2, Participants::All);
        assert_eq!(r.save(&restored).block_on().unwrap(), r.save(&splats).block_on().unwrap());
    }
}

#[test]
fn states_of_something_else_are_refused() {
    let r = rasterizer(1);
    let r = r.for_3d();
    let splats = r.upload(&scene(5, 1, 4.0), Parameterization::ScaleRotation).unwrap();
    let sound = r.save(&splats).block_on().unwrap();
    let refused = |spoil: &dyn Fn(&mut SplatsState)| {
        let mut state = sound.clone();
        spoil(&mut state);
        assert!(r.restore(&state).is_err(), "{state:?}");
    };
    for name in sound.tensors.keys() {
        refused(&|state| drop(state.tensors.remove(name)));
        refused(&|state| state.insert_matrix(name, 7, vec![0.0; 35]));
        refused(&|state| state.insert_u32(name, vec![1, 2]));
    }
    // Its shapes are no frames.
    refused(&|state| state.parameterization = Parameterization::CovarianceFactor);
    r.restore(&sound).unwrap();
}

#[test]
fn everything_follows_its_gaussian_through_an_edit() {
    let r = rasterizer(2);
    let r = r.for_3d();
    let scene = scene(20, 1, 4.0);
    let mut splats = r.upload(&scene, Parameterization::ScaleRotation).unwrap();
    train(r, &mut splats, 2, Participants::All);
    let before = r.save(&splats).block_on().unwrap();
    let trained = r.download(&splats).block_on().unwrap();
    let new = scene.gaussian(7);
    let plan = EditPlan {
        removed: vec![Removal { index: 3, cause: PruneCause::Transparent }],
        changed: vec![Change { index: 5, gaussian: new.clone(), moments: Moments::Fresh }],
        added: vec![
            Birth {
                gaussian: new.clone(),
                parent: Some(3),
                moments: Moments::Inherit,
                origin: Origin::Clone,
                place: Place::Last,
            },
            Birth {
                gaussian: new.clone(),
                parent: Some(4),
                moments: Moments::Fresh,
                origin: Origin::Split,
                place: Place::Last,
            },
        ],
        opacity_ceiling: None,
        statistics: AfterEdit::Keep,
    };
    r.edit(&mut splats, &plan).block_on().unwrap();
    let (after, edited) = (r.save(&splats).block_on().unwrap(), r.download(&splats).block_on().unwrap());
    assert_eq!(r.len(&splats), 21);
    // Slot after the edit, where its parameters are from (`None`: new), where its moments are from, where its statistics are from.
    for (slot, own, moments, statistics) in [
        (2, Some(2), Some(2), 2),
        (3, Some(4), Some(4), 4),
        (4, None, None, 5),
        (19, None, Some(3), 3),
        (20, None, None, 4),
    ] {
        assert_eq!(edited.gaussian(slot), own.map_or(new.clone(), |i| trained.gaussian(i)));
        let moment = |state: &SplatsState, i: usize| state.matrix("moment2").unwrap().1[i * 23..][..23].to_vec();
        assert_eq!(moment(&after, slot), moments.map_or(vec![0.0; 23], |i| moment(&before, i)));
        let visible = |state: &SplatsState, i: usize| state.integers("visible").unwrap()[i];
        assert_eq!(visible(&after, slot), visible(&before, statistics));
    }
    let ceiling = EditPlan { opacity_ceiling: Some(0.01), ..EditPlan::default() };
    r.edit(&mut splats, &ceiling).block_on().unwrap();
    assert!(r.download(&splats).block_on().unwrap().opacity_logits.iter().all(|&o| sigmoid(o) <= 0.0101));
    let refused =
        EditPlan { removed: vec![Removal { index: 99, cause: PruneCause::NotFinite }], ..EditPlan::default() };
    assert!(r.edit(&mut splats, &refused).block_on().is_err());
    train(r, &mut splats, 2, Participants::All);
}

#[test]
fn only_those_in_view_take_part_if_so_told() {
    let r = rasterizer(2);
    let r = r.for_3d();
    let mut scene = scene(20, 1, 4.0);
    scene.means[6] = Vec3::new(0.0, 0.0, -5.0);
    for participants in [Participants::All, Participants::Visible] {
        let mut splats = r.upload(&scene, Parameterization::ScaleRotation).unwrap();
        train(r, &mut splats, 3, participants);
        let state = r.save(&splats).block_on().unwrap();
        assert_eq!(state.integers("steps").unwrap()[6], if participants == Participants::All { 3 } else { 0 });
        assert_eq!(state.integers("visible").unwrap()[6], 0);
        assert_eq!(state.integers("steps").unwrap()[5], 3);
        assert_eq!(r.download(&splats).block_on().unwrap().gaussian(6), scene.gaussian(6));
    }
}
