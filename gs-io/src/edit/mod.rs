//! Edits of 3D scenes: moving, aligning, cropping, filtering by a property, adding others.

mod align;
mod filter;
mod ground;

use std::{fmt, path::PathBuf, str::FromStr};

use glam::{DAffine3, DMat3, DQuat, DVec3, Vec2, Vec3};
use gs_core::{Region, Scene as _, Scene3d, counted, examination::Examinable as _};

pub use self::filter::Filter;
use self::{
    align::{Aligned, aligned},
    ground::up_of_ground,
};
use crate::{
    any_scene::{AnyScene, Values, read_scene},
    error::Error,
    scene3d::{File3d, transform_scene},
    world_frame::WorldFrame,
};

/// The up direction that viewers assume: y points down.
const UP: DVec3 = DVec3::NEG_Y;

/// An operation on a 3D scene. Places and lengths are in units of the scene.
///
/// Text is parsed as `gs edit --help` describes it:
///
/// ```
/// use gs_io::Edit;
///
/// assert!(matches!("crop=sphere:0,0,0,4".parse(), Ok(Edit::Crop { keep_inside: true, .. })));
/// assert!("crop=sphere:0,0,0".parse::<Edit>().unwrap_err().contains("sphere:X,Y,Z,RADIUS"));
/// ```
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Edit {
    /// Moves by a vector.
    Move(DVec3),
    /// Turns about an axis through the origin, counter-clockwise as seen from its tip.
    Turn {
        /// The axis, of length 1.
        axis: DVec3,
        /// The angle, rad.
        angle: f64,
    },
    /// Scales about the origin by a factor above 0.
    Scale(f64),
    /// Scales about the origin so that two points are a known length apart.
    ScaleFrom {
        /// The points, before.
        points: [DVec3; 2],
        /// Their distance afterwards, above 0.
        length: f64,
    },
    /// Turns about the origin so that a direction, of any length but 0, points up, which is −y. `None` stands for
    /// the direction across the plane that holds most Gaussians, among those within 45° of −y.
    Up(Option<DVec3>),
    /// Moves, turns and scales so that the cameras of the first data set, which is that of the scene, come to those of
    /// the second with the same images: those whose names agree, without folders and endings. The scene is then in
    /// the frame of the second one, as scenes that are trained with it. Both may be any data sets that
    /// [`read_dataset`](crate::dataset::read_dataset) reads.
    Align([PathBuf; 2]),
    /// Removes Gaussians by their means.
    Crop {
        /// The region.
        region: Region,
        /// Whether what is inside stays, or what is outside.
        keep_inside: bool,
    },
    /// Removes Gaussians by a property.
    Select {
        /// The condition.
        filter: Filter,
        /// Whether those stay for which it is true, or the others.
        keep: bool,
    },
    /// Adds the Gaussians of another 3D scene: a scene file, a checkpoint or an output folder. Where both scenes
    /// have frames in a world, it is taken to be the same world, and the other scene is moved into the frame of this
    /// one. How the other scene was trained is not kept.
    Add(PathBuf),
    /// Removes Gaussians that hang in front of what the views show, at a loss of at most this PSNR, dB. It needs views.
    Floaters(f64),
}

/// What an [`Edit`] did to a scene or to a part of it; its text says so in a few words.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Done {
    /// It changed the scene, as the text says.
    Changed(String),
    /// It removed Gaussians.
    Removed {
        /// How many it removed.
        gone: usize,
        /// Of how many.
        of: usize,
    },
}

impl fmt::Display for Done {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Changed(text) => f.write_str(text),
            Self::Removed { gone, of } => write!(f, "removed {} of {of}", counted(*gone, "Gaussian")),
        }
    }
}

impl Done {
    /// What was done to a scene whose parts were edited one after the other; `next` is that of the next part.
    #[must_use]
    pub fn and(self, next: Self) -> Self {
        match (self, next) {
            (Self::Removed { gone, of }, Self::Removed { gone: more, of: others }) => {
                Self::Removed { gone: gone + more, of: of + others }
            }
            (_, next) => next,
        }
    }

    /// Fails if nothing is left of the scene.
    ///
    /// # Errors
    /// [`EditError::NothingLeft`].
    pub fn check(self) -> Result<Self, EditError> {
        match self {
            Self::Removed { gone, of } if gone == of => Err(EditError::NothingLeft),
            done => Ok(done),
        }
    }
}

