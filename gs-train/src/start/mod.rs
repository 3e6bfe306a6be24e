//! The first Gaussians of a 3D scene: from points of a reconstruction, from depth maps, from a search
//! in the images, or at random.

mod depths;
mod far_points;
mod init;
mod neighbours;
mod start_name;
mod sweep;

pub(crate) use self::init::is_zero;
pub use self::{
    init::{PointInit, Start},
    start_name::StartName,
};
