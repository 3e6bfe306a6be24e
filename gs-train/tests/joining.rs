//! Effects join a training when they are called for, and not before: harmonics where colours depend on the view, antialiasing where Gaussians
//! become narrower than a pixel. A run that is stopped before a joining ends bit for bit as one that never was.

#[allow(dead_code)]
mod space;

use glam::Vec3;
use gs_conformance::bits::bits;
use gs_core::{
    Blend, Effects, Image, Rasterizer, Scene, Scene3d, SplatsState,
    effects::{Antialias, Order},
};
use gs_density::Policy;
use gs_train::{
    Calls, Control, FitSettings, InitialCount, Joined, Joining, MetricsLog, Observer, Progress, Rounds, TrainSettings,
    Trainer, Trainer3d,
    train::{PosedView, Start, Views},
};
use space::{camera, rasterizer, render, short, thirty};

/// The thirty Gaussians with harmonics of degree 1 of this strength.
fn shimmering(strength: f32) -> Scene3d {
    let plain = thirty();
    let mut scene = Scene3d { sh_degree: 1, ..Scene3d::default() };
    for index in 0..plain.len() {
        let mut gaussian = plain.gaussian(index);
        let turned = |k: usize| strength * Vec3::from_array([0, 1, 2].map(|c| ((7 * index + 3 * k + c) as f32).sin()));
        gaussian.sh = [gaussian.sh[0]].into_iter().chain((0..3).map(turned)).collect();
        scene.push(gaussian);
    }
    scene
}

/// Twenty views of a scene, two of them held out.
fn views_of(scene: &Scene3d) -> Views {
    let rasterizer = rasterizer();
    let mut render = render();
    render.effects.sh_degree = 1;
    let view = |i: usize| {
        let image = rasterizer.render(scene, &camera(i), &render).expect("the scene can be rendered");
        PosedView::of_image(format!("view-{i:02}"), camera(i), image.clamped())
    };
    Views::new((0..18).map(view).collect(), (18..20).map(view).collect())
}

/// From the thirty Gaussians as they are without harmonics, of slightly wrong colours, so that there is something to learn.
fn start() -> Start {
    let mut scene = thirty();
    scene.sh.iter_mut().enumerate().for_each(|(i, color)| *color += 0.05 * (i as f32).sin());
    Start::Scene(scene)
}

/// Only colours are learnt: residuals of shapes that are wrong depend on the view, too.
fn settings() -> TrainSettings {
    let mut settings = TrainSettings { policy: Policy::None, sh_degree_every: 80, ..short(200) };
    let adam = &mut settings.adam;
    for group in [&mut adam.mean, &mut adam.scale, &mut adam.rotation, &mut adam.opacity] {
        group.learning_rate = 0.0;
    }
    adam.color.learning_rate = 5e-3;
    settings.joining = Joining::WhenCalledFor(Calls { every: 20, ..Calls::default() });
    settings
}

/// Remembers what it was told.
#[derive(Default)]
struct Told(Vec<(u32, Joined)>);

impl Observer for Told {
    fn on_join(&mut self, progress: &Progress, joined: &Joined) {
        assert_eq!(progress.joined, *joined);
        self.0.push((progress.step, *joined));
    }
}

#[test]
fn sh_join_where_colours_depend_on_the_view_and_nowhere_else() {
    let rasterizer = rasterizer();
    let trained = |strength: f32| {
        let views = views_of(&shimmering(strength));
        let mut trainer = Trainer3d::from_views(&rasterizer, views, start(), settings()).unwrap();
        let (mut told, mut log) = (Told::default(), MetricsLog::new(1_000));
        trainer.run(&mut (&mut told, &mut log)).unwrap();
        let rows: Vec<(u32, Joined)> =
            log.rows().iter().filter(|row| !row.joined.is_empty()).map(|row| (row.step, row.joined)).collect();
        assert_eq!(rows, told.0, "the table tells what was told");
        assert_eq!(trainer.joins().joins.iter().map(|join| (join.step, join.joined)).collect::<Vec<_>>(), rows);
        (rows, trainer.effects().sh_degree, trainer.scene().unwrap())
    };
    let (none, degree, scene) = trained(0.0);
    assert_eq!((none, degree), (vec![], 0));
    assert!(scene.sh.chunks_exact(scene.sh_len()).all(|of_one| of_one[1..].iter().all(|&c| c == Vec3::ZERO)));

    let (joins, degree, scene) = trained(0.5);
    let [(step, Joined { harmonics: Some(join), antialias: None })] = joins[..] else { panic!("{joins:?}") };
    assert_eq!((step % 80, join.degree, degree), (0, 1, 1));
    assert!(join.explains.unwrap() > 0.2, "{join:?}");
    assert!(scene.sh.chunks_exact(scene.sh_len()).any(|of_one| of_one[1] != Vec3::ZERO));
}

#[test]
fn what_the_first_scene_has_is_there_from_the_first_step() {
    let rasterizer = rasterizer();
    let scene = shimmering(0.5);
    let mut trainer = Trainer3d::from_views(&rasterizer, views_of(&scene), Start::Scene(scene), settings()).unwrap();
    let progress = trainer.step_once().unwrap();
    assert_eq!(progress.joined.harmonics.map(|join| (join.degree, join.explains)), Some((1, None)));
    assert_eq!(trainer.effects().sh_degree, 1);
}

