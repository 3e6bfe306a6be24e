//! Pending training steps: when the host waits, which steps are repeated, and the effect of a lost
//! device.

use super::*;

/// Splats in training on one device.
struct Training<'r> {
    r: &'r WgpuRasterizer,
    draw: Draw,
    target: Target,
    splats: Splats<Scene2d>,
}

impl<'r> Training<'r> {
    fn new(r: &'r WgpuRasterizer, draw: Draw) -> Self {
        let target = r.for_2d().upload_target(&draw.target().unwrap()).unwrap();
        let splats = r.upload(&draw.scene, Parameterization::CovarianceFactor).unwrap();
        Self { r, draw, target, splats }
    }

    /// Submits a step with this α cut.
    fn try_send(&mut self, alpha_cut: f32, binning: Binning) -> Result<(), Error> {
        let mut settings = self.draw.settings;
        settings.accuracy.alpha_cut = alpha_cut;
        let rates = Adam::default().with(|s| s.epsilon = 1e-6).at(0.0);
        let step = TrainStep { settings: &settings, loss: Loss::L2, rates: &rates, binning };
        self.r.train_step(&mut self.splats, &self.draw.view, &self.target, &step).block_on()
    }

    fn send(&mut self, steps: usize) {
        (0..steps).for_each(|_| self.try_send(ALPHA_CUT, Binning::Fresh).unwrap());
    }

    fn losses(&mut self, wait: Wait) -> Vec<f32> {
        let mut losses = Vec::new();
        self.r.losses(&mut self.splats, wait, &mut losses).block_on().unwrap();
        losses
    }
}

/// Bytes moved by `steps` training steps of `gaussians` Gaussians.
fn bytes_of_steps(gaussians: usize, steps: usize) -> u64 {
    let r = another();
    let mut training = Training::new(&r, Draw::new(Kind2d::Typical, Blend::Sum, gaussians, (120, 80), 3));
    // Buffers grow in the first step.
    training.send(1);
    assert_eq!(training.losses(Wait::All).len(), 1);
    let before = r.bytes_moved();
    training.send(steps);
    assert_eq!(training.losses(Wait::All).len(), steps);
    r.bytes_moved() - before
}

#[test]
fn a_training_step_moves_few_bytes_however_many_gaussians_there_are() {
    let [few, many] = [30, 3000].map(|gaussians| bytes_of_steps(gaussians, 5));
    assert_eq!(few, many);
    assert!(few > 0 && few <= 5 * 512, "{few} bytes in 5 steps");
    assert!(bytes_of_steps(30, 6) > few, "bytes are not counted");
}

#[test]
fn a_training_step_waits_only_for_the_oldest_of_enough_pending_steps() {
    let r = another();
    let mut training = Training::new(&r, Draw::new(Kind2d::Typical, Blend::Over, 200, (120, 80), 3));
    training.send(1);
    training.losses(Wait::All);
    let waits = r.waits();
    for sent in 1..=STEPS_IN_FLIGHT {
        training.send(1);
        assert_eq!((training.splats.steps_in_flight(), r.waits()), (sent, waits));
    }
    let one_by_one: u64 = (0..5)
        .map(|_| {
            let waits = r.waits();
            training.send(1);
            assert_eq!(training.splats.steps_in_flight(), STEPS_IN_FLIGHT, "only the oldest is waited for");
            r.waits() - waits
        })
        .sum();
    assert!(one_by_one <= 5, "{one_by_one} waits for 5 steps");
    let waits = r.waits();
    let mut losses = training.losses(Wait::Arrived);
    assert_eq!(r.waits(), waits, "what has arrived is not waited for");
    losses.extend(training.losses(Wait::All));
    assert_eq!((losses.len(), training.splats.steps_in_flight()), (STEPS_IN_FLIGHT + 5, 0));
    r.download(&training.splats).block_on().unwrap();
    assert!(r.waits() > waits, "waits are not counted");
}

/// Whether the buffers of a device are large enough from the start.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Room {
    /// Large enough: the pool has large buffers.
    AtOnce,
    /// Too small: buffers grow when needed, and steps are repeated.
    WhenNeeded,
}

