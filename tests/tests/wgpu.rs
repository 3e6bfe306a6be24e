//! gs-wgpu: the conformance suite, drawn scenes against the oracle and against gs-cpu, and that it repeats itself bit for bit.

use std::{collections::BTreeMap, num::NonZero, sync::OnceLock};

use gs_conformance::{
    Failure,
    conformance::{cases, check_gradients, check_image},
    oracle::{AdamReference, Oracle, OracleScene},
    scenes::{Draw, Kind, draws},
};
use gs_core::{
    Adam, Binning, Blend, Chart, CloudState, EditPlan, Error, Image, Loss, PlanarScene, Rasterizer, RenderSettings,
    Scene, TrainStep, Wait,
    adam::AdamRates,
    constants::ALPHA_CUT,
    edit::{AfterEdit, PruneCause, Removal},
    effects::Statistics,
    state::TensorData,
};
use gs_cpu::{CpuRasterizer, CpuSettings};
use gs_wgpu::{
    FreshBuffers, Kernels, PlanarCloud, PlanarGradients, STEPS_IN_FLIGHT, Target, WgpuRasterizer, WgpuSettings,
    adapters,
};
use proptest::{
    prelude::*,
    test_runner::{RngSeed, TestCaseError},
};

/// One device for all tests, with fresh buffers full of NaN.
fn rasterizer() -> &'static WgpuRasterizer {
    static RASTERIZER: OnceLock<WgpuRasterizer> = OnceLock::new();
    RASTERIZER.get_or_init(|| {
        poisoned(None).expect("`cargo xtask test` installs a software driver where there is no adapter")
    })
}

fn poisoned(kernels: Option<Kernels>) -> Result<WgpuRasterizer, Error> {
    // With few work groups in a row, every dispatch has more than fit in one: no adapter that is tested has memory for as many as
    // 65,535, the usual limit.
    let most_groups = if kernels.is_some() { NonZero::new(3) } else { None };
    let fresh_buffers = FreshBuffers::Poison;
    WgpuRasterizer::new(WgpuSettings { fresh_buffers, kernels, most_groups, ..WgpuSettings::default() })
}

/// A device for each kind of kernels that the adapter can run.
fn rasterizers() -> &'static [(Kernels, WgpuRasterizer)] {
    static RASTERIZERS: OnceLock<Vec<(Kernels, WgpuRasterizer)>> = OnceLock::new();
    RASTERIZERS.get_or_init(|| {
        let kernels = [Kernels::Portable, Kernels::Subgroups, Kernels::Vectors];
        kernels.into_iter().filter_map(|kernels| Some((kernels, poisoned(Some(kernels)).ok()?))).collect()
    })
}

/// The other device of its own, as a later process would have.
fn another() -> WgpuRasterizer {
    WgpuRasterizer::new(WgpuSettings::default()).unwrap()
}

/// The suite lets a backend refuse them; this one does not.
#[test]
fn all_statistics_are_offered() {
    let mut draw = Draw::new(Kind::Typical, Blend::Over, 5, (20, 20), 3);
    for statistics in [Statistics::MeanGradient, Statistics::AbsoluteGradient, Statistics::PixelError] {
        draw.settings.effects.statistics = statistics;
        rasterizer().render(&draw.scene, &draw.view, &draw.settings).unwrap();
    }
}

#[test]
fn conforms_with_all_kernels() {
    for (kernels, rasterizer) in rasterizers() {
        let failures: Vec<String> = cases::<WgpuRasterizer>()
            .into_iter()
            .filter_map(|case| Some(format!("{}: {}", case.name, (case.run)(rasterizer).err()?)))
            .collect();
        assert!(failures.is_empty(), "{kernels:?}:\n{}", failures.join("\n"));
    }
}

