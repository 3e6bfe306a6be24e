//! Edges and blobs (paper §3.3, Fig. 7): positions, sizes and shapes of the Gaussians near the hard
//! edge of the square and near the soft edge of the disc.

use glam::Vec2;
use gs_core::{Gaussian2d, Optimizer, Scene2d, sigmoid};

use super::{
    Cell, Circumstance, Claim, Findings, Laboratory, Number, Picture, Table,
    laboratory::{Ellipses, Shown},
    paired::{mean, median},
};
use crate::report::figure::{Axis, Figure, Marks, Series};
use gs_train::{Error, FitSettings, PAPER_DISC, PAPER_SIDE_PX, PAPER_SQUARE, paper_target};

/// Half the width of the zone around an edge, px. The disc's edge rises from 12 % to 88 % within
/// it.
pub(crate) const ZONE_PX: f32 = 4.0;

/// Gaussians of less opacity are not counted: they are about to be pruned.
const LEAST_OPACITY: f32 = 0.05;

/// A Gaussian whose scales have at least this ratio has a direction.
const DIRECTED: f32 = 1.5;

/// A part of the paper's target.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) enum Zone {
    /// The pixels within [`ZONE_PX`] of the square's border.
    SquareEdge,
    /// Further inside the square.
    SquareInside,
    /// The pixels within [`ZONE_PX`] of the circle on which the disc covers half a pixel.
    DiscEdge,
    /// Further inside the disc.
    DiscInside,
    /// Outside of both shapes.
    Background,
}

impl Zone {
    pub(crate) const ALL: [Self; 5] =
        [Self::SquareEdge, Self::SquareInside, Self::DiscEdge, Self::DiscInside, Self::Background];

    /// The name in reports.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::SquareEdge => "the square's edge",
            Self::SquareInside => "inside the square",
            Self::DiscEdge => "the disc's edge",
            Self::DiscInside => "inside the disc",
            Self::Background => "background",
        }
    }

    /// The zone of a position, px.
    pub(crate) fn of(place: Vec2) -> Self {
        let (square, disc) = (from_square(place), from_disc(place));
        if square.abs() <= ZONE_PX {
            Self::SquareEdge
        } else if square < 0.0 {
            Self::SquareInside
        } else if disc.abs() <= ZONE_PX {
            Self::DiscEdge
        } else if disc < 0.0 {
            Self::DiscInside
        } else {
            Self::Background
        }
    }
}

/// Distance from the square's border, px; negative inside.
fn from_square(place: Vec2) -> f32 {
    let (low, high) = PAPER_SQUARE;
    let outside = (low - place).max(place - high);
    if outside.max_element() <= 0.0 { outside.max_element() } else { outside.max(Vec2::ZERO).length() }
}

/// Distance from the circle on which the disc covers half a pixel, px; negative inside.
fn from_disc(place: Vec2) -> f32 {
    let (center, radius) = PAPER_DISC;
    place.distance(center) - radius
}

/// The direction of the nearest edge, rad.
fn along_edge(place: Vec2, zone: Zone) -> f32 {
    match zone {
        Zone::SquareEdge => {
            let (low, high) = PAPER_SQUARE;
            let to_sides = (place - low).abs().min((place - high).abs());
            if to_sides.x < to_sides.y { std::f32::consts::FRAC_PI_2 } else { 0.0 }
        }
        _ => (place - PAPER_DISC.0).to_angle() + std::f32::consts::FRAC_PI_2,
    }
}

/// The Gaussians in a zone, over all seeds.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Population {
    pub(crate) zone: Zone,
    /// Area of the zone, px².
    pub(crate) area_px2: f64,
    /// Mean number of Gaussians per fit.
    pub(crate) count: f64,
    /// Gaussians per 100 px² of the zone, one value per seed.
    pub(crate) per_100_px2: Vec<f64>,
    /// Median ratio of the longer scale to the shorter, one value per seed.
    pub(crate) anisotropy: Vec<f64>,
    /// Median √(σ₁σ₂), px, one value per seed.
    pub(crate) size_px: Vec<f64>,
    /// Median angle between the long axis and the nearest edge, degrees, of Gaussians that have a
    /// direction; 45 is chance.
    pub(crate) off_edge_degrees: f64,
}