/// Why an [`Edit`] cannot be done.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum EditError {
    /// No Gaussian would stay.
    #[error("nothing would be left of the scene")]
    NothingLeft,
    /// A length was given for two points that are the same.
    #[error("the two points are the same")]
    SamePoints,
    /// Numbers of 32 bits don't hold the result.
    #[error("the result does not fit into numbers of 32 bits")]
    TooFar,
    /// The edit needs the views of a data set, which gs-train's `ViewEditor` has.
    #[error("it needs the views of a data set that shows the scene")]
    NeedsViews,
    /// The scene lies in no plane.
    #[error("no ground was found: name the direction that should point up, as in up=0.1,-1,0")]
    NoGround,
    /// One of two scenes has a frame in a world, and the other has none.
    #[error(
        "only one of the scenes has a frame in a world, so their places do not fit together: join them before one is \
         moved, or take both out of their frames, as move=0,0,0 does"
    )]
    OtherWorld,
    /// Two data sets have too few images in common to align a scene.
    #[error(
        "the data sets have {shared} images in common whose cameras are apart, and at least 2 are needed: names of \
         images must agree, without folders and endings"
    )]
    FewCameras {
        /// Number of images that both have.
        shared: usize,
    },
    /// The cameras of the same images are at places that no motion makes agree.
    #[error("the cameras of the images that both data sets have are not arranged alike: are these the same images?")]
    OtherCameras,
    /// The other scene, or a data set, cannot be read.
    #[error(transparent)]
    Read(Box<Error>),
}

impl From<Error> for EditError {
    fn from(error: Error) -> Self {
        Self::Read(Box::new(error))
    }
}

/// How operations are written.
const FORMS: &str = "move=X,Y,Z, turn=AXIS:DEGREES, scale=FACTOR, scale-from=X,Y,Z,X,Y,Z,LENGTH, up=X,Y,Z, \
     up=ground, align=DATASET,DATASET, crop=REGION, cut=REGION, keep=FILTER, drop=FILTER, add=FILE or floaters";

/// The usual limit of [`Edit::Floaters`], dB.
const MOST_LOSS: f64 = 0.05;

const REGIONS: &str = "box:X,Y,Z,X,Y,Z, sphere:X,Y,Z,RADIUS, plane:X,Y,Z,OFFSET or polygon:X,Z,X,Z,X,Z";

impl FromStr for Edit {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (name, value) = text.split_once('=').unwrap_or((text, ""));
        let written = |form: &str| format!("write it as {name}={form}");
        match name {
            "move" => vector(value).map(Self::Move).ok_or_else(|| written("X,Y,Z")),
            "turn" => turn(value).ok_or_else(|| written("AXIS:DEGREES, such as turn=y:90 or turn=1,1,0:45")),
            "scale" => match numbers(value).as_deref() {
                Some([factor]) if *factor > 0.0 => Ok(Self::Scale(*factor)),
                _ => Err(written("FACTOR, above 0")),
            },
            "scale-from" => match numbers(value).as_deref() {
                Some(&[a, b, c, d, e, f, length]) if length > 0.0 => {
                    Ok(Self::ScaleFrom { points: [DVec3::new(a, b, c), DVec3::new(d, e, f)], length })
                }
                _ => Err(written("X,Y,Z,X,Y,Z,LENGTH: two points of the scene, and how far apart they are")),
            },
            "up" if value == "ground" => Ok(Self::Up(None)),
            "up" => match vector(value).filter(|up| up.length_squared() > 0.0) {
                Some(up) => Ok(Self::Up(Some(up))),
                None => Err("write it as up=X,Y,Z, a direction, or up=ground".to_owned()),
            },
            "align" => match value.split(',').collect::<Vec<_>>()[..] {
                [from, to] if !from.is_empty() && !to.is_empty() => Ok(Self::Align([from.into(), to.into()])),
                _ => Err(written("DATASET,DATASET: that of the scene, and the one to whose cameras it is moved")),
            },
            "crop" | "cut" => region(value)
                .map(|region| Self::Crop { region, keep_inside: name == "crop" })
                .ok_or_else(|| written(REGIONS)),
            "keep" | "drop" => value.parse().map(|filter| Self::Select { filter, keep: name == "keep" }),
            "add" if !value.is_empty() => Ok(Self::Add(value.into())),
            "floaters" if text == name => Ok(Self::Floaters(MOST_LOSS)),
            "floaters" => match numbers(value).as_deref() {
                Some([most]) if *most >= 0.0 => Ok(Self::Floaters(*most)),
                _ => Err(written("DB, the most that it may cost of the PSNR, such as floaters=0.05")),
            },
            _ => Err(format!("an operation is {FORMS}")),
        }
    }
}

fn numbers(text: &str) -> Option<Vec<f64>> {
    let values: Option<Vec<f64>> = text.split(',').map(|part| part.trim().parse().ok()).collect();
    values.filter(|values| values.iter().all(|value| value.is_finite() && value.abs() < f64::from(f32::MAX)))
}

