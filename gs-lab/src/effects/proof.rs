//! Whether pictures bear out what was decided about effects by bounds.

use gs_core::{
    Effects, Error, Rasterizer, RenderSettings,
    constants::HALF_DISPLAY_STEP,
    effects::{
        CalledFor, Effect,
        called_for::{CallsForEffects, Verdict},
    },
};
use serde::Serialize;

use super::{Difference, Sight};

/// What is called for, with the pictures that show it.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Proof {
    /// As [`Effects::called_for`] has it, but for effects whose absence was seen: they stay.
    pub called: CalledFor,
    /// How far the pictures with what is called for are from those with all that is wanted.
    pub difference: Difference,
    /// How many views were rendered both ways.
    pub views: usize,
}

/// Asks a scene which effects of the `wanted` settings it calls for in these views, and renders them both ways. Where the pictures
/// contradict, the effect to blame stays.
///
/// # Errors
/// Those of [`Rasterizer::forward`].
pub fn prove<S, R>(scene: &S, sight: &Sight<'_, S, R>, wanted: &RenderSettings) -> Result<Proof, Error>
where
    S: CallsForEffects,
    R: Rasterizer<S>,
{
    borne_out(Effects::called_for(scene, sight.views, wanted)?, sight, wanted)
}

/// While the pictures show that something is missing, gives back the effect whose return brings them closest to the wanted ones, measured for
/// each that is left out by itself.
fn borne_out<S, R>(mut called: CalledFor, sight: &Sight<'_, S, R>, wanted: &RenderSettings) -> Result<Proof, Error>
where
    S: CallsForEffects,
    R: Rasterizer<S>,
{
    let mut difference = sight.differences(wanted, &[called.settings])?[0];
    while difference.most > HALF_DISPLAY_STEP {
        let left = called.settings.effects;
        let is_out = |effect: &Effect| effect.value(&left) != effect.value(&wanted.effects);
        let out: Vec<Effect> = Effect::ALL.into_iter().filter(is_out).collect();
        let with =
            |effect: &Effect| RenderSettings { effects: effect.copied(&wanted.effects, &left), ..called.settings };
        let restored: Vec<RenderSettings> = out.iter().map(with).collect();
        let found = sight.differences(wanted, &restored)?;
        let closer = |a: &usize, b: &usize| {
            let (a, b): (Difference, Difference) = (found[*a], found[*b]);
            a.most.total_cmp(&b.most).then(b.psnr.total_cmp(&a.psnr))
        };
        let Some(guilty) = (0..out.len()).min_by(closer) else { break };
        let reason = format!("without it, a pixel changes by {:.4}, which was not foreseen", difference.most);
        for verdict in called.verdicts.iter_mut().filter(|verdict| verdict.effect == out[guilty]) {
            *verdict = Verdict::new(out[guilty], &wanted.effects, &wanted.effects, reason.clone());
        }
        (called.settings, difference) = (restored[guilty], found[guilty]);
    }
    Ok(Proof { called, difference, views: sight.views.len() })
}

#[cfg(test)]
mod tests {
    use glam::{Vec2, Vec3};
    use gs_core::{
        Blend, Canvas, Gaussian2d, Parameterization, Scene2d,
        effects::{Antialias, Background, called_for::Answer},
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
        let cpu = CpuRasterizer::new(CpuSettings { threads: Some(1), level: None }).unwrap();
        let cpu = cpu.for_2d();
        let splats = cpu.upload(&scene(), Parameterization::ScaleRotation).unwrap();
        let views = [Canvas::new(24, 18), Canvas::new(9, 7).showing(Vec2::ZERO, Vec2::new(24.0, 18.0))];
        let sight = Sight { on: cpu, splats: &splats, views: &views };
        let mut wanted = RenderSettings::blended(Blend::Over).on([0.0; 3]);
        wanted.effects.antialias = Antialias::Dilate;
        wanted.effects.sh_degree = 2;

        let proof = prove(&scene(), &sight, &wanted).unwrap();
        assert_eq!((proof.difference, proof.views), (Difference { most: 0.0, psnr: f64::INFINITY }, 2));
        assert_eq!(proof.called.settings.effects.background, Background::None);

        // Somebody leaves out what shows, besides what does not: harmonics, which come first, and black.
        let mut wrong = proof.called.clone();
        wrong.settings.effects.antialias = Antialias::None;
        assert!(sight.differences(&wanted, &[wrong.settings]).unwrap()[0].most > HALF_DISPLAY_STEP);
        let Proof { called: mended, difference, .. } = borne_out(wrong, &sight, &wanted).unwrap();
        assert_eq!(
            mended.settings.effects,
            Effects { background: Background::None, sh_degree: 0, ..wanted.effects },
            "what is not to blame stays left out"
        );
        assert_eq!(difference.most, 0.0);
        let verdict = &mended.verdicts[3];
        assert_eq!((verdict.effect, verdict.answer), (Effect::Antialias, Answer::CalledFor));
        assert!(verdict.reason.contains("not foreseen"), "{}", verdict.reason);
    }
}
