//! An order of an image's pixels in which neighbours are neighbours in the image, along which
//! samples are spread evenly.

use std::{
    fmt,
    sync::{Arc, Mutex, PoisonError},
};

use glam::IVec2;

/// The pixels of an image along a Hilbert curve, generalised to any size (*source:* Hilbert 1891;
/// Červený's recursion for rectangles). Consecutive pixels share an edge where both sides are even,
/// a power of two above all; an odd side costs at most a few diagonal steps.
#[derive(Clone, PartialEq, Eq)]
pub(crate) struct HilbertOrder {
    width: u32,
    height: u32,
    pixels: Vec<u32>,
}

/// Largest number of pixels of an order that is cached, in 64 MiB. With larger images, steps take
/// longer than making the order.
const MOST_KEPT_PX: usize = 1 << 24;

/// The last order: a fit needs one size, round after round, and making the order costs more than
/// using it.
static LAST: Mutex<Option<Arc<HilbertOrder>>> = Mutex::new(None);

impl HilbertOrder {
    /// The order for an image of `width` × `height` px; empty where a side is 0. Four bytes a
    /// pixel.
    pub(crate) fn new(width: u32, height: u32) -> Self {
        let mut pixels = Vec::with_capacity(width as usize * height as usize);
        let (right, down) = (IVec2::new(width as i32, 0), IVec2::new(0, height as i32));
        if width > 0 && height > 0 {
            let (along, across) = if width >= height { (right, down) } else { (down, right) };
            visit(&mut pixels, width as i32, IVec2::ZERO, along, across);
        }
        Self { width, height, pixels }
    }

    /// [`Self::new`], cached until another size is requested if it has less than 17 megapixels.
    pub(crate) fn shared(width: u32, height: u32) -> Arc<Self> {
        if width as usize * height as usize > MOST_KEPT_PX {
            return Arc::new(Self::new(width, height));
        }
        // The kept order is replaced whole, so a panic elsewhere cannot have left half of one.
        let mut last = LAST.lock().unwrap_or_else(PoisonError::into_inner);
        match &*last {
            Some(order) if order.size() == (width, height) => order.clone(),
            _ => last.insert(Arc::new(Self::new(width, height))).clone(),
        }
    }

    /// Row-major indices of all pixels, in order, `[H · W]`: a permutation.
    pub(crate) fn pixels(&self) -> &[u32] {
        &self.pixels
    }

    /// Size as (columns, rows).
    pub(crate) fn size(&self) -> (u32, u32) {
        (self.width, self.height)
    }
}

impl fmt::Debug for HilbertOrder {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "HilbertOrder({} x {})", self.width, self.height)
    }
}

/// Appends the rectangle that is spanned by `along` and `across` (axis-parallel, perpendicular)
/// from the corner `start`, entered there and left at the other end of `along`.
fn visit(pixels: &mut Vec<u32>, stride: i32, start: IVec2, along: IVec2, across: IVec2) {
    let (length, breadth) = (along.abs().element_sum(), across.abs().element_sum());
    let (step, side_step) = (along.signum(), across.signum());
    if length == 1 || breadth == 1 {
        let (step, count) = if breadth == 1 { (step, length) } else { (side_step, breadth) };
        let (first, stride) = (start.y * stride + start.x, step.y * stride + step.x);
        pixels.extend((0..count).map(|i| (first + i * stride) as u32));
        return;
    }
    let (mut half_along, mut half_across) = (along / 2, across / 2);
    if 2 * length > 3 * breadth {
        // Much longer than broad: two pieces one after the other, the first of even length so that
        // it can be left at its end.
        if half_along.element_sum() % 2 != 0 && length > 2 {
            half_along += step;
        }
        visit(pixels, stride, start, half_along, across);
        visit(pixels, stride, start + half_along, along - half_along, across);
    } else {
        // Up one half, along the other, and down again.
        if half_across.element_sum() % 2 != 0 && breadth > 2 {
            half_across += side_step;
        }
        let last = start + (along - step) + (half_across - side_step);
        visit(pixels, stride, start, half_across, half_along);
        visit(pixels, stride, start + half_across, along, across - half_across);
        visit(pixels, stride, last, -half_across, half_along - along);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn longest_step(order: &HilbertOrder) -> u32 {
        let at = |p: u32| (p % order.width, p / order.width);
        let far = |a: (u32, u32), b: (u32, u32)| a.0.abs_diff(b.0) + a.1.abs_diff(b.1);
        order.pixels().windows(2).map(|w| far(at(w[0]), at(w[1]))).max().unwrap_or(0)
    }

    #[test]
    fn the_order_visits_every_pixel_once_in_small_steps() {
        for (w, h) in [(1, 1), (1, 9), (7, 1), (2, 2), (3, 5), (64, 64), (128, 32), (33, 70), (97, 31), (768, 512)] {
            let order = HilbertOrder::new(w, h);
            let mut sorted = order.pixels().to_vec();
            sorted.sort_unstable();
            assert!(sorted.iter().copied().eq(0..w * h), "{w}x{h} is no permutation");
            assert!(longest_step(&order) <= if w % 2 == 0 && h % 2 == 0 { 1 } else { 2 }, "{w}x{h} jumps");
        }
        assert!(HilbertOrder::new(0, 5).pixels().is_empty());
    }

    #[test]
    fn a_stretch_of_the_order_is_compact() {
        // 256 consecutive pixels of a row-major order span 256 columns; of a Hilbert order, a few
        // dozen at most.
        let order = HilbertOrder::new(256, 256);
        for stretch in order.pixels().chunks(256) {
            let columns = stretch.iter().map(|p| p % 256);
            assert!(columns.clone().max().unwrap() - columns.min().unwrap() < 64);
        }
    }

    #[test]
    fn the_shared_order_follows_the_size() {
        let a = HilbertOrder::shared(12, 8);
        assert_eq!(*a, HilbertOrder::new(12, 8));
        assert_eq!(HilbertOrder::shared(8, 12).size(), (8, 12));
        assert_eq!(*HilbertOrder::shared(12, 8), *a);
        assert!(!Arc::ptr_eq(&HilbertOrder::shared(1 << 14, 1025), &HilbertOrder::shared(1 << 14, 1025)), "not kept");
    }
}
