//! What effects change in a scene's pictures and what they cost in time, on any backend. Renderings
//! prove the bounds behind [`Effects::required`], and each effect is timed.

use std::{cmp::Ordering, fmt};

use gs_core::{
    Effects, Error, Rasterizer, RenderSettings,
    constants::HALF_DISPLAY_STEP,
    counted,
    effects::{Effect, EffectDecision, RequiredEffects, RequiresEffects},
};
use serde::Serialize;

use super::{
    Loaded, Renderer,
    noise::Noise,
    picture_error::PictureError,
    timing::{Rounds, Timed, interleaved},
};
use crate::{
    report::{Cell, Table},
    result::median,
};

/// The effects that a scene requires, and what each costs.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct EffectPrices {
    /// The required effects.
    pub(super) proof: Proof,
    /// The costs.
    pub(super) prices: Prices,
}

/// The required effects, with the measured difference that leaving out the others makes.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(super) struct Proof {
    /// The result of [`Effects::required`], to which effects are added whose absence changed a
    /// picture.
    pub(super) required: RequiredEffects,
    /// The difference between pictures with the required effects and with all wanted effects.
    pub(super) difference: PictureError,
    /// Number of views that were rendered both ways.
    pub(super) views: usize,
}

/// The cost of all effects of some settings.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(super) struct Prices {
    /// Median time of a picture with all wanted effects, ms.
    pub(super) milliseconds: f64,
    /// Median time of a picture with the required effects only, ms.
    pub(super) required_milliseconds: f64,
    /// Differences below this are not significant, ms.
    pub(super) noise: f64,
    /// The cost of each enabled effect.
    pub(super) each: Vec<Price>,
}

/// The cost of an effect.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(super) struct Price {
    /// The effect.
    pub(super) effect: Effect,
    /// The effect's value in the wanted settings.
    pub(super) value: &'static str,
    /// The next cheaper value, which it is compared with.
    pub(super) cheaper: &'static str,
    /// The extra time of a picture, ms: the median over rounds of the difference within a round.
    pub(super) milliseconds: f64,
    /// The extra time as a share of the time of a picture with all effects.
    pub(super) share: f64,
    /// The difference between pictures with and without the effect.
    pub(super) change: PictureError,
}

/// Decides which effects of the `wanted` settings a scene requires in these views, verifies that by
/// rendering, and measures what each effect costs, in so many `rounds`.
///
/// If pictures with the required and with all effects differ visibly, the effect that causes the
/// difference is required, too.
///
/// # Errors
/// Those of [`Rasterizer::forward`]; [`Error::Setting`] without a view.
pub fn effect_prices<S: RequiresEffects, R: Rasterizer<S>>(
    rasterizer: &R,
    scene: &S,
    views: &[S::View],
    wanted: &RenderSettings,
    rounds: usize,
) -> Result<EffectPrices, Error> {
    Error::within("the number of views", views.len(), 1.., "at least 1")?;
    let seen = Seen { renderer: &Loaded::new(rasterizer, scene)?, views };
    let proof = seen.borne_out(Effects::required(scene, views, wanted)?, wanted)?;
    let prices = seen.prices(wanted, &proof.required.settings, rounds)?;
    Ok(EffectPrices { proof, prices })
}

/// An uploaded scene, and views of it.
struct Seen<'a, V> {
    renderer: &'a dyn Renderer<V>,
    views: &'a [V],
}

