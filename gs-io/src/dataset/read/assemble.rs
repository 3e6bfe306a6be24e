//! Turns the content of a data set of any kind into usable views: finds the images, fits the
//! intrinsics to their size, splits, and counts what is left out.

use std::{
    collections::HashSet,
    f64::consts::{PI, TAU},
    fmt,
    path::{Path, PathBuf},
};

use glam::{DVec2, DVec3, dvec2};
use gs_core::{Camera, constants::NEAR_WORLD};

use super::{Finder, Place, tally::Tally};
use crate::{
    WorldFrame,
    dataset::{
        CubeFace, Dataset, DatasetKind, DatasetSettings, DepthFile, Distortion, Lens, Point, Remark, Skip,
        SourceCamera, Split, SplitOrigin, View, WorldPoint,
        camera::{Pose, is_two_to_one, shows_all_directions, wide_faces},
        images::{check_depth, resized, within},
        split,
    },
    error::Error,
    image::{ImageHeader, ImageRemark, Orientation, decode, read_header},
};

/// How much closer a principal point must be to the centre of the upright image than to that of the
/// image as it is stored to decide for the upright one.
const UPRIGHT_FACTOR: f64 = 2.0;

/// A view as the data set describes it.
#[derive(Debug, Clone)]
pub(crate) struct Draft {
    pub(crate) name: String,
    /// Path of the image below the image folder; `None` for an invalid name.
    pub(crate) file: Option<PathBuf>,
    pub(crate) mask: Option<PathBuf>,
    pub(crate) depth: Option<DepthFile>,
    /// The intrinsics, or why the view is left out.
    pub(crate) intrinsics: Result<Intrinsics, Refusal>,
    /// Where the intrinsics come from, for messages.
    pub(crate) stated: Stated,
    pub(crate) pose: Result<Pose, Skip>,
    /// `None` if the data set does not say.
    pub(crate) split: Option<Split>,
}

impl Draft {
    /// Takes the pose, and the unit of depths, from the world to a frame.
    fn move_to(&mut self, frame: &WorldFrame) {
        let is_finite = |pose: &Pose| pose.translation.as_vec3().is_finite();
        let pose = self.pose.map(|pose| pose.in_frame(frame));
        self.pose = pose.and_then(|pose| is_finite(&pose).then_some(pose).ok_or(Skip::BadPose));
        if let Some(DepthFile { unit: Some(unit), .. }) = &mut self.depth {
            *unit = (f64::from(*unit) / frame.unit) as f32;
        }
    }
}

/// The numbers of a camera as its file has them, for messages.
#[derive(Debug, Clone, Default)]
pub(crate) struct Stated {
    /// "transforms.json", "camera 7 of cameras.bin".
    pub(crate) place: String,
    pub(crate) numbers: Vec<(&'static str, f64)>,
}

impl fmt::Display for Stated {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let number = |(name, value): &(&str, f64)| match value.abs() {
            0.0 | 1e-3..1e6 => format!("{name} = {value}"),
            _ => format!("{name} = {value:e}"),
        };
        // Most coefficients of lenses are 0.
        let says = |(name, value): &&(&str, f64)| *value != 0.0 || !name.starts_with(['k', 'p', 's']);
        let numbers: Vec<String> = self.numbers.iter().filter(says).map(number).collect();
        write!(f, "{} has {}", self.place, numbers.join(", "))
    }
}

/// The calibration of a camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Intrinsics {
    pub(crate) focal: Focal,
    /// Principal point, px; by default the centre.
    pub(crate) center: Option<DVec2>,
    /// Columns and rows of the calibration, px; by default those of the image.
    pub(crate) size: Option<DVec2>,
    pub(crate) distortion: Distortion,
    /// Radius of the image circle about the principal point, px of the calibration, if it is stated.
    pub(crate) circle: Option<f64>,
}

impl Intrinsics {
    /// Those of a 360° image of this size.
    pub(crate) fn panorama(size: Option<DVec2>) -> Self {
        let distortion = Distortion::Equirectangular { face: CubeFace::default() };
        Self { focal: Focal::Sphere, center: None, size, distortion, circle: None }
    }

    /// The camera of an image of `width` × `height` px, calibrated at `calibrated` px.
    pub(crate) fn source(&self, calibrated: DVec2, (width, height): (u32, u32), lens: Lens) -> SourceCamera {
        let scale = dvec2(f64::from(width), f64::from(height)) / calibrated;
        let focal = match self.focal {
            Focal::Lengths(focal) => focal,
            Focal::Sphere => calibrated / dvec2(TAU, PI),
            Focal::Angles(x, y) => {
                let length = |side: f64, angle: Option<f64>| angle.map(|angle| 0.5 * side / (0.5 * angle).tan());
                let (x, y) = (length(calibrated.x, x), length(calibrated.y, y));
                dvec2(x.or(y).unwrap_or(f64::NAN), y.or(x).unwrap_or(f64::NAN))
            }
        };
        let center = self.center.unwrap_or(0.5 * calibrated) * scale;
        // The image circle is one in the image as it was calibrated.
        let lens = self.circle.map_or(lens, |radius| lens.within(radius / focal));
        SourceCamera { width, height, focal: focal * scale, center, lens }
    }
}

