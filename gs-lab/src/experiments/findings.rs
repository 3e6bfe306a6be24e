//! The findings of an experiment in a form for reports: claims with verdicts, charts, tables and
//! pictures.

use gs_core::{Canvas, Image, Scene2d};

use crate::{
    report::{
        Table,
        figure::{Figure, ellipses},
    },
    result::Claim,
};

/// The results of an experiment.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Findings {
    /// The method in a few sentences: target, settings, number of fits.
    pub method: String,
    /// The paper's claims, with what was measured.
    pub claims: Vec<Claim>,
    /// Curves.
    pub charts: Vec<Figure>,
    /// Numbers in rows.
    pub tables: Vec<Table>,
    /// Reconstructions.
    pub pictures: Vec<Picture>,
}

impl Findings {
    /// Adds those of another part of the experiment.
    pub fn add(&mut self, mut other: Self) {
        let space = if self.method.is_empty() { "" } else { " " };
        self.method += &(space.to_owned() + &other.method);
        self.claims.append(&mut other.claims);
        self.charts.append(&mut other.charts);
        self.tables.append(&mut other.tables);
        self.pictures.append(&mut other.pictures);
    }
}

/// A picture, with ellipses that are drawn over it.
#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    /// File name without extension, in kebab-case.
    pub name: &'static str,
    /// The caption: what the picture shows.
    pub caption: String,
    /// The pixels, not clamped.
    pub image: Image,
    /// Gaussians to draw as ellipses, and the canvas that the image shows.
    pub ellipses: Option<(Scene2d, Canvas)>,
}

impl Picture {
    /// The pixels with the ellipses drawn over them.
    pub(crate) fn drawn(&self) -> Image {
        let mut image = self.image.clone();
        if let Some((scene, canvas)) = &self.ellipses {
            ellipses::draw(&mut image, scene, canvas);
        }
        image
    }
}
