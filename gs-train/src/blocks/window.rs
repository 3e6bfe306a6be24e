//! A window of a view: what a block needs of it.

use std::sync::Arc;

use gs_io::dataset::{CompactImage, PosedImage, Window};

use crate::train::{Counting, ImageSource, PosedView};

/// The window of a view.
pub(super) fn window_of(view: &PosedView, window: Window) -> PosedView {
    let source = Arc::new(Part { window, whole: Arc::clone(&view.source) });
    PosedView { name: view.name.clone(), camera: window.camera(&view.camera), source }
}

/// The window of an image.
struct Part {
    window: Window,
    whole: Arc<dyn ImageSource>,
}

impl ImageSource for Part {
    fn read(&self) -> Result<PosedImage, gs_io::Error> {
        let failed = |source| gs_io::Error::Content { path: "the window of a view".into(), source };
        self.read_compact()?.to_posed().map_err(failed)
    }

    fn read_compact(&self) -> Result<CompactImage, gs_io::Error> {
        self.whole.read_window(self.window)
    }

    fn is_face(&self) -> bool {
        self.whole.is_face()
    }

    fn counting(&self) -> Counting {
        self.whole.counting()
    }

    /// That of the whole image.
    fn digest(&self) -> Result<u32, gs_io::Error> {
        self.whole.digest()
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec2;
    use gs_core::{Camera, Image};

    use super::*;

    #[test]
    fn a_window_shows_what_the_whole_view_shows_there() {
        let camera = Camera::looking_forward(12, 8, 1.0);
        let image = Image::from_fn(12, 8, |x, y| [x as f32 / 16.0, y as f32 / 16.0, 0.5]).unwrap();
        let alpha = Some((0..96).map(|i| i as f32 / 96.0).collect());
        let mask = Some((0..96).map(|i| i % 5 != 0).collect());
        let source: Arc<dyn ImageSource> = Arc::new(PosedImage { image, alpha, mask });
        let whole = PosedView { name: "a".to_owned(), camera, source };
        let window = Window { left: 3, top: 2, width: 4, height: 5 };
        let part = window_of(&whole, window);
        let (read, all) = (part.image().unwrap(), whole.image().unwrap());
        for (x, y) in [(0, 0), (3, 4), (2, 1)] {
            let (at, of_all) = ((y * 4 + x) as usize, ((y + 2) * 12 + x + 3) as usize);
            assert_eq!(read.image.pixel(x, y), all.image.pixel(x + 3, y + 2));
            assert_eq!(read.alpha.as_ref().unwrap()[at], all.alpha.as_ref().unwrap()[of_all]);
            assert_eq!(read.mask.as_ref().unwrap()[at], all.mask.as_ref().unwrap()[of_all]);
        }
        assert_eq!(part.source.read_compact().unwrap(), CompactImage::from(&read));
        let point = glam::Vec3::new(0.1, -0.2, 2.0);
        let (there, here) = (camera.project(point).unwrap(), part.camera.project(point).unwrap());
        assert!(there.0.distance(here.0 + Vec2::new(3.0, 2.0)) < 1e-5 && there.1 == here.1);
        assert!(window.is_in((12, 8)) && !Window { width: 10, ..window }.is_in((12, 8)));
    }
}
