//! Proves by rendering that leaving out effects does not change pictures.

use gs_core::{
    Effects, Error, Rasterizer, RenderSettings,
    constants::HALF_DISPLAY_STEP,
    effects::{Effect, EffectDecision, RequiredEffects, RequiresEffects},
};
use serde::Serialize;

use super::{Difference, UploadedScene};

/// The required effects, with the measured difference that leaving out the others makes.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Proof {
    /// The result of [`Effects::required`], to which effects are added whose absence changed a
    /// picture.
    pub required: RequiredEffects,
    /// The difference between pictures with the required effects and with all wanted effects.
    pub difference: Difference,
    /// Number of views that were rendered both ways.
    pub views: usize,
}

/// Finds out which effects of the `wanted` settings a scene requires in these views, and renders
/// the views with these and with all effects. If pictures differ visibly, the effect that causes
/// the difference is kept.
///
/// # Errors
/// Those of [`Rasterizer::forward`].
pub fn prove<S, R>(scene: &S, uploaded: &UploadedScene<'_, S, R>, wanted: &RenderSettings) -> Result<Proof, Error>
where
    S: RequiresEffects,
    R: Rasterizer<S>,
{
    borne_out(Effects::required(scene, uploaded.views, wanted)?, uploaded, wanted)
}

/// While pictures differ visibly, restores the effect that reduces the difference most, found by
/// restoring each alone.
fn borne_out<S, R>(
    mut required: RequiredEffects,
    uploaded: &UploadedScene<'_, S, R>,
    wanted: &RenderSettings,
) -> Result<Proof, Error>
where
    S: RequiresEffects,
    R: Rasterizer<S>,
{
    let mut difference = uploaded.differences(wanted, &[required.settings])?[0];
    while difference.most > HALF_DISPLAY_STEP {
        let left = required.settings.effects;
        let is_out = |effect: &Effect| effect.value(&left) != effect.value(&wanted.effects);
        let out: Vec<Effect> = Effect::ALL.into_iter().filter(is_out).collect();
        let with = |effect: &Effect| required.settings.with(|s| s.effects = effect.copied(&wanted.effects, &left));
        let restored: Vec<RenderSettings> = out.iter().map(with).collect();
        let found = uploaded.differences(wanted, &restored)?;
        let closer = |a: &usize, b: &usize| {
            let (a, b): (Difference, Difference) = (found[*a], found[*b]);
            a.most.total_cmp(&b.most).then(b.psnr.total_cmp(&a.psnr))
        };
        let Some(guilty) = (0..out.len()).min_by(closer) else { break };
        let reason = format!("without it, a pixel changes by {:.4}, which was not foreseen", difference.most);
        for verdict in required.decisions.iter_mut().filter(|verdict| verdict.effect == out[guilty]) {
            *verdict = EffectDecision::new(out[guilty], &wanted.effects, &wanted.effects, reason.clone());
        }
        (required.settings, difference) = (restored[guilty], found[guilty]);
    }
    Ok(Proof { required, difference, views: uploaded.views.len() })
}

#[cfg(test)]
mod tests {
    use glam::{Vec2, Vec3};
    use gs_core::{
        Blend, Canvas, Gaussian2d, Parameterization, Scene2d,
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
        let cpu = cpu.for_2d();
        let splats = cpu.upload(&scene(), Parameterization::ScaleRotation).unwrap();
        let views = [Canvas::new(24, 18), Canvas::new(9, 7).showing(Vec2::ZERO, Vec2::new(24.0, 18.0))];
        let uploaded = UploadedScene { rasterizer: cpu, splats: &splats, views: &views };
        let mut wanted = RenderSettings::blended(Blend::Over).on([0.0; 3]);
        wanted.effects.antialias = Antialias::Dilate;
        wanted.effects.sh_degree = 2;

        let proof = prove(&scene(), &uploaded, &wanted).unwrap();
        assert_eq!((proof.difference, proof.views), (Difference { most: 0.0, psnr: f64::INFINITY }, 2));
        assert_eq!(proof.required.settings.effects.background, Background::None);

        // Leaves out antialiasing, which shows, besides what does not show: SH and the black
        // background.
        let mut wrong = proof.required.clone();
        wrong.settings.effects.antialias = Antialias::None;
        assert!(uploaded.differences(&wanted, &[wrong.settings]).unwrap()[0].most > HALF_DISPLAY_STEP);
        let Proof { required: repaired, difference, .. } = borne_out(wrong, &uploaded, &wanted).unwrap();
        assert_eq!(
            repaired.settings.effects,
            Effects { background: Background::None, sh_degree: 0, ..wanted.effects },
            "what is not to blame stays left out"
        );
        assert_eq!(difference.most, 0.0);
        let verdict = &repaired.decisions[3];
        assert_eq!((verdict.effect, verdict.answer), (Effect::Antialias, Requirement::Required));
        assert!(verdict.reason.contains("not foreseen"), "{}", verdict.reason);
    }
}
