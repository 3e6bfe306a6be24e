//! Adam's moments of SH above degree 0 in 16 bits: compared with gs-cpu, whose random bits are the
//! same, and carried through saved states, changes of the format and edits.

use gs_core::{
    TensorData,
    adam::Rate,
    edit::{Birth, Change, Moments, Origin, Place, PruneCause, Removal},
};

use super::*;

const NAMES: [&str; 2] = ["moment1", "moment2"];

/// Numbers before the rest in a row of moments: mean 3, shape 7, opacity 1, SH of degree 0: 3.
const BEFORE_REST: usize = 14;

/// Typical Gaussians of degree 3.
fn typical() -> Draw<Scene3d> {
    Draw::for_3d(Kind3d::Typical, Blend::Over, 60, (60, 44), 11).on([0.3, 0.2, 0.6])
}

fn in_format(format: MomentFormat) -> AdamRates {
    AdamRates { color_rest_moments: format, ..rates(Participants::Visible) }
}

/// The bits of the first or second moments of SH above degree 0.
fn rest(state: &SplatsState, name: &str) -> Vec<u32> {
    let (columns, numbers) = state.matrix(name).unwrap();
    numbers.chunks_exact(columns).flat_map(|row| &row[BEFORE_REST..]).map(|m| m.to_bits()).collect()
}

#[test]
fn steps_in_16_bits_match_the_cpu() {
    let (draw, rates) = (typical(), in_format(MomentFormat::Bf16));
    let sh = |state: &SplatsState| state.matrix("sh").unwrap().1.to_vec();
    let apart = |one: &SplatsState, other: &SplatsState| {
        let squares = sh(one).into_iter().zip(sh(other)).map(|(a, b)| f64::from(a - b).powi(2));
        squares.sum::<f64>().sqrt()
    };
    let expected = trained(cpu().for_3d(), &draw, &rates, 10).0;
    let exact = trained(cpu().for_3d(), &draw, &in_format(MomentFormat::F32), 10).0;
    for (kernels, r) in rasterizers() {
        let found = trained(r, &draw, &rates, 10).0;
        for name in NAMES {
            let pairs: Vec<_> = rest(&expected, name).into_iter().zip(rest(&found, name)).collect();
            assert!(pairs.iter().all(|(_, found)| found & 0xFFFF == 0), "a moment has more than 16 bits");
            let moved = pairs.iter().filter(|(expected, _)| *expected != 0).count();
            let same = pairs.iter().filter(|(expected, found)| *expected != 0 && expected == found).count();
            // Of other random bits, about half would round in the same direction.
            assert!(moved > 2000 && same * 20 > moved * 19, "{kernels:?}: {same} of {moved} {name} are the same");
        }
        assert!(apart(&found, &expected) < 0.3 * apart(&exact, &expected), "{kernels:?}");
    }
}

/// The state after some steps without gradients, as no Gaussian is in view. The moments of SH above
/// degree 0 start as `values` in turn.
fn decayed<R: Optimizer<Scene3d>>(r: &R, values: [&[f32]; 2], steps: usize) -> SplatsState {
    let Draw { mut scene, settings, .. } = typical();
    scene.means.fill(Vec3::new(0.0, 0.0, -5.0));
    let view = Camera::looking_forward(16, 16, 1.0);
    let mut state = r.save(&r.upload(&scene, Parameterization::ScaleRotation).unwrap()).block_on().unwrap();
    for (name, values) in NAMES.into_iter().zip(values) {
        let (columns, _) = state.matrix(name).unwrap();
        let TensorData::F32(numbers) = &mut state.tensors.get_mut(name).unwrap().data else { unreachable!() };
        let rest = numbers.chunks_exact_mut(columns).flat_map(|row| &mut row[BEFORE_REST..]);
        rest.zip(values.iter().cycle()).for_each(|(moment, value)| *moment = *value);
    }
    let target = r.upload_target(&Image::filled(16, 16, [0.2; 3]).unwrap()).unwrap();
    let mut splats = r.restore(&state).unwrap();
    let pass = r.forward(&splats, &view, &settings).block_on().unwrap();
    let (_, gradients) = r.backward(&splats, pass, &target, &Loss::L2).block_on().unwrap();
    let mut rates = rates(Participants::All);
    rates.color_rest_moments = MomentFormat::Bf16;
    rates.color_rest = Rate { beta1: 0.999, beta2: 0.999, ..rates.color_rest };
    for _ in 0..steps {
        r.step(&mut splats, &gradients, &rates).block_on().unwrap();
    }
    r.save(&splats).block_on().unwrap()
}

/// Moments that decay by less than half of their last digit per step.
#[test]
fn rounding_has_no_bias_and_the_bits_of_the_cpu() {
    const STEPS: usize = 500;
    let values: [&[f32]; 2] = [&[-0.75], &[1.0]];
    let expected = decayed(cpu().for_3d(), values, STEPS);
    let remaining = 0.999f64.powi(STEPS as i32);
    for (kernels, r) in rasterizers() {
        let found = decayed(r, values, STEPS);
        for (name, start) in NAMES.into_iter().zip([-0.75, 1.0]) {
            let moments = rest(&found, name);
            let mean = moments.iter().map(|&m| f64::from(f32::from_bits(m))).sum::<f64>() / moments.len() as f64;
            assert!((mean / (start * remaining) - 1.0).abs() < 0.01, "{kernels:?}: {mean}");
            assert!(moments == rest(&expected, name), "{kernels:?}: {name} have other bits than on the CPU");
        }
    }
}