/// The field of view of a camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Focal {
    /// Focal lengths, px.
    Lengths(DVec2),
    /// Horizontal and vertical angle of view, rad. Without one of them, pixels are square.
    Angles(Option<f64>, Option<f64>),
    /// All directions: 2π over the width, π over the height.
    Sphere,
}

/// Whether two sizes are those of the same picture, apart from rounding to whole pixels.
pub(crate) fn same_shape((width, height): (u32, u32), (other_width, other_height): (f64, f64)) -> bool {
    let (width, height) = (f64::from(width), f64::from(height));
    // (w + a)·H = (h + b)·W with |a|, |b| < 1. False for NaN.
    (width * other_height - height * other_width).abs() < other_width + other_height
}

/// The result of a reader.
#[derive(Debug)]
pub(crate) struct Parts<'a> {
    pub(crate) kind: DatasetKind,
    pub(crate) root: &'a Path,
    pub(crate) drafts: Vec<Draft>,
    pub(crate) points: Vec<WorldPoint>,
    /// Folders that may contain the images; the first with an image of the name is used.
    pub(crate) places: Vec<Place>,
    /// Where the data set states its split; `None` if it has none.
    pub(crate) split: Option<SplitOrigin>,
    pub(crate) remarks: Vec<Remark>,
}

/// Assembles the data set.
pub(crate) fn assemble(parts: Parts<'_>, settings: &DatasetSettings) -> Result<Dataset, Error> {
    let Parts { kind, root, mut drafts, points, places, split, mut remarks } = parts;
    let found = drafts.len();
    let mut finder = Finder::new(root, &places, &drafts, &search_folders(root, settings));
    let mut tally = Tally::default();
    let mut names = HashSet::new();
    // The first in the file is kept of two views with the same name.
    drafts.retain(|draft| {
        let first = names.insert(draft.name.clone());
        if !first {
            tally.skip(&draft.name, Skip::SameName, None);
        }
        first
    });
    drafts.sort_by(|a, b| a.name.cmp(&b.name));
    let frame = settings.frame.unwrap_or_else(|| frame_of(&drafts, &points));
    if !frame.is_world() {
        remarks.extend(settings.frame.is_none().then(|| Remark::Frame { frame: frame.to_string() }));
        drafts.iter_mut().for_each(|draft| draft.move_to(&frame));
    }
    let mut lenses = Lenses::default();
    let mut unused_depths = 0;
    // Of each image, its number of views and its split in the data set.
    let (mut views, mut images) = (Vec::new(), Vec::new());
    for draft in &drafts {
        match make_views(draft, &mut finder, settings, &mut lenses) {
            Ok(Made { views: made, calibrated, renamed, remarks }) => {
                tally.count(&made, calibrated, &remarks);
                if renamed {
                    tally.count_renamed(&draft.name, root, &made[0].image);
                }
                if let Some(Err(error)) = made[0].depth.as_ref().map(|depth| check_depth(&depth.path, &made[0].source))
                {
                    tally.count_bad_depth(&error);
                }
                unused_depths += usize::from(draft.depth.is_some() && made[0].depth.is_none());
                images.push((made.len(), draft.split));
                views.extend(made);
            }
            Err(Refusal { why: Skip::NoImage, .. }) if !tally.has(Skip::NoImage) => {
                let detail = draft.file.as_ref().and_then(|file| finder.near(file));
                tally.skip(&draft.name, Skip::NoImage, detail);
            }
            Err(Refusal { why, detail }) => tally.skip(&draft.name, why, detail),
        }
    }
    if views.is_empty() {
        let mut skipped: Vec<String> = tally.remarks().iter().map(ToString::to_string).collect();
        if found == 0 {
            skipped.push("it lists none".to_owned());
        }
        let outside = finder.outside;
        return Err(Error::NoViews { path: root.to_owned(), kind: kind.name(), found, skipped, outside });
    }
    if let Some(view) = unsplit_panorama(&views) {
        return Err(Error::UnsplitPanorama { path: view.image.clone() });
    }
    remarks.extend(tally.remarks());
    if let Some(place) = finder.place().filter(|_| finder.elsewhere) {
        let folder = place.folder.strip_prefix(root).unwrap_or(&place.folder);
        remarks.push(Remark::OtherFolder { folder: folder.display().to_string() });
    }
    if unused_depths > 0 {
        remarks.push(Remark::DepthsUnused { count: unused_depths });
    }
    let listed = points.len();
    let points = points_in(&frame, points);
    if points.len() < listed {
        remarks.push(Remark::PointsNotFinite { count: listed - points.len() });
    }
    let finite = points.len();
    let points = without_copies(points);
    if points.len() < finite {
        remarks.push(Remark::PointsCoincide { count: finite - points.len() });
    }
    if points.is_empty() && !remarks.iter().any(|remark| matches!(remark, Remark::PointsMissing { .. })) {
        remarks.push(Remark::NoPoints);
    }
    let Some(split) = split::apply(split, &mut views, &images, settings, &mut remarks) else {
        let skipped = remarks.iter().filter(|remark| matches!(remark, Remark::Skipped { .. }));
        let mut skipped: Vec<String> = skipped.map(ToString::to_string).collect();
        if skipped.is_empty() {
            skipped.push("its split lists none".to_owned());
        }
        return Err(Error::NoTrainingViews { path: root.to_owned(), skipped });
    };
    views.sort_by(|a, b| a.name.cmp(&b.name));
    Ok(Dataset { kind, root: root.to_owned(), frame, views, points, split, remarks })
}