/// The results of the experiment.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct EdgesMeasured {
    /// Zone by zone, as in [`Zone::ALL`].
    pub(crate) populations: Vec<Population>,
    /// Number of fits.
    pub(crate) seeds: u32,
    density_by_distance: Vec<Series>,
    anisotropy_by_distance: Vec<Series>,
    picture: Picture,
}

/// Fits the paper's target as the paper does, with several seeds, and evaluates where the Gaussians
/// are.
pub(crate) fn measure<R: Optimizer<Scene2d>>(laboratory: &mut Laboratory<'_, R>) -> Result<EdgesMeasured, Error> {
    let target = paper_target();
    let seeds = laboratory.extent().seeds(8, 2);
    let mut scenes = Vec::new();
    for seed in seeds.clone() {
        let settings = FitSettings::paper().with(|s| s.seed = seed);
        scenes.push(laboratory.fit(&format!("seed {seed}"), &target, settings)?.fit.scene);
    }
    let shown = Shown { size: target.size(), render: &FitSettings::paper().render, ellipses: Ellipses::Drawn };
    let caption = "The 600 Gaussians of seed 0 as ellipses of one standard deviation.";
    let picture = laboratory.picture("ellipses", caption, &scenes[0], shown)?;
    let populations = Zone::ALL.map(|zone| population(zone, &scenes)).to_vec();
    let by_distance = |value: fn(&[Gaussian2d], f64) -> f64| {
        vec![
            Series::dotted("the square's edge", binned(&scenes, from_square, value)),
            Series::dotted("the disc's edge", binned(&scenes, from_disc, value)),
        ]
    };
    Ok(EdgesMeasured {
        populations,
        seeds: seeds.end,
        density_by_distance: by_distance(|gaussians, area| 100.0 * gaussians.len() as f64 / area),
        anisotropy_by_distance: by_distance(|gaussians, _| median(gaussians.iter().map(anisotropy))),
        picture,
    })
}

fn counted(scene: &Scene2d) -> impl Iterator<Item = Gaussian2d> + '_ {
    scene.iter().filter(|g| sigmoid(g.opacity_logit) >= LEAST_OPACITY)
}

fn anisotropy(g: &Gaussian2d) -> f64 {
    f64::from((g.log_scale.max_element() - g.log_scale.min_element()).exp())
}

/// The pixel centres of the target.
fn pixel_centers() -> impl Iterator<Item = Vec2> {
    (0..PAPER_SIDE_PX).flat_map(|y| (0..PAPER_SIDE_PX).map(move |x| Vec2::new(x as f32, y as f32) + 0.5))
}

fn population(zone: Zone, scenes: &[Scene2d]) -> Population {
    let area_px2 = pixel_centers().filter(|&p| Zone::of(p) == zone).count() as f64;
    let within = |scene| counted(scene).filter(|g| Zone::of(g.mean) == zone).collect::<Vec<_>>();
    let by_seed: Vec<Vec<Gaussian2d>> = scenes.iter().map(within).collect();
    let each = |value: fn(&Gaussian2d) -> f64| by_seed.iter().map(|g| median(g.iter().map(value))).collect();
    let off_edge = |g: &Gaussian2d| {
        let long_axis = g.rotation + if g.log_scale.x >= g.log_scale.y { 0.0 } else { std::f32::consts::FRAC_PI_2 };
        let turned = (long_axis - along_edge(g.mean, zone)).rem_euclid(std::f32::consts::PI);
        f64::from(turned.min(std::f32::consts::PI - turned).to_degrees())
    };
    let directed = by_seed.iter().flatten().filter(|g| anisotropy(g) >= f64::from(DIRECTED));
    Population {
        zone,
        area_px2,
        count: mean(by_seed.iter().map(|g| g.len() as f64)),
        per_100_px2: by_seed.iter().map(|g| 100.0 * g.len() as f64 / area_px2).collect(),
        anisotropy: each(anisotropy),
        size_px: each(|g| f64::from((0.5 * g.log_scale.element_sum()).exp())),
        off_edge_degrees: median(directed.map(off_edge)),
    }
}

