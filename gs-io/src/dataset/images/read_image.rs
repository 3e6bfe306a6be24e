//! Reads the image of a view on demand: decoded, undistorted and masked.

use std::borrow::Cow;

use super::{
    CompactImage, PosedImage, View, Window, border::mask_border, resample::undistorted, shape::same_shape,
    shrink::Shrinking,
};
use crate::{
    atomic::read_file,
    dataset::{AlphaMeaning, FILE},
    error::Error,
    image::{AnyPixels, Pixels, Sample, decode_mask, decode_samples, with_pixels},
};

/// The images of views, as [`View::read_compact`] reads each. A file that neighbouring views share, such
/// as the 360° image of six faces, is decoded once.
///
/// # Errors
/// Those of [`View::read_image`].
pub fn read_images(views: &[View]) -> Result<Vec<CompactImage>, Error> {
    let mut images = Vec::with_capacity(views.len());
    for shared in views.chunk_by(View::shares_files) {
        match shared {
            [view] => images.push(view.read_compact()?),
            [first, ..] => {
                let whole = first.read_whole()?;
                images.extend(shared.iter().map(|view| view.window_of(Cow::Borrowed(&whole), view.all())));
            }
            [] => {}
        }
    }
    Ok(images)
}

impl View {
    /// Reads the image, undistorts it, applies the mask, and scales it to the size of the view's
    /// camera. Nothing is cached.
    ///
    /// One thread does all the work: read several views in parallel.
    ///
    /// Pixels are rounded to 8 bits a channel after each of these, or to 16 where the file has more; a
    /// file of floating-point numbers stays one. Undistorted pixels are interpolated by Catmull-Rom's cubic, with premultiplied colours if
    /// there is alpha, clamped to the range of the contributing pixels.
    ///
    /// # Errors
    /// Those of [`read_image_on`](crate::read_image_on) for image and mask, with the advice to remove the
    /// file if they concern its content; [`Error::Unusable`] if a shape has changed since the data set was
    /// opened.
    pub fn read_image(&self) -> Result<PosedImage, Error> {
        self.read_compact()?.to_posed().map_err(Error::content(&self.image))
    }

    /// [`Self::read_image`] in the samples of the file.
    ///
    /// # Errors
    /// Those of [`Self::read_image`].
    pub fn read_compact(&self) -> Result<CompactImage, Error> {
        self.read_window(self.all())
    }

    /// A part of what [`Self::read_compact`] reads, without computing the rest. In a view with a mask that leaves
    /// out nothing of the part, numbers may be rounded otherwise.
    ///
    /// # Errors
    /// Those of [`Self::read_image`].
    ///
    /// # Panics
    /// Where the window is not in the image of the view's camera.
    pub fn read_window(&self, window: Window) -> Result<CompactImage, Error> {
        assert!(window.is_in((self.camera.width, self.camera.height)), "{window:?} is not in the image");
        Ok(self.window_of(Cow::Owned(self.read_whole()?), window))
    }

    /// A checksum of the bytes of the view's files: image, mask and depth map. Views with other files
    /// have another, except for a chance of 2⁻³². *Source:* CRC-32.
    ///
    /// # Errors
    /// Those of reading a file.
    pub fn digest(&self) -> Result<u32, Error> {
        let depth = self.depth.as_ref().map(|depth| &depth.path);
        let mut hasher = crc32fast::Hasher::new();
        for path in [Some(&self.image), self.mask.as_ref(), depth].into_iter().flatten() {
            let bytes = read_file(path, FILE)?;
            hasher.update(&bytes);
            // Where one file ends and the next begins counts, too.
            hasher.update(&(bytes.len() as u64).to_le_bytes());
        }
        Ok(hasher.finalize())
    }

    /// The window that is the whole image of the view's camera.
    fn all(&self) -> Window {
        Window::whole((self.camera.width, self.camera.height))
    }

