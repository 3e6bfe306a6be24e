//! Makes views of an image: finds its file, fits the intrinsics to its size, and splits wide angles.

use std::path::Path;

use glam::{DVec2, dvec2};
use gs_core::{Camera, constants::NEAR_WORLD};

use super::{Draft, Finder, Refusal};
use crate::{
    dataset::{
        CubeFace, DatasetSettings, Distortion, Lens, Skip, SourceCamera, Split, View,
        camera::{Focal, Intrinsics, Pose, is_two_to_one, wide_faces},
        images::{resized, same_shape, within},
    },
    error::Error,
    image::{ImageHeader, ImageRemark, Orientation, read_header},
};

/// How much closer a principal point must be to the centre of the upright image than to that of the
/// image as it is stored to decide for the upright one; or the logarithm of its pixels' aspect ratio to 0.
const UPRIGHT_FACTOR: f64 = 2.0;

/// A usable image.
pub(crate) struct Made {
    /// Its views: the faces of a 360° image or of a wide fish-eye, or one.
    pub(crate) views: Vec<View>,
    /// Columns and rows of its camera's calibration.
    pub(crate) calibrated: (u64, u64),
    /// Whether the name of its file differs from that of the data set.
    pub(crate) renamed: bool,
    /// Remarks on its image file.
    pub(crate) remarks: Vec<ImageRemark>,
}

/// Makes the views of an image that fits its camera.
pub(crate) fn make_views(
    draft: &Draft,
    finder: &mut Finder<'_>,
    settings: &DatasetSettings,
    lenses: &mut Lenses,
) -> Result<Made, Refusal> {
    let bad_camera = |fault: &str| Refusal::new(Skip::BadCamera, format!("{fault}; {}", draft.stated));
    let intrinsics = draft.intrinsics.clone()?;
    let pose = draft.pose?;
    let found = draft.file.as_ref().and_then(|file| finder.find(file)).ok_or(Skip::NoImage)?;
    let (image, shrunk) = (found.path, finder.place().map_or(1.0, |place| place.shrunk));
    let header = read_header(&image).map_err(|error| Refusal::of_file(Skip::BadImage, &image, &error))?;
    let (orientation, size, calibrated) = fit(&intrinsics, &header, shrunk)?;
    if let Some(mask) = &draft.mask {
        check_mask(mask, size)?;
    }
    let panorama = intrinsics.focal == Focal::Sphere;
    if panorama && !is_two_to_one(size) {
        let detail = format!("it is {}x{} px", size.0, size.1);
        return Err(Refusal::new(Skip::Panorama, detail));
    }
    let (lens, wide) = lenses.get(intrinsics.distortion).ok_or_else(|| bad_camera("no such lens is possible"))?;
    let source = intrinsics.source(calibrated, size, lens);
    if let Some(fault) = source.fault() {
        return Err(bad_camera(&fault));
    }
    let faces = match panorama {
        true => Some(panorama_faces(&source)?),
        false => wide_faces(&source, &intrinsics.source(calibrated, size, wide).lens, intrinsics.circle.is_some()),
    };
    let view = |name: String, source: SourceCamera, pose: &Pose| {
        let full = camera(&source.pinhole(), pose)?;
        let camera = match settings.max_side {
            Some(max_side) => resized(&full, within((full.width, full.height), max_side.get())),
            None => full,
        };
        let (image, mask, alpha) = (image.clone(), draft.mask.clone(), settings.alpha);
        // Networks and sensors do not write depths for all directions in one convention.
        let depth = draft.depth.clone().filter(|_| source.face().is_none());
        let split = draft.split.unwrap_or(Split::Train);
        Ok(View { name, camera, full, source, image, orientation, mask, depth, alpha, split })
    };
    let face = |(face, source): (CubeFace, SourceCamera)| {
        view(format!("{}#{}", draft.name, face.name()), source, &face.pose(&pose))
    };
    let views = match faces {
        Some(faces) => faces.into_iter().map(face).collect::<Result<_, Skip>>()?,
        None => vec![view(draft.name.clone(), source, &pose)?],
    };
    let calibrated = (calibrated.x.round() as u64, calibrated.y.round() as u64);
    Ok(Made { views, calibrated, renamed: found.renamed, remarks: header.remarks })
}