/// `value` of the Gaussians of all scenes and of the area, in bins of 2 px of the distance from an
/// edge.
fn binned(scenes: &[Scene2d], distance: fn(Vec2) -> f32, value: fn(&[Gaussian2d], f64) -> f64) -> Vec<(f64, f64)> {
    (-9..8)
        .filter_map(|bin| {
            let (from, to) = (2.0 * bin as f32, 2.0 * bin as f32 + 2.0);
            let is_within = |place: Vec2| (from..to).contains(&distance(place));
            let gaussians: Vec<_> = scenes.iter().flat_map(counted).filter(|g| is_within(g.mean)).collect();
            let area = pixel_centers().filter(|&p| is_within(p)).count() * scenes.len();
            (!gaussians.is_empty()).then(|| (f64::from(from) + 1.0, value(&gaussians, area as f64)))
        })
        .collect()
}

/// Counts the seeds for which one value is less than another.
fn seeds_with(what: &str, less: &[f64], more: &[f64]) -> Circumstance {
    Circumstance::counted(
        format!("seeds whose Gaussians are {what}"),
        less.iter().zip(more).map(|(less, more)| less < more),
    )
}

impl EdgesMeasured {
    /// The Gaussians in a zone.
    pub(crate) fn population(&self, zone: Zone) -> &Population {
        self.populations.iter().find(|p| p.zone == zone).expect("all zones are measured")
    }

    pub(crate) fn findings(&self) -> Findings {
        Findings {
            method: format!(
                "The paper's fit (20 Gaussians to 600 in 2,500 steps), seeds 0 to {}. A Gaussian belongs to the edge within \
                 {ZONE_PX} px of which its mean lies; those of less than {LEAST_OPACITY} opacity are not counted. Medians are taken \
                 in each fit, and their means shown.",
                self.seeds - 1
            ),
            claims: vec![self.shape_claim(), self.share_claim()],
            charts: vec![
                Figure {
                    name: "density-by-distance".to_owned(),
                    title: "Density by distance from an edge".to_owned(),
                    x: Axis::linear("distance from the edge, px (negative: inside)"),
                    y: Axis::linear("Gaussians per 100 px²"),
                    marks: Marks::lines(self.density_by_distance.clone()),
                },
                Figure {
                    name: "anisotropy-by-distance".to_owned(),
                    title: "Anisotropy by distance from an edge".to_owned(),
                    x: Axis::linear("distance from the edge, px (negative: inside)"),
                    y: Axis::linear("median σ_long / σ_short"),
                    marks: Marks::lines(self.anisotropy_by_distance.clone()),
                },
            ],
            tables: vec![self.table()],
            pictures: vec![self.picture.clone()],
        }
    }