    /// A window of the image of the view's camera, from the image of the file.
    fn window_of(&self, file: Cow<'_, CompactImage>, window: Window) -> CompactImage {
        let (old, new) = ((self.full.width, self.full.height), (self.camera.width, self.camera.height));
        let shrinking = (old != new).then(|| Shrinking::new(old, new, window));
        let needed = shrinking.as_ref().map_or(window, Shrinking::needed);
        let part = match self.source.lens.is_pinhole() {
            true if needed == Window::whole(file.size()) => file,
            true => Cow::Owned(file.cropped(needed)),
            false => Cow::Owned(undistorted(&file, &self.source, &self.full, needed)),
        };
        match shrinking {
            None => part.into_owned(),
            Some(shrinking) => shrinking.shrunk(&part),
        }
    }

    /// The image file with its alpha and mask, as the camera took it.
    fn read_whole(&self) -> Result<CompactImage, Error> {
        let mut pixels = decode_samples(&self.image, self.orientation).map_err(leave_out)?;
        let expected = (self.source.width, self.source.height);
        if pixels.size() != expected {
            return Err(Error::image_shape(&self.image, pixels.size(), expected));
        }
        let mut mask = self.mask.is_some().then(|| self.read_mask()).transpose()?;
        if self.alpha == AlphaMeaning::Mask {
            pixels = with_pixels!(pixels, pixels => without_alpha(pixels, &mut mask));
        }
        let mut whole = CompactImage { pixels, mask };
        if self.source.face().is_some() && !self.source.is_panorama() {
            mask_border(&mut whole, self.source.center);
        }
        Ok(whole)
    }

    /// Whether another view is made of the same files: another face of the same image.
    fn shares_files(&self, other: &Self) -> bool {
        let files = |view: &Self| (view.image.clone(), view.mask.clone(), view.orientation, view.alpha);
        files(self) == files(other)
            && (self.source.width, self.source.height) == (other.source.width, other.source.height)
    }

    /// Reads the mask at the image's size: pixels lighter than mid-grey count.
    fn read_mask(&self) -> Result<Vec<bool>, Error> {
        let Some(path) = &self.mask else { return Ok(Vec::new()) };
        let mask = decode_mask(path).map_err(leave_out)?;
        let (width, height) = (self.source.width, self.source.height);
        if !same_shape(mask.size(), (f64::from(width), f64::from(height))) {
            return Err(Error::image_shape(path, mask.size(), (width, height)));
        }
        let nearest = |i: u32, side: u32, mask_side: u32| {
            (u64::from(2 * i + 1) * u64::from(mask_side) / u64::from(2 * side)) as u32
        };
        let counts = |x: u32, y: u32| {
            let pixel = mask.pixel(nearest(x, width, mask.width()), nearest(y, height, mask.height()));
            pixel.iter().sum::<f32>() >= 1.5
        };
        Ok((0..height).flat_map(|y| (0..width).map(move |x| (x, y))).map(|(x, y)| counts(x, y)).collect())
    }
}

/// Pixels without their alpha, which leaves out those that are rather transparent than opaque.
fn without_alpha<S: Sample>(pixels: Pixels<S>, mask: &mut Option<Vec<bool>>) -> AnyPixels {
    if !pixels.has_alpha {
        return S::any(pixels);
    }
    let of_pixels = pixels.samples.as_chunks::<4>().0;
    let mask = mask.get_or_insert_with(|| vec![true; of_pixels.len()]);
    mask.iter_mut().zip(of_pixels).for_each(|(counts, pixel)| *counts &= pixel[3].number() / S::WHITE >= 0.5);
    let samples = of_pixels.iter().flat_map(|&[r, g, b, _]| [r, g, b]).collect();
    S::any(Pixels { has_alpha: false, samples, ..pixels })
}

/// Advises to leave out a file that seemed whole when the data set was opened.
fn leave_out(error: Error) -> Error {
    let too = |advice: &str| format!("{advice}, or remove the file, and the view is left out");
    match error {
        Error::NotAnImage { path, found, hint } => Error::NotAnImage { path, found, hint: too(&hint) },
        Error::Unusable { path, problem, remedy } => Error::unusable(&path, problem, too(&remedy)),
        other => other,
    }
}
