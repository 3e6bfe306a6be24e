//! Adam's moments of SH above degree 0 in 16 bits.

use gs_core::{
    Adam, AdamRates, Binning, Loss, MomentFormat, Optimizer as _, Parameterization, Participants, Rasterizer as _,
    SplatsState, TrainStep, effects::Order,
};
use pollster::FutureExt as _;

use super::scenes::{camera, image, rasterizer, scene, settings};

fn rates(format: MomentFormat) -> AdamRates {
    Adam::default()
        .with(|s| {
            s.min_scale = 1e-4;
            s.color_rest_moments = format;
            s.participants = Participants::Visible;
        })
        .at(0.0)
}

/// The states after some numbers of steps. The run goes on from a restored state after each.
fn trained(format: MomentFormat, stops: &[u32]) -> Vec<SplatsState> {
    let scene = scene(300, 3, 4.0);
    let (view, image, settings) = (camera(60, 50), image(60, 50), settings(Order::Global, 3));
    let r = rasterizer(2);
    let r = r.for_3d();
    let target = r.upload_target(&image).unwrap();
    let mut splats = r.upload(&scene, Parameterization::ScaleRotation).unwrap();
    let (rates, mut states, mut done) = (rates(format), Vec::new(), 0);
    for &stop in stops {
        for _ in done..stop {
            let step = TrainStep { settings: &settings, loss: Loss::PAPER, rates: &rates, binning: Binning::Fresh };
            r.train_step(&mut splats, &view, &target, &step).block_on().unwrap();
        }
        states.push(r.save(&splats).block_on().unwrap());
        splats = r.restore(&states[states.len() - 1]).unwrap();
        done = stop;
    }
    states
}

#[test]
fn a_restored_run_goes_on_bit_for_bit() {
    let [whole, restored] = [&[9][..], &[4, 9]].map(|stops| trained(MomentFormat::Bf16, stops).pop().unwrap());
    assert!(whole == restored);
    let (columns, moments) = whole.matrix("moment1").unwrap();
    // Mean 3, shape 7, opacity 1, SH of degree 0: 3.
    let rest = || moments.chunks_exact(columns).flat_map(|row| &row[14..]);
    assert!(rest().all(|m| m.to_bits() & 0xFFFF == 0), "a moment has more than 16 bits");
    assert!(rest().any(|m| *m != 0.0));
}

#[test]
fn sixteen_bits_train_as_32_do() {
    let sh = |format| {
        let state = trained(format, &[8]).pop().unwrap();
        state.matrix("sh").unwrap().1.to_vec()
    };
    let (exact, rounded, start) = (sh(MomentFormat::F32), sh(MomentFormat::Bf16), scene(300, 3, 4.0).sh);
    let start = start.iter().flat_map(|c| c.to_array());
    let (mut moved, mut apart) = (0.0, 0.0);
    for ((exact, rounded), start) in exact.iter().zip(&rounded).zip(start) {
        moved += f64::from(exact - start).powi(2);
        apart += f64::from(exact - rounded).powi(2);
    }
    assert!(apart > 0.0 && apart.sqrt() < 0.05 * moved.sqrt(), "moved {}, apart {}", moved.sqrt(), apart.sqrt());
}