/// Beside what rounding allows number by number: images within 1e-5, gradients within a thousandth of the largest by the same parameter,
/// away from the cut. Worst measured: 5.7e-6 and 1.1e-4 (`examples/worst_cases.rs`).
#[test]
fn differences_from_the_oracle_are_small_in_numbers() {
    for (kernels, r) in rasterizers() {
        for (kind, seed) in Kind::ALL.into_iter().flat_map(|kind| (0..6).map(move |seed| (kind, seed))) {
            for blend in [Blend::Sum, Blend::Over] {
                let draw = Draw::new(kind, blend, 24, (35, 26), seed).on([0.3, 0.6, 0.2]);
                let image = check_image(r, &draw).unwrap();
                assert!(image.worst_share <= 1e-5, "{kernels:?}, {kind:?}, {seed}, {blend:?}: {image:?}");
                match check_gradients(r, &draw, &Loss::L2, Chart::ScaleRotation) {
                    Err(Failure::Nothing(_)) => {}
                    gradients => {
                        let gradients = gradients.unwrap();
                        assert!(
                            gradients.worst_share <= 1e-3,
                            "{kernels:?}, {kind:?}, {seed}, {blend:?}: {gradients:?}"
                        );
                    }
                }
            }
        }
    }
}

/// Gaussians that shrink by a factor of e from step to step have long become others than those that the lists were made for.
#[test]
fn lists_that_are_out_of_date_never_make_what_is_not_finite() {
    for (kernels, r) in rasterizers() {
        let draw = Draw::new(Kind::Typical, Blend::Sum, 300, (64, 48), 7);
        let target = r.planar().upload_target(&draw.target().unwrap()).unwrap();
        let mut cloud = r.upload(&draw.scene, Chart::LocalFrame).unwrap();
        let mut adam = Adam { epsilon: 1e-6, ..Adam::default() };
        adam.scale.learning_rate = 1.0;
        adam.rotation.learning_rate = 1.0;
        let rates = adam.at(0.0);
        for i in 0..24 {
            let binning = if i % 8 == 0 { Binning::Fresh } else { Binning::Reuse };
            let step = TrainStep { settings: &draw.settings, loss: Loss::L2, rates: &rates, binning };
            r.train_step(&mut cloud, &draw.view, &target, &step).unwrap();
        }
        let mut losses = Vec::new();
        r.losses(&mut cloud, Wait::All, &mut losses).unwrap();
        assert!(losses.len() == 24 && losses.iter().all(|loss| loss.is_finite()), "{kernels:?}: {losses:?}");
        r.download(&cloud).unwrap().validate().unwrap();
    }
}

#[test]
fn kernels_that_the_adapter_cannot_run_are_refused() {
    let found: Vec<Kernels> = rasterizers().iter().map(|&(kernels, _)| kernels).collect();
    assert_eq!(found[0], Kernels::Portable, "every adapter has these");
    for kernels in [Kernels::Subgroups, Kernels::Vectors] {
        match poisoned(Some(kernels)) {
            Ok(_) => assert!(found.contains(&kernels)),
            Err(error) => assert!(error.to_string().contains("subgroups"), "{error}"),
        }
    }
    if rasterizer().adapter().name.starts_with("llvmpipe") {
        assert_eq!(found.len(), 3, "lavapipe has subgroups of eight, so that all are tested");
    }
}

/// All numbers of a state as bits.
fn bits(state: &CloudState) -> BTreeMap<&str, Vec<u32>> {
    let of = |data: &TensorData| match data {
        TensorData::F32(values) => values.iter().map(|v| v.to_bits()).collect(),
        TensorData::U32(values) => values.clone(),
    };
    state.tensors.iter().map(|(name, tensor)| (name.as_str(), of(&tensor.data))).collect()
}

/// More Gaussians than a work group, and more entries than a sorting block and the first buffers hold.
fn many(blend: Blend) -> Draw {
    let mut draw = Draw::new(Kind::Large, blend, 2500, (173, 141), 42).on([0.1, 0.5, 0.3]);
    draw.settings.effects.statistics = Statistics::MeanGradient;
    draw
}

