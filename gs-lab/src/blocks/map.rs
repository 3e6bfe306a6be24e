//! A map of blocks: cells, cameras and counts.

use std::fmt::Write as _;

use glam::DVec2;
use gs_core::{Camera, duration, memory::amount};
use gs_train::blocks::{BlockPlan, BlocksPlan};

/// Longer side of the map, px.
const SIDE: f64 = 900.0;

/// What is shown around all cameras and bounds of cells, as a share of its sides.
const AROUND: f64 = 0.15;

/// The map of a plan as SVG, seen from above with the forward direction upwards. `cameras` are those of the training
/// views, `seconds` what each block is expected to take, if that is known.
pub fn map<'a>(plan: &BlocksPlan, cameras: impl IntoIterator<Item = &'a Camera>, seconds: &[f64]) -> String {
    let cameras: Vec<DVec2> = cameras.into_iter().map(|camera| plan.ground.place(camera.position())).collect();
    let (mut least, mut most) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
    cameras.iter().for_each(|place| (least, most) = (least.min(*place), most.max(*place)));
    for axis in [0, 1] {
        for bound in plan.blocks.iter().flat_map(|block| [block.cell.from[axis], block.cell.to[axis]]).flatten() {
            (least[axis], most[axis]) = (least[axis].min(bound), most[axis].max(bound));
        }
    }
    let around = AROUND * (most - least).max_element().max(1e-9);
    let (least, most) = (least - around, most + around);
    let zoom = SIDE / (most - least).max_element();
    let size = zoom * (most - least);
    let at = |place: DVec2| {
        let from_corner = zoom * (place.clamp(least, most) - least);
        DVec2::new(from_corner.x, size.y - from_corner.y)
    };
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {:.0} {:.0}\" font-family=\"sans-serif\" \
         font-size=\"14\">\n<rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>\n",
        size.x, size.y
    );
    let mut texts = String::new();
    for (number, block) in plan.blocks.iter().enumerate() {
        let bound = |bounds: [Option<f64>; 2], open: DVec2| {
            DVec2::new(bounds[0].unwrap_or(open.x), bounds[1].unwrap_or(open.y))
        };
        let (a, b) = (at(bound(block.cell.from, least)), at(bound(block.cell.to, most)));
        let (corner, sides, middle) = (a.min(b), (a - b).abs(), 0.5 * (a + b));
        let _ = writeln!(
            svg,
            "<rect x=\"{:.1}\" y=\"{:.1}\" width=\"{:.1}\" height=\"{:.1}\" fill=\"#eef3fb\" stroke=\"#24508a\"/>",
            corner.x, corner.y, sides.x, sides.y
        );
        for (line, text) in words(number, block, seconds.get(number)).iter().enumerate() {
            let y = middle.y + 18.0 * (line as f64 - 1.5);
            let _ = writeln!(texts, "<text x=\"{:.1}\" y=\"{y:.1}\" text-anchor=\"middle\">{text}</text>", middle.x);
        }
    }
    for place in cameras {
        let place = at(place);
        let _ = writeln!(
            svg,
            "<circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"3\" fill=\"#c4451c\" fill-opacity=\"0.5\"/>",
            place.x, place.y
        );
    }
    svg + &texts + "</svg>\n"
}

fn words(number: usize, block: &BlockPlan, seconds: Option<&f64>) -> [String; 4] {
    let BlockPlan { views, fixed, gaussians, steps, memory, .. } = block;
    [
        format!("block {}", number + 1),
        format!("{} views, {steps} steps", views.len()),
        format!("up to {} Gaussians", gaussians - fixed),
        seconds.map_or_else(String::new, |seconds| format!("about {}, ", duration(*seconds))) + &amount(*memory),
    ]
}