impl<V> Seen<'_, V> {
    /// The differences between the pictures with `wanted` settings and those with each of the
    /// `others`. Works view by view, so that at most two pictures are in memory.
    fn differences(&self, wanted: &RenderSettings, others: &[RenderSettings]) -> Result<Vec<PictureError>, Error> {
        let mut errors = vec![Vec::with_capacity(self.views.len()); others.len()];
        for view in self.views {
            let expected = self.renderer.image(view, wanted)?;
            for (settings, errors) in others.iter().zip(&mut errors) {
                errors.push(PictureError::between(&self.renderer.image(view, settings)?, &expected)?);
            }
        }
        Ok(errors.iter().map(|views| PictureError::of_views(views)).collect())
    }

    /// While pictures differ visibly, restores the effect that reduces the difference most, found by
    /// restoring each alone.
    fn borne_out(&self, mut required: RequiredEffects, wanted: &RenderSettings) -> Result<Proof, Error> {
        let mut difference = self.differences(wanted, &[required.settings])?[0];
        while difference.max > f64::from(HALF_DISPLAY_STEP) {
            let left = required.settings.effects;
            let is_out = |effect: &Effect| effect.value(&left) != effect.value(&wanted.effects);
            let out: Vec<Effect> = Effect::ALL.into_iter().filter(is_out).collect();
            let with = |effect: &Effect| required.settings.with(|s| s.effects = effect.copied(&wanted.effects, &left));
            let restored: Vec<RenderSettings> = out.iter().map(with).collect();
            let found = self.differences(wanted, &restored)?;
            let size = |at: &usize| (found[*at].max, found[*at].mean_squared);
            let Some(guilty) = (0..out.len()).min_by(|a, b| size(a).partial_cmp(&size(b)).unwrap_or(Ordering::Equal))
            else {
                break;
            };
            let reason = format!("without it, a pixel changes by {:.4}, which was not foreseen", difference.max);
            for verdict in required.decisions.iter_mut().filter(|verdict| verdict.effect == out[guilty]) {
                *verdict = EffectDecision::new(out[guilty], &wanted.effects, &wanted.effects, reason.clone());
            }
            (required.settings, difference) = (restored[guilty], found[guilty]);
        }
        Ok(Proof { required, difference, views: self.views.len() })
    }

    /// Measures the cost of the effects of the `wanted` settings, and the time with the `required`
    /// settings, in turn.
    fn prices(&self, wanted: &RenderSettings, required: &RenderSettings, rounds: usize) -> Result<Prices, Error> {
        let cheaper: Vec<(Effect, Effects)> =
            Effect::ALL.into_iter().filter_map(|effect| Some((effect, effect.cheaper(&wanted.effects)?))).collect();
        let without = cheaper.iter().map(|(_, effects)| wanted.with(|s| s.effects = *effects));
        let settings: Vec<RenderSettings> = [*wanted, *required, *wanted].into_iter().chain(without).collect();
        let candidate = |&settings: &RenderSettings| Timed { renderer: self.renderer, group: "", settings };
        let candidates: Vec<Timed<'_, V>> = settings.iter().map(candidate).collect();
        let times = interleaved(&candidates, self.views, Rounds::Exactly(rounds))?;
        let milliseconds = 1e3 * median(times[0].iter().chain(&times[2]));
        let changes = self.differences(wanted, &settings[3..])?;
        let price = |(at, ((effect, effects), change)): (usize, (&(Effect, Effects), PictureError))| {
            let saved = times[0].iter().zip(&times[3 + at]).map(|(with, without)| 1e3 * (with - without));
            let (value, cheaper) = (effect.value(&wanted.effects), effect.value(effects));
            let saved = median(saved);
            Price { effect: *effect, value, cheaper, milliseconds: saved, share: saved / milliseconds, change }
        };
        Ok(Prices {
            milliseconds,
            // Equal settings have equal times; two measurements of them would differ by chance.
            required_milliseconds: if required == wanted { milliseconds } else { 1e3 * median(&times[1]) },
            noise: milliseconds * (Noise::of(&times[0], &times[2]).factor - 1.0),
            each: cheaper.iter().zip(changes).enumerate().map(price).collect(),
        })
    }
}

impl EffectPrices {
    /// A row for each effect.
    fn table(&self) -> Table {
        let columns = ["effect", "wanted", "required", "cost, ms", "%", "instead", "max error", "PSNR, dB", "why"];
        let row = |EffectDecision { effect, wanted, value, reason, .. }: &EffectDecision| {
            let price = self.prices.each.iter().find(|price| price.effect == *effect);
            let of = |cell: fn(&Price) -> Cell| price.map_or(Cell::Empty, cell);
            vec![
                effect.name().into(),
                (*wanted).into(),
                (*value).into(),
                of(|price| Cell::Fixed(price.milliseconds, 2)),
                of(|price| Cell::Fixed(100.0 * price.share, 0)),
                of(|price| price.cheaper.into()),
                of(|price| Cell::Fixed(price.change.max, 4)),
                of(|price| Cell::Fixed(price.change.psnr, 1)),
                reason.as_str().into(),
            ]
        };
        Table::new("effects", "", &columns, self.proof.required.decisions.iter().map(row).collect())
    }
}