#[test]
fn by_the_clock_nothing_is_asked() {
    let rasterizer = rasterizer();
    let settings = TrainSettings { joining: Joining::Scheduled, ..settings() };
    let mut trainer = Trainer3d::from_views(&rasterizer, views_of(&thirty()), start(), settings.clone()).unwrap();
    trainer.run(&mut ()).unwrap();
    assert!(trainer.joins().joins.is_empty());
    assert_eq!(trainer.effects().sh_degree, settings.render.effects.sh_degree);
}

/// Stripes and dots of one pixel.
fn fine() -> Image {
    Image::from_fn(40, 32, |x, y| {
        let on = if y < 16 { x % 3 == 0 } else { x % 4 == 1 && y % 4 == 2 };
        if on { [0.9, 0.8, 0.1] } else { [0.1, 0.2, 0.4] }
    })
    .unwrap()
}

fn fitted(target: &Image, mut settings: FitSettings) -> (Vec<(u32, Joined)>, Effects) {
    let rasterizer = rasterizer();
    settings.render.effects.antialias = Antialias::Mip;
    settings.joining = Joining::WhenCalledFor(Calls { every: 10, ..Calls::default() });
    let mut trainer = Trainer::new(&rasterizer, target, settings).unwrap();
    let mut told = Told::default();
    trainer.run(&mut told).unwrap();
    assert_eq!(trainer.shown().effects, trainer.effects());
    (told.0, trainer.effects())
}

#[test]
fn an_image_of_fine_detail_gets_antialiasing_and_a_smooth_one_does_not() {
    let settings = |gaussians| FitSettings::for_image(gaussians, (40, 32), 60);
    let (joins, effects) = fitted(&fine(), settings(300));
    let [(step, Joined { harmonics: None, antialias: Some(join) })] = joins[..] else { panic!("{joins:?}") };
    assert!(step < 60 && join.antialias == Antialias::Mip, "{step} {join:?}");
    assert!(join.narrow * 100 > join.shown && join.shown <= 300, "{join:?}");
    assert_eq!(effects.antialias, Antialias::Mip);

    let smooth = Image::from_fn(40, 32, |x, y| [x as f32 / 40.0, y as f32 / 32.0, 0.5]).unwrap();
    // None are put where the residual is, which begin narrow.
    let large = FitSettings { policy: Policy::None, initial: InitialCount::Fixed(12), ..settings(12) };
    let (joins, effects) = fitted(&smooth, large);
    assert_eq!((joins, effects.antialias), (vec![], Antialias::None));
}

/// Stops at the given steps.
struct StopAt(Vec<u32>);

impl Observer for StopAt {
    fn on_step(&mut self, progress: &Progress) -> Control {
        if self.0.contains(&progress.step) { Control::Stop } else { Control::Continue }
    }
}

#[test]
fn a_training_that_is_resumed_around_a_joining_ends_bit_identical() {
    let first = rasterizer();
    let views = || views_of(&shimmering(0.5));
    let mut settings = settings();
    settings.render.effects.antialias = Antialias::Dilate;
    let mut whole = Trainer3d::from_views(&first, views(), start(), settings.clone()).unwrap();
    whole.run(&mut ()).unwrap();
    let steps: Vec<u32> = whole.joins().joins.iter().map(|join| join.step).collect();
    assert!(!steps.is_empty());

    // Before, at and after each.
    let mut stops = StopAt(steps.iter().flat_map(|&step| [step.max(1) - 1, step, step + 1]).collect());
    let mut checkpoint = Trainer3d::from_views(&first, views(), start(), settings).unwrap().checkpoint().unwrap();
    let state: SplatsState = loop {
        let other = rasterizer();
        let mut trainer = Trainer3d::resume_views(&other, views(), checkpoint).unwrap();
        trainer.run(&mut stops).unwrap();
        checkpoint = trainer.checkpoint().unwrap();
        if trainer.is_finished() {
            assert_eq!(trainer.joins(), whole.joins());
            break checkpoint.state;
        }
    };
    assert_eq!(bits(&state), bits(&whole.checkpoint().unwrap().state));
}

#[test]
fn a_fit_that_is_resumed_around_a_joining_ends_bit_identical() {
    let settings = FitSettings {
        joining: Joining::WhenCalledFor(Calls { every: 7, ..Calls::default() }),
        rounds: Rounds::until(10, 30),
        ..FitSettings::for_image(300, (40, 32), 40)
    };
    let settings = {
        let mut antialiased = settings;
        antialiased.render.effects.antialias = Antialias::Mip;
        antialiased
    };
    assert_eq!(settings.render.effects.blend, Blend::Sum);
    assert_eq!(settings.render.effects.order, Order::Index);
    let (first, target) = (rasterizer(), fine());
    let mut whole = Trainer::new(&first, &target, settings.clone()).unwrap();
    whole.run(&mut ()).unwrap();
    let joined = whole.joins().joins[0].step;
    let mut trainer = Trainer::new(&first, &target, settings).unwrap();
    trainer.run(&mut StopAt(vec![joined.max(1)])).unwrap();
    assert!(!trainer.is_finished());
    let checkpoint = trainer.checkpoint().unwrap();
    let other = rasterizer();
    let mut resumed = Trainer::resume(&other, &target, checkpoint).unwrap();
    resumed.run(&mut ()).unwrap();
    assert_eq!(bits(&resumed.checkpoint().unwrap().state), bits(&whole.checkpoint().unwrap().state));
}