impl Room {
    /// A device of its own.
    fn device_for(self, draw: &Draw) -> WgpuRasterizer {
        let r = another();
        if self == Self::AtOnce {
            r.render(&draw.scene, &draw.view, &draw.settings).block_on().unwrap();
        }
        r
    }
}

/// Losses, state and bytes moved after steps of which some need much larger buffers.
fn trained_with_room(blend: Blend, room: Room) -> (Vec<f32>, SplatsState, u64) {
    let draw = Draw::new(Kind2d::Large, blend, 200, (173, 141), 42).on([0.1, 0.5, 0.3]);
    let r = room.device_for(&draw);
    let mut training = Training::new(&r, draw);
    let before = r.bytes_moved();
    let mut losses = Vec::new();
    // Under `Over` the first steps fit. Later lists have more entries, as their cut differs, and
    // are reused; all of that is pending when the host reads the status. Under `Sum` nothing fits.
    for (alpha_cut, fresh) in [(0.5, true), (0.5, false), (ALPHA_CUT, false), (ALPHA_CUT, false), (ALPHA_CUT, false)] {
        training.try_send(alpha_cut, if fresh { Binning::Fresh } else { Binning::Reuse }).unwrap();
    }
    losses.extend(training.losses(Wait::Arrived));
    for step in 0..6 {
        training.try_send(ALPHA_CUT, if step == 4 { Binning::Fresh } else { Binning::Reuse }).unwrap();
    }
    let state = r.save(&training.splats).block_on().unwrap();
    losses.extend(training.losses(Wait::All));
    (losses, state, r.bytes_moved() - before)
}

#[test]
fn repeated_steps_end_at_the_same_bits() {
    for blend in [Blend::Sum, Blend::Over] {
        let (losses, state, bytes) = trained_with_room(blend, Room::AtOnce);
        let (again, found, more_bytes) = trained_with_room(blend, Room::WhenNeeded);
        assert!(more_bytes > bytes, "{blend:?}: nothing was sent again");
        assert_eq!(losses.len(), 11);
        assert!(losses.iter().all(|&loss| loss > 0.0 && loss.is_finite()), "{losses:?}");
        let loss_bits = |losses: &[f32]| losses.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
        assert_eq!(loss_bits(&again), loss_bits(&losses), "{blend:?}");
        assert_eq!(bits(&found), bits(&state), "{blend:?}");
    }
}