#[test]
fn infinities_and_nan_stay() {
    let values = [f32::INFINITY, f32::NEG_INFINITY, f32::NAN, f32::from_bits(0x7FFF_FFFF), 0.0, 1.0];
    for (kernels, r) in rasterizers() {
        let found = decayed(r, [&values; 2], 1);
        for (back, value) in
            NAMES.into_iter().flat_map(|name| rest(&found, name).into_iter().zip(values.into_iter().cycle()))
        {
            let back = f32::from_bits(back);
            let stays = back == value || back.is_nan() && value.is_nan() || back > 0.98 && value == 1.0;
            assert!(stays, "{kernels:?}: {value} has become {back}");
        }
    }
}

/// The state after a step in each of these formats, and the bytes moved. With `restores`, the run
/// goes on from a restored state after each step.
fn in_formats(r: &WgpuRasterizer, formats: &[MomentFormat], restores: bool) -> (SplatsState, u64) {
    let draw = large();
    let target = r.for_3d().upload_target(&draw.target().unwrap()).unwrap();
    let mut splats = r.upload(&draw.scene, Parameterization::ScaleRotation).unwrap();
    let before = r.bytes_moved();
    for &format in formats {
        let rates = in_format(format);
        let step = TrainStep { settings: &draw.settings, loss: Loss::PAPER, rates: &rates, binning: Binning::Fresh };
        r.train_step(&mut splats, &draw.view, &target, &step).block_on().unwrap();
        if restores {
            splats = r.restore(&r.save(&splats).block_on().unwrap()).unwrap();
        }
    }
    (r.save(&splats).block_on().unwrap(), r.bytes_moved() - before)
}

#[test]
fn a_run_is_bit_identical_after_restores_and_repeated_steps() {
    use MomentFormat::{Bf16, F32};
    for formats in [&[Bf16; 4][..], &[F32, Bf16, Bf16, F32]] {
        let r = WgpuRasterizer::new(WgpuSettings::default()).block_on().unwrap();
        let (repeated, more_bytes) = in_formats(&r, formats, false);
        // The pool has large buffers from now on.
        let Draw { scene, view, settings, .. } = large();
        r.render(&scene, &view, &settings).block_on().unwrap();
        let (whole, bytes_moved) = in_formats(&r, formats, false);
        assert!(more_bytes > bytes_moved, "{formats:?}: no step was repeated");
        assert_eq!(bits(&repeated), bits(&whole), "{formats:?}");
        assert_eq!(bits(&in_formats(&r, formats, true).0), bits(&whole), "{formats:?}");
        assert_ne!(bits(&in_formats(&r, &[F32; 4], false).0), bits(&whole), "the format changes nothing");
    }
}

#[test]
fn edits_carry_moments_in_16_bits() {
    let (draw, rates) = (typical(), in_format(MomentFormat::Bf16));
    let gaussian = |i: usize| draw.scene.gaussian(i);
    let birth = |i, parent, moments| Birth {
        gaussian: gaussian(i),
        parent,
        moments,
        origin: Origin::Clone,
        place: Place::BehindParent,
    };
    let plan = EditPlan {
        removed: [3, 11].map(|index| Removal { index, cause: PruneCause::Transparent }).to_vec(),
        changed: vec![
            // Relocated.
            Change { index: 7, gaussian: gaussian(20), moments: Moments::Zeroed },
            Change { index: 20, gaussian: gaussian(20), moments: Moments::Inherit },
        ],
        added: vec![
            birth(5, Some(5), Moments::Inherit),
            birth(6, Some(11), Moments::Inherit),
            birth(8, Some(8), Moments::Fresh),
            birth(9, None, Moments::Fresh),
        ],
        ..EditPlan::default()
    };
    for (kernels, r) in rasterizers() {
        let target = r.for_3d().upload_target(&draw.target().unwrap()).unwrap();
        let mut splats = r.upload(&draw.scene, Parameterization::ScaleRotation).unwrap();
        let step = TrainStep { settings: &draw.settings, loss: Loss::L2, rates: &rates, binning: Binning::Fresh };
        for _ in 0..4 {
            r.train_step(&mut splats, &draw.view, &target, &step).block_on().unwrap();
        }
        let cpu = cpu();
        let cpu = cpu.for_3d();
        let mut expected = cpu.restore(&r.save(&splats).block_on().unwrap()).unwrap();
        cpu.edit(&mut expected, &plan).block_on().unwrap();
        r.edit(&mut splats, &plan).block_on().unwrap();
        let (expected, found) = (cpu.save(&expected).block_on().unwrap(), r.save(&splats).block_on().unwrap());
        assert_eq!(bits(&expected), bits(&found), "{kernels:?}");
    }
}
