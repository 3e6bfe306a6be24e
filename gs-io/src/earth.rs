//! Places on the Earth of projected coordinates, without a library for projections.

use glam::{DAffine3, DMat3, DVec3, dvec3};

/// Half the long axis of WGS 84, m, and its flattening.
const AXIS: f64 = 6_378_137.0;
const FLATTENING: f64 = 1.0 / 298.257_223_563;

/// Scale of UTM along its central meridian, and its false easting and northing in the south, m.
const SCALE: f64 = 0.9996;
const EASTING: f64 = 500_000.0;
const SOUTHERN_NORTHING: f64 = 10_000_000.0;

/// Distance of places between which a map is taken as linear to find its derivative, m.
const STEP: f64 = 50.0;

/// A system of coordinates in metres whose places in ECEF (EPSG:4978) are known.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Earth {
    /// ECEF itself.
    Ecef,
    /// UTM on WGS 84, with heights above the ellipsoid: the central meridian, radians, and the false northing.
    Utm { meridian: f64, northing: f64 },
}

impl Earth {
    /// The system of an EPSG code; `None` for others.
    ///
    /// ETRS89 (258xx) is taken as WGS 84, from which it differs by less than a metre.
    pub(crate) fn of(epsg: u16) -> Option<Self> {
        let (zone, northing) = match epsg {
            4978 => return Some(Self::Ecef),
            25828..=25838 => (epsg - 25800, 0.0),
            32601..=32660 => (epsg - 32600, 0.0),
            32701..=32760 => (epsg - 32700, SOUTHERN_NORTHING),
            _ => return None,
        };
        Some(Self::Utm { meridian: (6.0 * f64::from(zone) - 183.0).to_radians(), northing })
    }

    /// Whether this can be a place of the system: within some 200 km of the ground, or near a zone of UTM.
    pub(crate) fn contains(&self, place: DVec3) -> bool {
        match self {
            Self::Ecef => (6.2e6..6.6e6).contains(&place.length()),
            Self::Utm { .. } => (1e5..9e5).contains(&place.x) && (0.0..SOUTHERN_NORTHING).contains(&place.y),
        }
    }

    /// The map to ECEF that fits best around a place. A kilometre away from it, the curvature of the Earth is 8 cm.
    pub(crate) fn near(&self, place: DVec3) -> DAffine3 {
        let along = |axis: DVec3| (self.ecef(place + STEP * axis) - self.ecef(place - STEP * axis)) / (2.0 * STEP);
        let linear = DMat3::from_cols(along(DVec3::X), along(DVec3::Y), along(DVec3::Z));
        DAffine3::from_mat3_translation(linear, self.ecef(place) - linear * place)
    }

    /// The place in ECEF.
    ///
    /// *Source:* Karney, "Transverse Mercator with an accuracy of a few nanometers", 2011, equations 11, 15 and 36, with
    /// the series up to n⁴ (nanometres within a zone), and the latitude by the series of its inverse.
    fn ecef(&self, place: DVec3) -> DVec3 {
        let &Self::Utm { meridian, northing } = self else { return place };
        let n = FLATTENING / (2.0 - FLATTENING);
        let (n2, n3, n4) = (n * n, n * n * n, n * n * n * n);
        let radius = SCALE * AXIS / (1.0 + n) * (1.0 + n2 / 4.0 + n4 / 64.0);
        let beta = [
            n / 2.0 - 2.0 / 3.0 * n2 + 37.0 / 96.0 * n3 - n4 / 360.0,
            n2 / 48.0 + n3 / 15.0 - 437.0 / 1440.0 * n4,
            17.0 / 480.0 * n3 - 37.0 / 840.0 * n4,
            4397.0 / 161_280.0 * n4,
        ];
        let delta = [
            2.0 * n - 2.0 / 3.0 * n2 - 2.0 * n3 + 116.0 / 45.0 * n4,
            7.0 / 3.0 * n2 - 8.0 / 5.0 * n3 - 227.0 / 45.0 * n4,
            56.0 / 15.0 * n3 - 136.0 / 35.0 * n4,
            4279.0 / 630.0 * n4,
        ];
        let (north, east) = ((place.y - northing) / radius, (place.x - EASTING) / radius);
        let (mut xi, mut eta) = (north, east);
        for (k, beta) in (1..).zip(beta) {
            let k = 2.0 * f64::from(k);
            xi -= beta * (k * north).sin() * (k * east).cosh();
            eta -= beta * (k * north).cos() * (k * east).sinh();
        }
        let conformal = (xi.sin() / eta.cosh()).asin();
        let series = (1..).zip(delta).map(|(k, delta)| delta * (2.0 * f64::from(k) * conformal).sin());
        let latitude = conformal + series.sum::<f64>();
        let longitude = meridian + eta.sinh().atan2(xi.cos());
        let squared = FLATTENING * (2.0 - FLATTENING);
        let curvature = AXIS / (1.0 - squared * latitude.sin().powi(2)).sqrt();
        let from_axis = (curvature + place.z) * latitude.cos();
        let up = (curvature * (1.0 - squared) + place.z) * latitude.sin();
        dvec3(from_axis * longitude.cos(), from_axis * longitude.sin(), up)
    }
}