/// The faces of a 360° image with their cameras.
fn panorama_faces(source: &SourceCamera) -> Result<Vec<(CubeFace, SourceCamera)>, Skip> {
    let of_face = |face| {
        let lens = Lens::new(Distortion::Equirectangular { face }).ok_or(Skip::BadCamera)?;
        Ok((face, SourceCamera { lens, ..*source }))
    };
    CubeFace::ALL.into_iter().map(of_face).collect()
}

/// Checks that a mask can be read and has the shape of its image.
fn check_mask(mask: &Path, (width, height): (u32, u32)) -> Result<(), Refusal> {
    let refused = |error: Error| Refusal::of_file(Skip::BadMask, mask, &error);
    let stored = read_header(mask).map_err(refused)?.stored;
    match same_shape(stored, (f64::from(width), f64::from(height))) {
        true => Ok(()),
        false => Err(refused(Error::image_shape(mask, stored, (width, height)))),
    }
}

fn camera(pinhole: &SourceCamera, pose: &Pose) -> Result<Camera, Skip> {
    let camera = Camera {
        rotation: pose.rotation.as_mat3(),
        translation: pose.translation.as_vec3(),
        focal: pinhole.focal.as_vec2(),
        center: pinhole.center.as_vec2(),
        width: pinhole.width,
        height: pinhole.height,
        near: NEAR_WORLD,
    };
    camera.validate().map(|()| camera).map_err(|_| Skip::BadCamera)
}

/// The orientation in which an image fits its camera, its size in that orientation, and the size of
/// the calibration.
fn fit(intrinsics: &Intrinsics, sizes: &ImageHeader, shrunk: f64) -> Result<(Orientation, (u32, u32), DVec2), Refusal> {
    let ways = [(Orientation::AsStored, sizes.stored), (Orientation::Exif, sizes.upright)];
    let sides = |(width, height): (u32, u32)| dvec2(f64::from(width), f64::from(height));
    let Some(size) = intrinsics.size else {
        // Of a camera without size, the principal point is near the centre of the right way, or its
        // pixels are square.
        let distance = |side| match (intrinsics.center, intrinsics.focal) {
            (Some(center), _) => center.distance(0.5 * shrunk * sides(side)),
            (None, Focal::Angles(Some(x), Some(y))) => {
                let focal = sides(side) / dvec2((0.5 * x).tan(), (0.5 * y).tan());
                (focal.x / focal.y).ln().abs()
            }
            (None, _) => 0.0,
        };
        let is_upright = UPRIGHT_FACTOR * distance(sizes.upright) < distance(sizes.stored);
        let (orientation, side) = ways[usize::from(is_upright)];
        return Ok((orientation, side, sides(side) * shrunk));
    };
    let refusal = |why| {
        let ((width, height), DVec2 { x, y }) = (sizes.stored, size);
        Refusal::new(why, format!("the camera has {x}x{y} px, the image {width}x{height} px"))
    };
    if !(size.min_element() >= 1.0) || !size.is_finite() {
        return Err(refusal(Skip::BadCamera));
    }
    let similar = |side: (u32, u32)| same_shape(side, (size.x, size.y));
    let way =
        ways.iter().find(|(_, side)| sides(*side) == size).or_else(|| ways.iter().find(|(_, side)| similar(*side)));
    way.map(|&(orientation, side)| (orientation, side, size)).ok_or_else(|| refusal(Skip::OtherShape))
}

/// Caches lenses, which neighbouring views share: checking one for folds takes a millisecond.
#[derive(Default)]
pub(crate) struct Lenses(Option<(Distortion, Option<(Lens, Lens)>)>);

impl Lenses {
    /// The lens to 89° from the axis, and to the angle at which it ends.
    fn get(&mut self, distortion: Distortion) -> Option<(Lens, Lens)> {
        match self.0 {
            Some((last, lens)) if last == distortion => lens,
            _ => {
                let lens = Lens::new(distortion).map(|lens| (lens, lens.wide()));
                self.0 = Some((distortion, lens));
                lens
            }
        }
    }
}