fn vector(text: &str) -> Option<DVec3> {
    let numbers: [f64; 3] = numbers(text)?.try_into().ok()?;
    Some(numbers.into())
}

fn turn(text: &str) -> Option<Edit> {
    let (axis, degrees) = text.rsplit_once(':')?;
    let axis = match axis {
        "x" => DVec3::X,
        "y" => DVec3::Y,
        "z" => DVec3::Z,
        other => vector(other)?.try_normalize()?,
    };
    let [degrees] = numbers(degrees)?.try_into().ok()?;
    Some(Edit::Turn { axis, angle: f64::to_radians(degrees) })
}

fn region(text: &str) -> Option<Region> {
    let (kind, values) = text.split_once(':')?;
    let values: Vec<f32> = numbers(values)?.into_iter().map(|value| value as f32).collect();
    let at = |index: usize| Vec3::from_slice(&values[index..]);
    match (kind, values.len()) {
        ("box", 6) => Some(Region::Box { min: at(0).min(at(3)), max: at(0).max(at(3)) }),
        ("sphere", 4) if values[3] > 0.0 => Some(Region::Sphere { center: at(0), radius: values[3] }),
        ("plane", 4) if at(0) != Vec3::ZERO => Some(Region::HalfSpace { normal: at(0), offset: values[3] }),
        ("polygon", length) if length >= 6 && length.is_multiple_of(2) => {
            let corners = values.chunks_exact(2).map(Vec2::from_slice).collect();
            Some(Region::Prism { corners })
        }
        _ => None,
    }
}

impl Edit {
    /// Whether only views of the scene can tell what it does.
    pub fn needs_views(&self) -> bool {
        match self {
            Self::Floaters(_) => true,
            Self::Select { filter, .. } => filter.needs_views(),
            _ => false,
        }
    }

    /// Whether it looks at one Gaussian at a time, so that a scene may be edited part by part.
    pub fn is_local(&self) -> bool {
        !self.needs_views() && !matches!(self, Self::Up(None) | Self::Align(_) | Self::Add(_))
    }

    /// The map by which it moves, turns or scales a scene in this frame; `None` for other edits.
    ///
    /// # Errors
    /// [`EditError::SamePoints`] and [`EditError::NoGround`]; for [`Self::Align`], [`EditError::FewCameras`],
    /// [`EditError::OtherCameras`] and [`EditError::Read`].
    pub fn map(&self, scene: &Scene3d, frame: WorldFrame) -> Result<Option<DAffine3>, EditError> {
        let turned = |rotation| DAffine3::from_mat3(DMat3::from_quat(rotation));
        let scaled = |factor| DAffine3::from_mat3(DMat3::from_diagonal(DVec3::splat(factor)));
        Ok(Some(match self {
            Self::Move(shift) => DAffine3::from_translation(*shift),
            Self::Turn { axis, angle } => turned(DQuat::from_axis_angle(*axis, *angle)),
            Self::Scale(factor) => scaled(*factor),
            Self::ScaleFrom { points: [a, b], length } => {
                scaled(Some(length / a.distance(*b)).filter(|factor| factor.is_finite()).ok_or(EditError::SamePoints)?)
            }
            Self::Up(direction) => {
                let up = direction.or_else(|| up_of_ground(scene)).ok_or(EditError::NoGround)?;
                turned(DQuat::from_rotation_arc(up.normalize(), UP))
            }
            Self::Align(datasets) => aligned(datasets, frame)?.map.to_affine(),
            Self::Crop { .. } | Self::Select { .. } | Self::Add(_) | Self::Floaters(_) => return Ok(None),
        }))
    }

    /// Does it, and says what it did. What moves, turns or scales a scene takes it out of its frame in the world;
    /// [`Self::Align`] takes it to that of another scene.
    /// The scene may be a part of a larger one if the edit [is local](Self::is_local): [`Done::check`] fails where
    /// nothing is left.
    ///
    /// # Errors
    /// [`EditError`]. The scene may have changed.
    pub fn apply(&self, scene: &mut Scene3d, frame: &mut WorldFrame) -> Result<Done, EditError> {
        if let Self::Align(datasets) = self {
            let Aligned { map, frame: of_other, shared, apart } = aligned(datasets, *frame)?;
            moved(scene, frame, &map.to_affine())?;
            *frame = of_other;
            let percent = 100.0 * apart;
            return Ok(Done::Changed(format!("aligned by {shared} cameras, to {percent:.2} % of their spread")));
        }
        if let Some(map) = self.map(scene, *frame)? {
            return moved(scene, frame, &map);
        }
        match self {
            Self::Crop { region, keep_inside } => Ok(retained(
                scene,
                &scene.means.iter().map(|m| region.contains(*m) == *keep_inside).collect::<Vec<_>>(),
            )),
            Self::Select { filter, keep } => {
                let holds = filter.holds(scene).ok_or(EditError::NeedsViews)?;
                Ok(retained(scene, &holds.iter().map(|holds| holds == keep).collect::<Vec<_>>()))
            }
            Self::Add(path) => match read_scene(path, Values::Checked)?.scene {
                AnyScene::ThreeD(other) => added(scene, *frame, *other),
                AnyScene::TwoD(_) => Err(Error::unsupported(path, "a 2D scene", "add a 3D scene").into()),
            },
            _ => Err(EditError::NeedsViews),
        }
    }
}