/// The table with the times of pictures below it.
impl fmt::Display for EffectPrices {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (Prices { milliseconds, required_milliseconds, noise, .. }, proof) = (&self.prices, &self.proof);
        write!(
            f,
            "{}\na picture takes {milliseconds:.2} ms with the wanted effects, {required_milliseconds:.2} ms with the required ones ({:.2} \
             times as fast); {noise:.2} ms are noise\nverified in {}: {}",
            self.table().text(),
            milliseconds / required_milliseconds,
            counted(proof.views, "view"),
            match proof.difference {
                PictureError { max: 0.0, .. } => "every pixel is the same".to_owned(),
                PictureError { max, psnr, .. } => format!("no pixel differs by more than {max:.6} (PSNR {psnr:.1} dB)"),
            }
        )
    }
}

#[cfg(test)]
mod tests {
    use glam::{Vec2, Vec3};
    use gs_core::{
        Blend, Canvas, Gaussian2d, Scene2d,
        effects::{Antialias, Background, Requirement},
    };
    use gs_cpu::{CpuRasterizer, CpuSettings};

    use super::*;

    fn scene() -> Scene2d {
        let gaussian = |x: f32| Gaussian2d {
            mean: Vec2::new(x, 9.0),
            log_scale: Vec2::new(0.5, -1.0),
            rotation: 0.3,
            opacity_logit: 1.0,
            color: Vec3::new(0.9, 0.2, 0.5),
        };
        [gaussian(7.0), gaussian(9.5), gaussian(14.0)].into_iter().collect()
    }

    #[test]
    fn pictures_bear_out_what_is_right_and_overrule_what_is_wrong() {
        let cpu = CpuRasterizer::new(CpuSettings::default().with(|s| {
            s.threads = Some(1);
            s.level = None;
        }))
        .unwrap();
        let loaded = Loaded::new(cpu.for_2d(), &scene()).unwrap();
        let views = [Canvas::new(24, 18), Canvas::new(9, 7).showing(Vec2::ZERO, Vec2::new(24.0, 18.0))];
        let seen = Seen { renderer: &loaded, views: &views };
        let mut wanted = RenderSettings::blended(Blend::Over).on([0.0; 3]);
        wanted.effects.antialias = Antialias::Dilate;
        wanted.effects.sh_degree = 2;

        let found = effect_prices(cpu.for_2d(), &scene(), &views, &wanted, 1).unwrap();
        let proof = &found.proof;
        assert_eq!((proof.difference.max, proof.difference.psnr, proof.views), (0.0, f64::INFINITY, 2));
        let text = found.to_string();
        assert!(text.ends_with("verified in 2 views: every pixel is the same"), "{text}");
        let row = text.lines().find(|line| line.starts_with("antialias")).unwrap();
        let cells: Vec<&str> = row.split_whitespace().collect();
        assert_eq!((&cells[1..3], cells[5]), (&["dilate"; 2][..], "none"), "{row}");
        assert_eq!(proof.required.settings.effects.background, Background::None);

        // Leaves out antialiasing, which shows, besides what does not show: SH and the black
        // background.
        let mut wrong = proof.required.clone();
        wrong.settings.effects.antialias = Antialias::None;
        assert!(seen.differences(&wanted, &[wrong.settings]).unwrap()[0].max > 1.0 / 512.0);
        let Proof { required: repaired, difference, .. } = seen.borne_out(wrong, &wanted).unwrap();
        assert_eq!(
            repaired.settings.effects,
            Effects { background: Background::None, sh_degree: 0, ..wanted.effects },
            "what is not to blame stays left out"
        );
        assert_eq!(difference.max, 0.0);
        let verdict = &repaired.decisions[3];
        assert_eq!((verdict.effect, verdict.answer), (Effect::Antialias, Requirement::Required));
        assert!(verdict.reason.contains("not foreseen"), "{}", verdict.reason);
    }
}
