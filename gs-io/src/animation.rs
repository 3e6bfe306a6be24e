//! Animated PNGs (APNG), written frame by frame.

use std::{io, path::Path};

use gs_core::Image;

use crate::{atomic::write_atomically, error::Error};

/// The format of an animation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Animation {
    /// Columns of each frame.
    pub width: u32,
    /// Rows of each frame.
    pub height: u32,
    /// Number of frames, at least 1.
    pub frames: u32,
    /// Frames per second, at least 1.
    pub fps: u16,
}

/// Writes an 8-bit RGB animated PNG that repeats forever, atomically; values are converted as by
/// [`write_png`](crate::write_png). `frame` is called for each frame in turn, so that only one is
/// in memory.
///
/// # Errors
/// The first error of `frame`; [`Error::Write`], also where a frame has another size than
/// announced, or where there are no frames.
pub fn write_animation<E: From<Error>>(
    path: impl AsRef<Path>,
    animation: Animation,
    mut frame: impl FnMut(u32) -> Result<Image, E>,
) -> Result<(), E> {
    let Animation { width, height, frames, fps } = animation;
    let mut failed = None;
    let written = write_atomically(path, |file| {
        let mut encoder = png::Encoder::new(file, width, height);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        encoder.set_animated(frames, 0)?;
        encoder.set_frame_delay(1, fps.max(1))?;
        let mut writer = encoder.write_header()?;
        for number in 0..frames {
            let image = match frame(number) {
                Ok(image) if image.size() == (width, height) => image,
                Ok(image) => {
                    let (w, h) = image.size();
                    return Err(io::Error::other(format!("frame {number} is {w}x{h} px, not {width}x{height} px")));
                }
                Err(error) => {
                    failed = Some(error);
                    return Err(io::Error::other("a frame could not be made"));
                }
            };
            writer.write_image_data(&image.to_8_bits())?;
        }
        Ok(writer.finish()?)
    });
    match failed {
        Some(error) => Err(error),
        None => Ok(written?),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TWO: Animation = Animation { width: 4, height: 3, frames: 2, fps: 24 };

    fn grey(value: f32) -> Image {
        Image::filled(4, 3, [value; 3]).unwrap()
    }

    #[test]
    fn every_frame_is_in_the_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("turn.apng");
        write_animation::<Error>(&path, TWO, |k| Ok(grey(k as f32))).unwrap();
        let file = io::BufReader::new(std::fs::File::open(&path).unwrap());
        let mut reader = png::Decoder::new(file).read_info().unwrap();
        assert_eq!(reader.info().animation_control.unwrap().num_frames, 2);
        let mut frame = vec![0; 36];
        for expected in [0, 255] {
            reader.next_frame(&mut frame).unwrap();
            assert!(frame.iter().all(|v| *v == expected));
        }
        assert_eq!(crate::read_image(&path).unwrap().image, grey(0.0), "other readers show the first frame");
    }

    #[test]
    fn a_failed_animation_leaves_no_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("turn.apng");
        let missing = || Error::Missing { path: "frame".into() };
        let failed = write_animation(&path, TWO, |k| if k == 0 { Ok(grey(0.5)) } else { Err(missing()) });
        assert!(matches!(failed, Err(Error::Missing { .. })));
        let wide = write_animation::<Error>(&path, TWO, |_| Ok(Image::filled(5, 3, [0.0; 3]).unwrap()));
        assert!(wide.unwrap_err().to_string().contains("5x3 px, not 4x3 px"));
        assert!(write_animation::<Error>(&path, Animation { frames: 0, ..TWO }, |_| Ok(grey(0.0))).is_err());
        assert_eq!(folder.path().read_dir().unwrap().count(), 0);
    }
}
