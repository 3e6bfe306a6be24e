//! Cases of images: what is drawn, by which order, effects and settings, and what must not change it.

mod depths_3d;
mod dropout_3d;
mod images;
mod images_3d;
mod metamorphic;
mod metamorphic_3d;

pub(crate) use self::{depths_3d::*, dropout_3d::*, images::*, images_3d::*, metamorphic::*, metamorphic_3d::*};