    fn shape_claim(&self) -> Claim {
        let (square, disc) = (self.population(Zone::SquareEdge), self.population(Zone::DiscEdge));
        let [dense, disc_dense] = [square, disc].map(|p| mean(p.per_100_px2.iter().copied()));
        let [long, disc_long] = [square, disc].map(|p| mean(p.anisotropy.iter().copied()));
        let [size, disc_size] = [square, disc].map(|p| mean(p.size_px.iter().copied()));
        Claim {
            name: "edges-are-dense-and-stretched",
            statement: "Density control crowds the square's hard edges with small Gaussians that are strongly stretched.",
            section: "§3.3, Fig. 7",
            circumstances: vec![
                seeds_with("denser there than at the disc's soft edge", &disc.per_100_px2, &square.per_100_px2),
                seeds_with("smaller there than at the disc's", &square.size_px, &disc.size_px),
                seeds_with("more stretched there than at the disc's", &disc.anisotropy, &square.anisotropy),
            ],
            measured: format!(
                "Near the square's edge stand {dense:.1} Gaussians per 100 px² of median size {size:.2} px, {long:.1} times as long as \
                 broad, their long axes {:.0}° off the edge (45° would be chance); near the disc's soft edge {disc_dense:.1}, of \
                 {disc_size:.2} px, {disc_long:.1} times.",
                square.off_edge_degrees
            ),
            numbers: vec![
                Number::new("density at the square's edge", dense, "per 100 px²"),
                Number::new("density at the disc's edge", disc_dense, "per 100 px²"),
                Number::new("anisotropy at the square's edge", long, ""),
                Number::new("anisotropy at the disc's edge", disc_long, ""),
                Number::new("size at the square's edge", size, "px"),
                Number::new("size at the disc's edge", disc_size, "px"),
            ],
        }
    }

    /// The number of Gaussians on a shape, and their median sizes in px averaged over its edge and
    /// inside by count; one value per seed.
    fn shape(&self, edge: Zone, inside: Zone) -> (Vec<f64>, Vec<f64>) {
        let parts = [self.population(edge), self.population(inside)];
        let of_seed = |seed: usize| {
            let (mut count, mut sizes) = (0.0, 0.0);
            for part in parts {
                let here = part.per_100_px2[seed] * part.area_px2 / 100.0;
                count += here;
                sizes += if here > 0.0 { here * part.size_px[seed] } else { 0.0 };
            }
            (count, sizes / count)
        };
        (0..self.seeds as usize).map(of_seed).unzip()
    }

    fn share_claim(&self) -> Claim {
        let (squares, square_sizes) = self.shape(Zone::SquareEdge, Zone::SquareInside);
        let (discs, disc_sizes) = self.shape(Zone::DiscEdge, Zone::DiscInside);
        let [square, square_size, disc, disc_size] =
            [&squares, &square_sizes, &discs, &disc_sizes].map(|values| mean(values.iter().copied()));
        Claim {
            name: "the-disc-needs-fewer",
            statement: "The soft disc needs fewer Gaussians than the square, and larger ones.",
            section: "§3.1, §3.3",
            circumstances: vec![
                seeds_with("fewer on the disc", &discs, &squares),
                seeds_with("larger on the disc", &square_sizes, &disc_sizes),
            ],
            measured: format!(
                "On average {disc:.0} Gaussians of {disc_size:.2} px stand on the disc and {square:.0} of {square_size:.2} px on the \
                 square."
            ),
            numbers: vec![
                Number::new("Gaussians on the disc", disc, ""),
                Number::new("Gaussians on the square", square, ""),
                Number::new("their size on the disc", disc_size, "px"),
                Number::new("their size on the square", square_size, "px"),
            ],
        }
    }

    fn table(&self) -> Table {
        let row = |p: &Population| {
            let average = |values: &[f64]| mean(values.iter().copied());
            vec![
                p.zone.name().into(),
                Cell::Fixed(p.area_px2, 0),
                Cell::Fixed(p.count, 1),
                Cell::Fixed(average(&p.per_100_px2), 2),
                Cell::Fixed(average(&p.anisotropy), 2),
                Cell::Fixed(average(&p.size_px), 2),
                match p.zone {
                    Zone::SquareEdge | Zone::DiscEdge => Cell::Fixed(p.off_edge_degrees, 1),
                    _ => Cell::Empty,
                },
            ]
        };
        Table {
            name: "zones",
            title: "Where the Gaussians are".to_owned(),
            columns: vec![
                "zone",
                "area, px²",
                "Gaussians",
                "per 100 px²",
                "σ_long / σ_short",
                "√(σ₁σ₂), px",
                "off the edge, °",
            ],
            rows: self.populations.iter().map(row).collect(),
        }
    }
}
