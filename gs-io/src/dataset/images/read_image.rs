//! Reads the image of a view on demand: decoded, undistorted and masked.

use super::{PosedImage, View, border::mask_border, resample::undistorted, shape::same_shape, shrink::shrunk};
use crate::{
    atomic::read_file,
    dataset::{AlphaMeaning, FILE},
    error::Error,
    image::{decode, decode_mask},
};

/// The images of views, as [`View::read_image`] reads each. A file that neighbouring views share, such
/// as the 360° image of six faces, is decoded once.
///
/// # Errors
/// Those of [`View::read_image`].
pub fn read_images(views: &[View]) -> Result<Vec<PosedImage>, Error> {
    let mut images = Vec::with_capacity(views.len());
    for shared in views.chunk_by(View::shares_files) {
        match shared {
            [view] => images.push(view.read_image()?),
            [first, ..] => {
                let whole = first.read_whole()?;
                images.extend(shared.iter().map(|view| view.undistorted(&whole)).collect::<Result<Vec<_>, _>>()?);
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
    /// Views can be read in parallel. The threads of rayon's pool share the work of one view, too, so
    /// hold no lock meanwhile that a job of this pool waits for.
    ///
    /// Undistorted pixels are interpolated by Catmull-Rom's cubic, with premultiplied colours if
    /// there is alpha, clamped to the range of the contributing pixels.
    ///
    /// # Errors
    /// Those of [`read_image_on`](crate::read_image_on) for image and mask, in
    /// [`Error::BadView`] if they concern the content; [`Error::Unusable`] if a shape has changed
    /// since the data set was opened.
    pub fn read_image(&self) -> Result<PosedImage, Error> {
        let whole = self.read_whole()?;
        if self.source.lens.is_pinhole() { self.scaled(whole) } else { self.undistorted(&whole) }
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

    /// The image of this view, from that of its file.
    fn undistorted(&self, whole: &PosedImage) -> Result<PosedImage, Error> {
        self.scaled(undistorted(whole, &self.source, &self.full).map_err(Error::content(&self.image))?)
    }

    /// The image at the size of the view's camera.
    fn scaled(&self, posed: PosedImage) -> Result<PosedImage, Error> {
        let size = (self.camera.width, self.camera.height);
        if posed.image.size() == size {
            return Ok(posed);
        }
        shrunk(&posed, size).map_err(Error::content(&self.image))
    }

    /// The image file with its alpha and mask, as the camera took it.
    fn read_whole(&self) -> Result<PosedImage, Error> {
        let decoded = decode(&self.image, self.orientation).map_err(leave_out)?;
        let expected = (self.source.width, self.source.height);
        if decoded.image.size() != expected {
            return Err(Error::image_shape(&self.image, decoded.image.size(), expected));
        }
        let mut mask = self.mask.is_some().then(|| self.read_mask()).transpose()?;
        let alpha = match self.alpha {
            AlphaMeaning::Opacity => decoded.alpha,
            AlphaMeaning::Mask => {
                if let Some(alpha) = decoded.alpha {
                    let mask = mask.get_or_insert_with(|| vec![true; alpha.len()]);
                    mask.iter_mut().zip(alpha).for_each(|(counts, alpha)| *counts &= alpha >= 0.5);
                }
                None
            }
        };
        let mut posed = PosedImage { image: decoded.image, alpha, mask };
        if self.source.face().is_some() && !self.source.is_panorama() {
            mask_border(&mut posed, self.source.center);
        }
        Ok(posed)
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

/// Advises to leave out a file that seemed whole when the data set was opened.
fn leave_out(error: Error) -> Error {
    match error {
        Error::NotAnImage { .. } | Error::Unusable { .. } => Error::BadView(Box::new(error)),
        other => other,
    }
}