/// Calls on splats with pending steps; gradients are from before.
type Look = fn(&mut Training<'_>, &Gradients<Scene2d>) -> Vec<f32>;

fn numbers(state: &SplatsState) -> Vec<f32> {
    bits(state).into_values().flatten().map(f32::from_bits).collect()
}

const LOOKS: [(&str, Look); 7] = [
    ("save", |t, _| numbers(&t.r.save(&t.splats).block_on().unwrap())),
    ("download", |t, _| {
        t.r.download(&t.splats).block_on().unwrap().colors.iter().flat_map(glam::Vec3::to_array).collect()
    }),
    ("statistics", |t, _| t.r.statistics(&t.splats).block_on().unwrap().signal_sum),
    ("forward", |t, _| {
        let pass = t.r.forward(&t.splats, &t.draw.view, &t.draw.settings).block_on().unwrap();
        t.r.image(&pass).block_on().unwrap().pixels().as_flattened().to_vec()
    }),
    ("step", |t, gradients| {
        t.r.step(&mut t.splats, gradients, &Adam::default().at(0.0)).block_on().unwrap();
        numbers(&t.r.save(&t.splats).block_on().unwrap())
    }),
    ("edit", |t, _| {
        let removed = vec![Removal { index: 3, cause: PruneCause::Unimportant }];
        t.r.edit(&mut t.splats, &EditPlan { removed, statistics: AfterEdit::Keep, ..EditPlan::default() })
            .block_on()
            .unwrap();
        numbers(&t.r.save(&t.splats).block_on().unwrap())
    }),
    ("solve_colors", |t, _| {
        t.r.solve_colors(&mut t.splats, &t.draw.view, &t.target, &t.draw.settings, 2).block_on().unwrap();
        numbers(&t.r.save(&t.splats).block_on().unwrap())
    }),
];

/// The bits of the results after two steps, and the bytes moved.
fn seen_after_two_steps(look: Look, room: Room) -> (Vec<u32>, u64) {
    // Each Gaussian touches every tile.
    let mut draw = Draw::new(Kind2d::Large, Blend::Sum, 80, (160, 144), 43);
    draw.scene.log_scales.fill(glam::Vec2::splat(5.0));
    draw.settings.effects.statistics = Statistics::MeanGradient;
    let r = room.device_for(&draw);
    let mut training = Training::new(&r, draw);
    let Training { draw, target, splats, .. } = &training;
    let elsewhere = draw.view.showing(glam::Vec2::splat(1e5), glam::Vec2::ONE);
    let pass = r.forward(splats, &elsewhere, &draw.settings).block_on().unwrap();
    assert_eq!(pass.entries(), 0, "its buffers stay small");
    let (_, gradients) = r.backward(splats, pass, target, &Loss::L2).block_on().unwrap();
    training.send(2);
    assert_eq!(training.splats.steps_in_flight(), 2);
    let before = r.bytes_moved();
    let seen = look(&mut training, &gradients).into_iter().map(f32::to_bits).collect();
    assert_eq!(training.losses(Wait::Arrived).len(), 2);
    (seen, r.bytes_moved() - before)
}

#[test]
fn every_call_sees_repeated_steps() {
    for (what, look) in LOOKS {
        let (expected, bytes) = seen_after_two_steps(look, Room::AtOnce);
        let (found, more_bytes) = seen_after_two_steps(look, Room::WhenNeeded);
        assert!(more_bytes > bytes, "{what}: nothing was sent again");
        assert!(found == expected, "{what}");
    }
}

#[test]
fn splats_can_be_dropped_with_pending_steps() {
    let r = another();
    let draw = || Draw::new(Kind2d::Typical, Blend::Sum, 200, (120, 80), 3);
    let mut expected = Training::new(&r, draw());
    expected.send(3);
    let expected = expected.losses(Wait::All);
    for _ in 0..3 {
        let mut dropped = Training::new(&r, draw());
        dropped.send(STEPS_IN_FLIGHT);
        drop(dropped);
        let mut next = Training::new(&r, draw());
        next.send(3);
        assert_eq!(next.losses(Wait::All), expected);
    }
}

#[test]
fn pending_steps_on_a_lost_device_are_a_later_error() {
    for wait in [Wait::Arrived, Wait::All] {
        let r = another();
        let mut training = Training::new(&r, Draw::new(Kind2d::Typical, Blend::Sum, 200, (120, 80), 3));
        training.send(3);
        r.lose_device();
        for _ in 0..2 {
            let outcomes = [
                r.losses(&mut training.splats, wait, &mut Vec::new()).block_on().unwrap_err(),
                training.try_send(ALPHA_CUT, Binning::Fresh).unwrap_err(),
                r.statistics(&training.splats).block_on().unwrap_err(),
            ];
            for error in outcomes {
                assert!(matches!(&error, Error::Backend { message, .. } if message.contains("lost")), "{error}");
            }
        }
    }
}

#[test]
fn a_lost_device_is_an_error_at_every_call() {
    let r = another();
    let draw = Draw::new(Kind2d::Typical, Blend::Sum, 20, (40, 30), 5);
    let image = draw.target().unwrap();
    let target = r.for_2d().upload_target(&image).unwrap();
    let mut splats = r.upload(&draw.scene, Parameterization::CovarianceFactor).unwrap();
    r.lose_device();
    let rates = Adam::default().at(0.0);
    let step = TrainStep { settings: &draw.settings, loss: Loss::L2, rates: &rates, binning: Binning::Fresh };
    let outcomes = [
        r.train_step(&mut splats, &draw.view, &target, &step).block_on().err(),
        r.losses(&mut splats, Wait::All, &mut Vec::new()).block_on().err(),
        r.download(&splats).block_on().err(),
        r.save(&splats).block_on().err(),
        r.upload(&draw.scene, Parameterization::CovarianceFactor).err(),
        r.for_2d().upload_target(&image).err(),
        r.forward(&splats, &draw.view, &draw.settings).block_on().err(),
    ];
    for (call, error) in outcomes.into_iter().enumerate() {
        assert!(
            matches!(&error, Some(Error::Backend { backend: "wgpu", message }) if message.contains("lost")),
            "call {call}: {error:?}"
        );
    }
}
