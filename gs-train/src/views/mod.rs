//! The views that a 3D scene is trained from: their images, order and sizes, and what follows from
//! their cameras.

mod cache;
mod color_map;
mod depth_fit;
mod faces;
pub(crate) mod geometry;
pub(crate) mod images;
mod order;
mod resolution;
mod view;
mod weights;

pub use self::{
    cache::ImageReading,
    geometry::{Focus, extent_of},
    resolution::Resolution,
    view::{Counting, ImageSource, PosedView, Views},
};
pub(crate) use self::{
    color_map::{ColorMap, ColorPair},
    depth_fit::{Fit, Sample, fits, samples, values_at},
    images::Images,
    order::Order,
    resolution::{possible, reduced, reduced_camera},
    view::STAND_INS,
    weights::{FOOTPRINT_ALPHA, blending_weights, color_gradients, colorless},
};
