//! Which frames of a video become photographs: the sharpest of each interval of image motion.

use super::motion::{Shift, Small, Tracker};
use crate::inspection::Grey;

/// Motion from a chosen frame to the next, of the longer side of the image: neighbours then overlap by
/// 90 %.
const STEP: f64 = 0.1;

/// The smallest and the largest such motion, for videos of which few or many frames would be chosen.
const STEPS: [f64; 2] = [0.025, 0.4];

/// The first and the last frame of an interval, of [`STEP`].
const INTERVAL: [f64; 2] = [0.6, 1.2];

/// Frames below which the intervals become smaller, and the most that are chosen.
const FEW: usize = 40;
pub(super) const MOST: usize = 300;

/// Share of the median sharpness of the frames around it below which a frame is blurred.
const BLURRED: f64 = 0.6;

/// Frames before and after a frame that its sharpness is compared with.
const AROUND: usize = 10;

/// A frame as it is judged.
#[derive(Debug)]
pub(super) struct Frame {
    sharpness: f64,
    small: Small,
}

impl Frame {
    /// Looks at a frame of this width by the brightness of its pixels.
    pub(super) fn of(width: usize, pixels: &[u8]) -> Self {
        Self { sharpness: Grey::from_bytes(width, pixels).sharpness(), small: Small::of(width, pixels) }
    }
}

/// What was chosen.
#[derive(Debug, PartialEq)]
pub(super) struct Choice {
    /// The numbers of the frames, in the order of time.
    pub(super) frames: Vec<usize>,
    /// Number of blurred frames.
    pub(super) blurred: usize,
    /// Number of frames of a plain surface or of darkness.
    pub(super) plain: usize,
    /// The motion from one to the next, of the longer side of the image.
    pub(super) step: f64,
}

/// Chooses at most so many frames.
pub(super) fn choose(frames: &[Frame], most: usize) -> Choice {
    let textured: Vec<usize> = (0..frames.len()).filter(|frame| frames[*frame].small.is_textured()).collect();
    let sharpness: Vec<f64> = textured.iter().map(|frame| frames[*frame].sharpness).collect();
    let sharp = |at: &usize| {
        let mut around = sharpness[at.saturating_sub(AROUND)..sharpness.len().min(at + AROUND + 1)].to_vec();
        around.sort_by(f64::total_cmp);
        sharpness[*at] >= BLURRED * around[around.len() / 2]
    };
    let usable: Vec<usize> = (0..textured.len()).filter(sharp).map(|at| textured[at]).collect();
    let shifts: Vec<Shift> =
        usable.windows(2).map(|pair| frames[pair[0]].small.shift(&frames[pair[1]].small)).collect();
    let mut step = STEP;
    let mut chosen = intervals(frames, &usable, &shifts, step);
    while chosen.len() < FEW && step > STEPS[0] {
        step = (step * 0.7).max(STEPS[0]);
        chosen = intervals(frames, &usable, &shifts, step);
    }
    while chosen.len() > most && step < STEPS[1] {
        step = (step * (chosen.len() as f64 / most as f64).max(1.1)).min(STEPS[1]);
        chosen = intervals(frames, &usable, &shifts, step);
    }
    if chosen.len() > most {
        chosen = (0..most).map(|at| chosen[at * chosen.len() / most]).collect();
    }
    let (blurred, plain) = (textured.len() - usable.len(), frames.len() - textured.len());
    Choice { frames: chosen, blurred, plain, step }
}