/// The state after so many steps, lists being made anew at every `rebin_every`th.
/// A gradient that is mere rounding must not become a whole step.
fn rates() -> AdamRates {
    Adam { epsilon: 1e-6, ..Adam::default() }.at(0.0)
}

fn trained<R: Rasterizer<PlanarScene>>(
    r: &R,
    draw: &Draw,
    loss: Loss,
    chart: Chart,
    (steps, rebin_every): (usize, usize),
) -> CloudState {
    let target = r.upload_target(&draw.target().unwrap()).unwrap();
    let mut cloud = r.upload(&draw.scene, chart).unwrap();
    let rates = rates();
    for i in 0..steps {
        let binning = if i % rebin_every == 0 { Binning::Fresh } else { Binning::Reuse };
        let step = TrainStep { settings: &draw.settings, loss, rates: &rates, binning };
        r.train_step(&mut cloud, &draw.view, &target, &step).unwrap();
    }
    r.save(&cloud).unwrap()
}

#[test]
fn repeats_itself_bit_for_bit() {
    let other = another();
    for (blend, loss, chart) in
        [(Blend::Sum, Loss::L2, Chart::LocalFrame), (Blend::Over, Loss::PAPER, Chart::ScaleRotation)]
    {
        let draw = many(blend);
        let image = |r: &WgpuRasterizer| r.render(&draw.scene, &draw.view, &draw.settings).unwrap();
        assert_eq!(image(rasterizer()).pixels(), image(&other).pixels(), "{blend:?}");
        let [one, two] = [rasterizer(), &other].map(|r| trained(r, &draw, loss, chart, (7, 3)));
        assert_eq!(bits(&one), bits(&two), "{blend:?}, {loss:?}");
        let six = trained(rasterizer(), &draw, loss, chart, (6, 3));
        assert_ne!(bits(&one), bits(&six), "a step changes nothing: the comparison cannot fail");
    }
}

/// A cloud that is trained on one device, and how.
struct Training<'r> {
    r: &'r WgpuRasterizer,
    draw: Draw,
    target: Target,
    cloud: PlanarCloud,
}

impl<'r> Training<'r> {
    fn new(r: &'r WgpuRasterizer, draw: Draw) -> Self {
        let target = r.planar().upload_target(&draw.target().unwrap()).unwrap();
        let cloud = r.upload(&draw.scene, Chart::LocalFrame).unwrap();
        Self { r, draw, target, cloud }
    }

    /// Sends a step that draws the Gaussians down to this α.
    fn try_send(&mut self, alpha_cut: f32, binning: Binning) -> Result<(), Error> {
        let mut settings = self.draw.settings;
        settings.accuracy.alpha_cut = alpha_cut;
        let rates = Adam { epsilon: 1e-6, ..Adam::default() }.at(0.0);
        let step = TrainStep { settings: &settings, loss: Loss::L2, rates: &rates, binning };
        self.r.train_step(&mut self.cloud, &self.draw.view, &self.target, &step)
    }

    fn send(&mut self, steps: usize) {
        (0..steps).for_each(|_| self.try_send(ALPHA_CUT, Binning::Fresh).unwrap());
    }

    fn losses(&mut self, wait: Wait) -> Vec<f32> {
        let mut losses = Vec::new();
        self.r.losses(&mut self.cloud, wait, &mut losses).unwrap();
        losses
    }
}

