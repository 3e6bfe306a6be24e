//! Floaters: Gaussians that hang in front of what the training views show.

use std::fmt;

use gs_core::{
    AdamRates, Binning, Loss, Optimizer, Parameterization, Participants, Penalty, RenderSettings, Scene as _, Scene3d,
    TrainStep, adam::Rate, counted, examination::Examinable as _, metrics::mean,
};

use super::evidence::{contribution, harm, in_front};
use crate::{
    error::Error,
    train::{PosedView, Views, measure},
    views::images,
};

/// A Gaussian hangs in front if it is nearer to the cameras than what they show by more than this share of the depth.
const IN_FRONT: f32 = 0.1;

/// Number of rounds. The first takes the depth from the fitted opacities; later ones leave out the Gaussians that
/// were found to do harm.
const ROUNDS: usize = 3;

/// Steps that fit the opacities, for each view; and the fewest and the most of them.
const STEPS_A_VIEW: usize = 6;
const STEPS: (usize, usize) = (600, 1200);

/// Adam's step of a logit. A floater becomes transparent within 30 steps that show it.
const LEARNING_RATE: f32 = 0.2;

/// Largest logit with which the evidence is gathered: gradients by a larger one vanish in 32 bits.
const MOST_LOGIT: f32 = 8.0;

/// Sets of Gaussians that are tried to meet the limit of the loss.
const TRIALS: usize = 8;

/// The floaters of a scene. The text says how many there are and why.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Floaters {
    /// Which Gaussians stay, `[N]`.
    pub keep: Vec<bool>,
    /// Number of removed Gaussians that make the images of the training views worse.
    pub harmful: usize,
    /// Number of further Gaussians that are removed because the training views do not need them.
    pub needless: usize,
    /// Number of Gaussians that hang in front, too, but stay, because the training views need them.
    pub needed: usize,
    /// Mean PSNR over the training views before and after, dB.
    pub psnr: [f64; 2],
    /// Mean PSNR over the held-out views before and after, dB; `None` without such views.
    pub held_out: Option<[f64; 2]>,
}

impl fmt::Display for Floaters {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { keep, harmful, needless, needed, psnr: [before, after], held_out } = self;
        write!(
            f,
            "removed {} of {} in front of what the training views show (worse with them: {harmful}, no better: {needless}); \
             kept as needed: {needed}; PSNR over the training views {before:.2} dB before, {after:.2} dB after",
            counted(harmful + needless, "Gaussian"),
            keep.len(),
        )?;
        held_out.map_or(Ok(()), |[before, after]| write!(f, "; over the held-out views {before:.2} dB, {after:.2} dB"))
    }
}

impl Floaters {
    /// Finds floaters in a scene that is rendered with these settings.
    ///
    /// 1. The opacities, alone, are trained for a while: what the views contradict becomes transparent.
    /// 2. Floaters hang in front of what the views then show, in the mean of the views that they are not hidden from.
    ///    This is repeated without those that do harm.
    /// 3. They are removed in the order of the harm that each does to the squared error over the training views, as
    ///    long as the PSNR stays within `most_loss` dB of the better of two: before, and without those that do harm.
    ///
    /// # Errors
    /// [`Error::NothingSeen`] where the views show nothing of the scene; [`gs_core::Error::Setting`] for a `most_loss`
    /// below 0; those of the backend and of reading images.
    pub async fn find<R: Optimizer<Scene3d>>(
        on: &R,
        scene: &Scene3d,
        views: &Views,
        render: &RenderSettings,
        most_loss: f64,
    ) -> Result<Self, Error> {
        gs_core::Error::within("the loss of floaters", most_loss, 0.0.., "at least 0 dB")?;
        views.validate()?;
        let train = &views.train;
        let mut soft = scene.clone();
        soft.opacity_logits.iter_mut().for_each(|logit| *logit = logit.min(MOST_LOGIT));
        contribution(on, scene, train, render).await?;
        let mut shown = fitted(on, &soft, train, render).await?;
        let (mut front, mut damage) = (vec![false; scene.len()], Vec::new());
        for _ in 0..ROUNDS {
            let share = in_front(on, &soft, &shown, train, render).await?;
            front.iter_mut().zip(share).for_each(|(front, share)| *front |= share > IN_FRONT);
            damage = harm(on, &soft, &shown, &front, train, render).await?;
            // What the views need is part of what they show.
            shown = soft.clone();
            for index in (0..scene.len()).filter(|&index| damage[index] > 0.0) {
                shown.opacity_logits[index] = f32::NEG_INFINITY;
            }
        }
        let mut ranked: Vec<usize> = (0..scene.len()).filter(|&index| front[index]).collect();
        ranked.sort_by(|a, b| damage[*b].total_cmp(&damage[*a]));
        let harmful = ranked.partition_point(|index| damage[*index] > 0.0);
        let before = psnr(on, scene, train, render).await?;
        let (gone, after) = within(most_loss, before, [harmful, ranked.len()], async |gone| {
            psnr(on, &without(scene, &ranked[..gone]).0, train, render).await
        })
        .await?;
        let (after_scene, keep) = without(scene, &ranked[..gone]);
        let held_out = match views.test.is_empty() {
            true => None,
            false => {
                let test = &views.test;
                Some([psnr(on, scene, test, render).await?, psnr(on, &after_scene, test, render).await?])
            }
        };
        let (harmful, needless) = (gone.min(harmful), gone.saturating_sub(harmful));
        Ok(Self { keep, harmful, needless, needed: ranked.len() - gone, psnr: [before, after], held_out })
    }
}