/// The sharpest frame of each interval of motion. `shifts` are those from a usable frame to the next.
fn intervals(frames: &[Frame], usable: &[usize], shifts: &[Shift], step: f64) -> Vec<usize> {
    let mut chosen = Vec::new();
    let mut next = (!usable.is_empty()).then_some(0);
    let [near, far] = INTERVAL.map(|share| share * step);
    let sharpness = |at: usize| frames[usable[at]].sharpness;
    while let Some(key) = next.take() {
        chosen.push(key);
        let mut tracker = Tracker::new(&frames[usable[key]].small);
        for at in key + 1..usable.len() {
            let motion = tracker.motion(&frames[usable[at]].small, shifts[at - 1]);
            if motion > far {
                next = next.or(Some(at));
                break;
            }
            if motion >= near && next.is_none_or(|best| sharpness(at) > sharpness(best)) {
                next = Some(at);
            }
        }
    }
    chosen.into_iter().map(|at| usable[at]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const WIDTH: i32 = 160;

    /// A picture with texture at every scale, moved to the left and blurred over some columns.
    fn frame(moved: i32, blur: i32) -> Frame {
        let noise =
            |x: i32, y: i32| (x.wrapping_mul(73) ^ y.wrapping_mul(151) ^ (x * y).wrapping_mul(7)).rem_euclid(97);
        let value = |x: i32, y: i32| noise(x / 9, y / 9) + noise(x / 3 + 50, y / 3) / 2 + noise(x, y) / 4;
        let pixel = |x: i32, y: i32| ((0..=blur).map(|b| value(x + moved + b, y)).sum::<i32>() / (blur + 1)) as u8;
        let pixels: Vec<u8> = (0..96).flat_map(|y| (0..WIDTH).map(move |x| (x, y))).map(|(x, y)| pixel(x, y)).collect();
        Frame::of(WIDTH as usize, &pixels)
    }

    #[test]
    fn frames_are_a_step_apart_and_sharp() {
        // Moves by 3 px a frame, stands still for 40 frames, and every third frame is blurred.
        let at = |i: i32| 3 * (i.min(80) + (i - 120).max(0));
        let frames: Vec<Frame> = (0..320).map(|i| frame(at(i), if i % 3 == 1 { 6 } else { 0 })).collect();
        let choice = choose(&frames, MOST);
        assert_eq!((choice.step, choice.plain), (STEP, 0));
        assert!((100..=107).contains(&choice.blurred), "{choice:?}");
        assert!(choice.frames.iter().all(|frame| frame % 3 != 1), "{choice:?}");
        let moved: Vec<i32> = choice.frames.windows(2).map(|pair| at(pair[1] as i32) - at(pair[0] as i32)).collect();
        let [near, far] = INTERVAL.map(|share| share * STEP * f64::from(WIDTH));
        assert!(moved.iter().all(|moved| (near - 1.0..far + 5.0).contains(&f64::from(*moved))), "{moved:?}");
        assert!(at(*choice.frames.last().unwrap() as i32) > at(319) - 2 * far as i32);
    }

    #[test]
    fn few_frames_are_closer_and_many_are_thinned() {
        let slow: Vec<Frame> = (0..40).map(|i| frame(4 * i, 0)).collect();
        let choice = choose(&slow, MOST);
        assert!(choice.step < STEP && choice.frames.len() >= 10, "{choice:?}");
        let still: Vec<Frame> = (0..30).map(|_| frame(0, 0)).collect();
        assert_eq!(choose(&still, MOST).frames, [0]);
        // Along stripes, all places are alike.
        let stripes = |i: usize| {
            Frame::of(160, &(0..160 * 96).map(|at| ((at / 160 / 12 * 90 + i % 2) % 250) as u8).collect::<Vec<_>>())
        };
        assert_eq!(choose(&(0..30).map(stripes).collect::<Vec<_>>(), MOST).frames, [0]);
        // Nothing is found again from one to the next.
        let fast: Vec<Frame> = (0..31).map(|i| frame(777 * i, 0)).collect();
        let choice = choose(&fast, 30);
        assert!(choice.frames.len() == 30 && choice.frames.windows(2).all(|pair| pair[0] < pair[1]), "{choice:?}");
    }

    #[test]
    fn frames_that_show_nothing_are_left_out() {
        let plain = || Frame::of(160, &[7; 160 * 96]);
        let frames: Vec<Frame> = (0..20).map(|i| if i < 5 { plain() } else { frame(20 * i, 0) }).collect();
        let choice = choose(&frames, MOST);
        assert!(choice.plain == 5 && choice.frames[0] == 5 && choice.frames.len() > 10, "{choice:?}");
        let nothing = choose(&[plain(), plain()], MOST);
        assert_eq!((nothing.frames.len(), nothing.plain), (0, 2));
        assert!(choose(&[], MOST).frames.is_empty());
        assert_eq!(choose(&[Frame::of(3, &[0, 200, 0])], MOST).plain, 1);
    }
}