/// The bytes that `steps` training steps of `gaussians` move.
fn bytes_of_steps(gaussians: usize, steps: usize) -> u64 {
    let r = another();
    let mut training = Training::new(&r, Draw::new(Kind::Typical, Blend::Sum, gaussians, (120, 80), 3));
    // Buffers grow in the first.
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
fn a_training_step_waits_only_where_enough_are_under_way() {
    let r = another();
    let mut training = Training::new(&r, Draw::new(Kind::Typical, Blend::Over, 200, (120, 80), 3));
    training.send(1);
    training.losses(Wait::All);
    let waits = r.waits();
    for sent in 1..=STEPS_IN_FLIGHT {
        training.send(1);
        assert_eq!((training.cloud.steps_in_flight(), r.waits()), (sent, waits));
    }
    let one_by_one: u64 = (0..5)
        .map(|_| {
            let waits = r.waits();
            training.send(1);
            assert_eq!(training.cloud.steps_in_flight(), STEPS_IN_FLIGHT, "only the oldest is waited for");
            r.waits() - waits
        })
        .sum();
    assert!(one_by_one <= 5, "{one_by_one} waits for 5 steps");
    let waits = r.waits();
    let mut losses = training.losses(Wait::Arrived);
    assert_eq!(r.waits(), waits, "what has arrived is not waited for");
    losses.extend(training.losses(Wait::All));
    assert_eq!((losses.len(), training.cloud.steps_in_flight()), (STEPS_IN_FLIGHT + 5, 0));
    r.download(&training.cloud).unwrap();
    assert!(r.waits() > waits, "waits are not counted");
}

/// Losses, state and bytes moved after steps of which some need far more room than those before; `roomy` where there is room at once.
fn trained_with_room(blend: Blend, roomy: bool) -> (Vec<f32>, CloudState, u64) {
    let r = another();
    let draw = Draw::new(Kind::Large, blend, 800, (173, 141), 42).on([0.1, 0.5, 0.3]);
    if roomy {
        // Its buffers come into the pool, from which training takes them.
        r.render(&draw.scene, &draw.view, &draw.settings).unwrap();
    }
    let mut training = Training::new(&r, draw);
    let before = r.bytes_moved();
    let mut losses = Vec::new();
    // Under `Over` the first ones fit. Then lists are made for more entries, as those there are were made with another cut, and are used
    // again; all of that is under way when the host learns of it. Under `Sum` nothing fits.
    for (alpha_cut, fresh) in [(0.5, true), (0.5, false), (ALPHA_CUT, false), (ALPHA_CUT, false), (ALPHA_CUT, false)] {
        training.try_send(alpha_cut, if fresh { Binning::Fresh } else { Binning::Reuse }).unwrap();
    }
    losses.extend(training.losses(Wait::Arrived));
    for step in 0..6 {
        training.try_send(ALPHA_CUT, if step == 4 { Binning::Fresh } else { Binning::Reuse }).unwrap();
    }
    let state = r.save(&training.cloud).unwrap();
    losses.extend(training.losses(Wait::All));
    (losses, state, r.bytes_moved() - before)
}

#[test]
fn steps_that_have_to_be_sent_again_end_at_the_same_bits() {
    for blend in [Blend::Sum, Blend::Over] {
        let (losses, state, bytes) = trained_with_room(blend, true);
        let (again, found, more_bytes) = trained_with_room(blend, false);
        assert!(more_bytes > bytes, "{blend:?}: nothing was sent again");
        assert_eq!(losses.len(), 11);
        assert!(losses.iter().all(|&loss| loss > 0.0 && loss.is_finite()), "{losses:?}");
        let loss_bits = |losses: &[f32]| losses.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
        assert_eq!(loss_bits(&again), loss_bits(&losses), "{blend:?}");
        assert_eq!(bits(&found), bits(&state), "{blend:?}");
    }
}

/// What is seen of, or done to, a cloud whose last steps are still under way; gradients are of before.
type Look = fn(&mut Training<'_>, &PlanarGradients) -> Vec<f32>;

fn numbers(state: &CloudState) -> Vec<f32> {
    bits(state).into_values().flatten().map(f32::from_bits).collect()
}

const LOOKS: [(&str, Look); 7] = [
    ("save", |t, _| numbers(&t.r.save(&t.cloud).unwrap())),
    ("download", |t, _| t.r.download(&t.cloud).unwrap().colors.iter().flat_map(glam::Vec3::to_array).collect()),
    ("statistics", |t, _| t.r.statistics(&t.cloud).unwrap().gradient_sum),
    ("forward", |t, _| {
        let frame = t.r.forward(&t.cloud, &t.draw.view, &t.draw.settings).unwrap();
        t.r.image(&frame).unwrap().pixels().as_flattened().to_vec()
    }),
    ("step", |t, gradients| {
        t.r.step(&mut t.cloud, gradients, &Adam::default().at(0.0)).unwrap();
        numbers(&t.r.save(&t.cloud).unwrap())
    }),
    ("edit", |t, _| {
        let removed = vec![Removal { index: 3, cause: PruneCause::Unimportant }];
        t.r.edit(&mut t.cloud, &EditPlan { removed, statistics: AfterEdit::Keep, ..EditPlan::default() }).unwrap();
        numbers(&t.r.save(&t.cloud).unwrap())
    }),
    ("solve_colors", |t, _| {
        t.r.solve_colors(&mut t.cloud, &t.draw.view, &t.target, &t.draw.settings, 2).unwrap();
        numbers(&t.r.save(&t.cloud).unwrap())
    }),
];

/// What is seen after two steps, by their bits, and the bytes that it took to see it.
fn seen_after_two_steps(look: Look, roomy: bool) -> (Vec<u32>, u64) {
    let r = another();
    // Each of them touches every tile.
    let mut draw = Draw::new(Kind::Large, Blend::Sum, 1200, (160, 144), 43);
    draw.scene.log_scales.fill(glam::Vec2::splat(5.0));
    draw.settings.effects.statistics = Statistics::MeanGradient;
    if roomy {
        r.render(&draw.scene, &draw.view, &draw.settings).unwrap();
    }
    let mut training = Training::new(&r, draw);
    let Training { draw, target, cloud, .. } = &training;
    let elsewhere = draw.view.showing(glam::Vec2::splat(1e5), glam::Vec2::ONE);
    let frame = r.forward(cloud, &elsewhere, &draw.settings).unwrap();
    assert_eq!(frame.entries(), 0, "its buffers stay as small as they are");
    let (_, gradients) = r.backward(cloud, frame, target, &Loss::L2).unwrap();
    training.send(2);
    assert_eq!(training.cloud.steps_in_flight(), 2);
    let before = r.bytes_moved();
    let seen = look(&mut training, &gradients).into_iter().map(f32::to_bits).collect();
    assert_eq!(training.losses(Wait::Arrived).len(), 2);
    (seen, r.bytes_moved() - before)
}

#[test]
fn steps_that_have_to_be_sent_again_are_seen_by_everything() {
    for (what, look) in LOOKS {
        let (expected, bytes) = seen_after_two_steps(look, true);
        let (found, more_bytes) = seen_after_two_steps(look, false);
        assert!(more_bytes > bytes, "{what}: nothing was sent again");
        assert!(found == expected, "{what}");
    }
}

#[test]
fn a_cloud_can_be_dropped_with_steps_under_way() {
    let r = another();
    let draw = || Draw::new(Kind::Typical, Blend::Sum, 200, (120, 80), 3);
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
fn steps_under_way_on_a_lost_device_are_an_error_later() {
    for wait in [Wait::Arrived, Wait::All] {
        let r = another();
        let mut training = Training::new(&r, Draw::new(Kind::Typical, Blend::Sum, 200, (120, 80), 3));
        training.send(3);
        r.lose_device();
        for _ in 0..2 {
            let outcomes = [
                r.losses(&mut training.cloud, wait, &mut Vec::new()).unwrap_err(),
                training.try_send(ALPHA_CUT, Binning::Fresh).unwrap_err(),
                r.statistics(&training.cloud).unwrap_err(),
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
    let draw = Draw::new(Kind::Typical, Blend::Sum, 20, (40, 30), 5);
    let image = draw.target().unwrap();
    let target = r.planar().upload_target(&image).unwrap();
    let mut cloud = r.upload(&draw.scene, Chart::LocalFrame).unwrap();
    r.lose_device();
    let rates = Adam::default().at(0.0);
    let step = TrainStep { settings: &draw.settings, loss: Loss::L2, rates: &rates, binning: Binning::Fresh };
    let outcomes = [
        r.train_step(&mut cloud, &draw.view, &target, &step).err(),
        r.losses(&mut cloud, Wait::All, &mut Vec::new()).err(),
        r.download(&cloud).err(),
        r.save(&cloud).err(),
        r.upload(&draw.scene, Chart::LocalFrame).err(),
        r.planar().upload_target(&image).err(),
        r.forward(&cloud, &draw.view, &draw.settings).err(),
    ];
    for (call, error) in outcomes.into_iter().enumerate() {
        assert!(
            matches!(&error, Some(Error::Backend { backend: "wgpu", message }) if message.contains("lost")),
            "call {call}: {error:?}"
        );
    }
}

#[test]
fn an_adapter_is_found_by_its_name_or_not_at_all() {
    let first = adapters().remove(0);
    let by_name =
        |name: &str| WgpuRasterizer::new(WgpuSettings { adapter: Some(name.to_owned()), ..WgpuSettings::default() });
    assert_eq!(by_name(&first.name.to_uppercase()).unwrap().adapter(), &first);
    let error = by_name("no such adapter").unwrap_err().to_string();
    assert!(error.contains("no such adapter") && error.contains(&first.name), "{error}");
}

#[test]
fn what_does_not_fit_is_refused_with_numbers() {
    let r = another();
    let huge: PlanarScene =
        std::iter::repeat_n(Draw::new(Kind::Large, Blend::Sum, 1, (16, 16), 1).scene.gaussian(0), 40_000).collect();
    let mut huge = huge;
    huge.log_scales.iter_mut().for_each(|s| *s = glam::Vec2::splat(9.0));
    let error = r
        .render(&huge, &gs_core::Canvas::new(4000, 4000), &RenderSettings::blended(Blend::Sum))
        .unwrap_err()
        .to_string();
    assert!(error.contains("MiB") && error.contains(&r.adapter().name), "{error}");
    if r.adapter().kind == "CPU" {
        let error = r.render(&huge, &gs_core::Canvas::new(4096, 4096), &RenderSettings::blended(Blend::Sum));
        let error = error.unwrap_err().to_string();
        assert!(error.contains("4096x4096") && error.contains("CPU backend"), "{error}");
    }
}

/// A scene in which there is nothing to compare counts as rejected, of which there may be only so many.
fn judge<T>(result: Result<T, Failure>) -> Result<(), TestCaseError> {
    match result {
        Ok(_) => Ok(()),
        Err(Failure::Nothing(text)) => Err(TestCaseError::reject(text)),
        Err(failure) => Err(TestCaseError::fail(failure.to_string())),
    }
}

fn repeatable(cases: u32) -> ProptestConfig {
    ProptestConfig {
        cases,
        max_global_rejects: cases / 2,
        rng_seed: RngSeed::Fixed(2027),
        failure_persistence: None,
        max_shrink_iters: 100,
        ..ProptestConfig::default()
    }
}

fn losses() -> impl Strategy<Value = Loss> {
    prop_oneof![Just(Loss::L2), Just(Loss::L1), (0.0f32..=1.0).prop_map(|lambda| Loss::L1Dssim { lambda })]
}

fn cpu() -> CpuRasterizer {
    CpuRasterizer::new(CpuSettings { threads: Some(2), level: None }).unwrap()
}

/// How far apart (root mean square) the images of two training runs may end, as a share of how far training moved them. Worst measured
/// of 24 runs: 0.0095 with L1, whose gradient turns its sign where two images cross the target at other pixels; gs-cpu's scalar and
/// AVX-512 kernels end as far apart (0.0107). Lists are made anew at every step: what reused ones miss depends on the tiles.
const MOST_APART: f32 = 0.03;

#[test]
fn runs_of_other_lengths_are_further_apart_than_that() {
    for loss in [Loss::L2, Loss::L1] {
        let draw = Draw::new(Kind::Typical, Blend::Sum, 40, (48, 40), 285);
        let before = rasterizer().render(&draw.scene, &draw.view, &draw.settings).unwrap();
        let [long, short] =
            [50, 20].map(|steps| image_of(&cpu(), &trained(&cpu(), &draw, loss, Chart::LocalFrame, (steps, 1)), &draw));
        let (apart, moved) = (root_mean_square(&long, &short), root_mean_square(&long, &before));
        assert!(apart > MOST_APART * moved, "{loss:?}: {apart} apart after moving by {moved}");
    }
}

/// The image of a state.
fn image_of<R: Rasterizer<PlanarScene>>(r: &R, state: &CloudState, draw: &Draw) -> Image {
    let cloud = r.restore(state).unwrap();
    r.image(&r.forward(&cloud, &draw.view, &draw.settings).unwrap()).unwrap()
}

fn root_mean_square(a: &Image, b: &Image) -> f32 {
    let squares = a.pixels().iter().flatten().zip(b.pixels().iter().flatten()).map(|(a, b)| (a - b).powi(2));
    (squares.sum::<f32>() / (3 * a.pixels().len()) as f32).sqrt()
}

/// What the oracle's gradients and its Adam make of a scene in as many steps as [`trained`] does.
fn trained_by_oracle(draw: &Draw, loss: Loss, steps: usize) -> Image {
    let oracle = Oracle::new(draw.view, draw.settings).unwrap();
    let target = draw.target().unwrap();
    let mut adam = AdamReference::new(OracleScene::from(&draw.scene));
    for _ in 0..steps {
        let gradients = oracle.gradients(&adam.scene, &target, &loss).unwrap();
        adam.step(&gradients.values, &rates());
    }
    oracle.render(&adam.scene).image()
}

proptest! {
    #![proptest_config(repeatable(100))]

    /// Rounding grows in training, so that images are compared, not parameters.
    #[test]
    fn fifty_steps_end_at_the_same_image_on_both_backends_and_by_the_oracle(
        seed in 0u64..1000,
        blend in prop_oneof![Just(Blend::Sum), Just(Blend::Over)],
        loss in losses(),
        local in any::<bool>(),
    ) {
        let draw = Draw::new(Kind::Typical, blend, 40, (48, 40), seed);
        let chart = if local { Chart::LocalFrame } else { Chart::ScaleRotation };
        let gpus = rasterizers();
        let (_, gpu) = &gpus[seed as usize % gpus.len()];
        let mut images = [
            image_of(gpu, &trained(gpu, &draw, loss, chart, (50, 1)), &draw),
            image_of(&cpu(), &trained(&cpu(), &draw, loss, chart, (50, 1)), &draw),
        ].to_vec();
        if !local {
            images.push(trained_by_oracle(&draw, loss, 50));
        }
        let before = gpu.render(&draw.scene, &draw.view, &draw.settings).unwrap();
        let moved = root_mean_square(&images[0], &before);
        prop_assert!(moved > 1e-3, "training moved the image by {moved} only");
        for (one, other) in [(0, 1), (0, 2), (1, 2)] {
            let Some(other) = images.get(other) else { continue };
            let apart = root_mean_square(&images[one], other);
            prop_assert!(apart < MOST_APART * moved, "{apart} apart after moving by {moved}");
        }
    }
}

proptest! {
    #![proptest_config(repeatable(300))]

    #[test]
    fn drawn_images_match(draw in draws()) {
        for (_, rasterizer) in rasterizers() {
            judge(check_image(rasterizer, &draw))?;
        }
    }

    #[test]
    fn drawn_gradients_match(draw in draws(), loss in losses(), local in any::<bool>()) {
        let chart = if local { Chart::LocalFrame } else { Chart::ScaleRotation };
        for (_, rasterizer) in rasterizers() {
            judge(check_gradients(rasterizer, &draw, &loss, chart))?;
        }
    }
}