/// The frame that suits the poses and points of a data set.
fn frame_of(drafts: &[Draft], points: &[WorldPoint]) -> WorldFrame {
    let cameras: Vec<DVec3> = drafts.iter().filter_map(|draft| Some(draft.pose.ok()?.position())).collect();
    let points: Vec<DVec3> = points.iter().map(|point| point.position).collect();
    WorldFrame::of(&cameras, &points)
}

/// The finite points, in a frame.
fn points_in(frame: &WorldFrame, points: Vec<WorldPoint>) -> Vec<Point> {
    let moved = |WorldPoint { position, color }| Point { position: frame.to_frame(position).as_vec3(), color };
    let is_finite = |point: &Point| point.position.is_finite() && point.color.iter().all(|c| c.is_finite());
    points.into_iter().map(moved).filter(is_finite).collect()
}

/// The points without those at the place of an earlier one, which some programs write for each image
/// that shows a point.
fn without_copies(mut points: Vec<Point>) -> Vec<Point> {
    let mut places = HashSet::with_capacity(points.len());
    // Adding 0 makes 0 of -0.
    points.retain(|point| places.insert((point.position + 0.0).to_array().map(f32::to_bits)));
    points
}

/// The first view of the shape of a 360° image with another camera model, if its borders are those of
/// a 360° image, too.
fn unsplit_panorama(views: &[View]) -> Option<&View> {
    let is_wide = |view: &&View| view.source.face().is_none() && is_two_to_one((view.source.width, view.source.height));
    let first = views.iter().find(is_wide)?;
    let image = decode(&first.image, first.orientation).ok()?.image;
    shows_all_directions(&image).then_some(first)
}

/// Folders below which images are searched that are in none of the usual ones.
pub(crate) fn search_folders(root: &Path, settings: &DatasetSettings) -> Vec<PathBuf> {
    match (&settings.image_folder, settings.allow_outside) {
        (Some(_), _) => Vec::new(),
        (None, false) => vec![root.to_owned()],
        (None, true) => vec![root.to_owned(), root.join("..")],
    }
}

/// A usable image.
struct Made {
    /// Its views: the faces of a 360° image or of a wide fish-eye, or one.
    views: Vec<View>,
    /// Columns and rows of its camera's calibration.
    calibrated: (u64, u64),
    /// Whether the name of its file differs from that of the data set.
    renamed: bool,
    /// Remarks on its image file.
    remarks: Vec<ImageRemark>,
}

/// Why a view cannot be used, with details if there are any.
#[derive(Debug, Clone)]
pub(crate) struct Refusal {
    pub(crate) why: Skip,
    pub(crate) detail: Option<String>,
}

impl From<Skip> for Refusal {
    fn from(why: Skip) -> Self {
        Self { why, detail: None }
    }
}

impl Refusal {
    pub(crate) fn new(why: Skip, detail: String) -> Self {
        Self { why, detail: Some(detail) }
    }

    /// A refusal because of a file that cannot be read. The view's name replaces the path at the
    /// beginning of the error.
    fn of_file(why: Skip, path: &Path, error: &Error) -> Self {
        let text = error.to_string();
        let detail = text.strip_prefix(&format!("{}: ", path.display())).unwrap_or(&text);
        Self::new(why, detail.to_owned())
    }
}

/// Makes the views of an image that fits its camera.
fn make_views(
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
        Ok(View { name, camera, full, source, image, orientation, mask, depth, alpha, split: Split::Train })
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
        // Of a camera without size, the principal point is near the centre of the right way.
        let distance = |side| intrinsics.center.map_or(0.0, |center| center.distance(0.5 * shrunk * sides(side)));
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
struct Lenses(Option<(Distortion, Option<(Lens, Lens)>)>);

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