/// The largest of the counts tried up to `most`, and the PSNR there, at which the PSNR is within `loss` of the better of
/// those at 0, which is `before`, and at `likely`.
async fn within(
    loss: f64,
    before: f64,
    [likely, most]: [usize; 2],
    psnr_at: impl AsyncFn(usize) -> Result<f64, Error>,
) -> Result<(usize, f64), Error> {
    let at_likely = if likely == 0 { before } else { psnr_at(likely).await? };
    let least = before.max(at_likely) - loss;
    let (mut low, mut high) = if at_likely >= least { ((likely, at_likely), most) } else { ((0, before), likely - 1) };
    let mut count = high;
    for _ in 0..TRIALS {
        if count <= low.0 {
            break;
        }
        match psnr_at(count).await? {
            psnr if psnr >= least => low = (count, psnr),
            _ => high = count - 1,
        }
        count = low.0 + (high - low.0).div_ceil(2);
    }
    Ok(low)
}

/// The scene without some Gaussians, and which stay.
fn without(scene: &Scene3d, gone: &[usize]) -> (Scene3d, Vec<bool>) {
    let mut keep = vec![true; scene.len()];
    gone.iter().for_each(|&index| keep[index] = false);
    let mut left = scene.clone();
    left.retain(&keep);
    (left, keep)
}

/// The scene with opacities that fit the views better, and all else as it was.
async fn fitted<R: Optimizer<Scene3d>>(
    on: &R,
    scene: &Scene3d,
    views: &[PosedView],
    render: &RenderSettings,
) -> Result<Scene3d, Error> {
    let rate = |learning_rate| Rate { learning_rate, beta1: 0.9, beta2: 0.99 };
    let rates = AdamRates {
        mean: rate(0.0),
        scale: rate(0.0),
        rotation: rate(0.0),
        opacity: rate(LEARNING_RATE),
        color: rate(0.0),
        color_rest: rate(0.0),
        color_rest_moments: Default::default(),
        epsilon: 1e-15,
        min_scale: f32::MIN_POSITIVE,
        max_scale: f32::MAX,
        participants: Participants::Visible,
        penalty: Penalty::NONE,
        fixed: 0,
    };
    let mut splats = on.upload(scene, Parameterization::ScaleRotation)?;
    let step = TrainStep { settings: render, loss: Loss::PAPER, rates: &rates, binning: Binning::Fresh };
    let steps = (STEPS_A_VIEW * views.len()).clamp(STEPS.0, STEPS.1);
    // A step of the golden section visits all views evenly, and neighbours far apart in time.
    let stride = (0.618 * views.len() as f64).round() as usize;
    let stride = (stride..).find(|&stride| is_coprime(stride, views.len())).unwrap_or(1);
    for number in 0..steps {
        let view = &views[number * stride % views.len()];
        let (target, _) = images::target(on, view.image()?, render.background_color(), true)?;
        on.train_step(&mut splats, &view.camera, &target, &step).await?;
    }
    Ok(on.download(&splats).await?)
}

fn is_coprime(a: usize, b: usize) -> bool {
    if b == 0 { a == 1 } else { is_coprime(b, a % b) }
}

/// Mean PSNR of a scene over views of which some pixel counts, dB.
async fn psnr<R: Optimizer<Scene3d>>(
    on: &R,
    scene: &Scene3d,
    views: &[PosedView],
    render: &RenderSettings,
) -> Result<f64, Error> {
    let splats = on.upload(scene, Parameterization::ScaleRotation)?;
    let mut found = Vec::new();
    for view in views {
        let (image, _) = on.draw(&splats, &view.camera, render).await?;
        if let Some(pair) = measure(&image, view.image()?, render.background_color())? {
            found.push(pair.l1_and_psnr()?.1);
        }
    }
    if found.is_empty() { Err(Error::NothingCounts { views: views.len() }) } else { Ok(mean(found)) }
}