/// Applies a map, and says what that did. The coordinates are no longer those of a data set.
fn moved(scene: &mut Scene3d, frame: &mut WorldFrame, map: &DAffine3) -> Result<Done, EditError> {
    // Nothing is lost by rotations and scales.
    let _stretched = transform_scene(scene, map);
    *frame = WorldFrame::WORLD;
    scene.validate().map_err(|_| EditError::TooFar)?;
    let (scale, rotation, _) = map.to_scale_rotation_translation();
    let up = rotation.inverse() * UP;
    Ok(Done::Changed(match (rotation.is_near_identity(), scale.x) {
        (false, _) => format!("turned; ({:.3}, {:.3}, {:.3}) now points up", up.x, up.y, up.z),
        (true, scale) if scale != 1.0 => format!("scaled by {scale}"),
        _ => "moved".to_owned(),
    }))
}

/// Keeps some of the Gaussians.
fn retained(scene: &mut Scene3d, keep: &[bool]) -> Done {
    scene.retain(keep);
    Done::Removed { gone: keep.iter().filter(|keep| !**keep).count(), of: keep.len() }
}

/// Adds a scene. Where both are in frames of a world, it is the same world.
fn added(scene: &mut Scene3d, frame: WorldFrame, mut other: File3d) -> Result<Done, EditError> {
    let other_frame = other.trained_with.frame;
    if other_frame != frame && (other_frame.is_world() || frame.is_world()) {
        return Err(EditError::OtherWorld);
    }
    other.move_to(frame);
    other.scene.validate().map_err(|_| EditError::TooFar)?;
    let (number, before) = (other.scene.len(), scene.sh_degree);
    scene.append(other.scene);
    let degree = scene.sh_degree;
    let degrees = if before == degree { String::new() } else { format!("; SH degree {before} became {degree}") };
    let losses: String = other.losses.iter().map(|loss| format!("; {loss}")).collect();
    Ok(Done::Changed(format!("added {}{degrees}{losses}", counted(number, "Gaussian"))))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parsed(text: &str) -> Result<Edit, String> {
        text.parse()
    }

    #[test]
    fn operations_are_parsed() {
        assert_eq!(parsed("move=1, -2,0.5"), Ok(Edit::Move(DVec3::new(1.0, -2.0, 0.5))));
        assert_eq!(parsed("turn=-1,0,0:180"), Ok(Edit::Turn { axis: DVec3::NEG_X, angle: std::f64::consts::PI }));
        let corners = Edit::Crop { region: Region::Box { min: Vec3::ZERO, max: Vec3::ONE }, keep_inside: true };
        assert_eq!(parsed("crop=box:1,0,1,0,1,0"), Ok(corners));
        let above = Region::HalfSpace { normal: Vec3::NEG_Y, offset: 0.2 };
        assert_eq!(parsed("cut=plane:0,-1,0,0.2"), Ok(Edit::Crop { region: above, keep_inside: false }));
        assert_eq!(parsed("add=a=b.ply"), Ok(Edit::Add("a=b.ply".into())));
        for (text, part) in [
            ("", "an operation is move="),
            ("move=1,2", "write it as move=X,Y,Z"),
            ("move=1,2,nan", "write it as move=X,Y,Z"),
            ("turn=90", "turn=y:90"),
            ("turn=0,0,0:90", "turn=y:90"),
            ("scale=0", "above 0"),
            ("scale-from=0,0,0,1,0,0,-2", "how far apart"),
            ("up=0,0,0", "a direction"),
            ("world", "an operation is"),
            ("crop=sphere:0,0,0,0", "sphere:X,Y,Z,RADIUS"),
            ("crop=polygon:0,0,1,1", "polygon:X,Z,X,Z,X,Z"),
            ("drop=opacity", "such as opacity<0.02"),
            ("drop=colour<1", "`colour` is no property"),
            ("keep=x>=wide", "`wide` is not a number"),
            ("add=", "an operation is"),
            ("align=here", "align=DATASET,DATASET"),
            ("floaters=-1", "the most that it may cost"),
        ] {
            let error = parsed(text).unwrap_err();
            assert!(error.contains(part), "{text}: {error}");
        }
    }
}
