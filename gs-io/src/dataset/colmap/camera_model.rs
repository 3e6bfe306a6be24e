//! COLMAP's camera models: ids, names, and the order and meaning of their parameters.
//!
//! *Source:* COLMAP's documentation ("Camera Models") and `sensor/models`, as of version 4.

use std::{fmt::Display, path::Path};

use glam::{DVec2, dvec2};

use crate::{
    dataset::{
        AriaFisheye, BrownConrady, Distortion, Fisheye, Skip,
        camera::{Intrinsics, is_two_to_one},
    },
    error::Error,
};

gs_core::choices! {
    /// A camera model of COLMAP. The discriminant is its id in binary files.
    #[repr(u8)]
    #[allow(missing_docs, reason = "the names are COLMAP's, and so are their parameters")]
    #[non_exhaustive]
    pub(crate) enum CameraModel {
        SimplePinhole = "SIMPLE_PINHOLE",
        Pinhole = "PINHOLE",
        SimpleRadial = "SIMPLE_RADIAL",
        Radial = "RADIAL",
        OpenCv = "OPENCV",
        OpenCvFisheye = "OPENCV_FISHEYE",
        FullOpenCv = "FULL_OPENCV",
        Fov = "FOV",
        SimpleRadialFisheye = "SIMPLE_RADIAL_FISHEYE",
        RadialFisheye = "RADIAL_FISHEYE",
        ThinPrismFisheye = "THIN_PRISM_FISHEYE",
        RadTanThinPrismFisheye = "RAD_TAN_THIN_PRISM_FISHEYE",
        SimpleDivision = "SIMPLE_DIVISION",
        Division = "DIVISION",
        SimpleFisheye = "SIMPLE_FISHEYE",
        Fisheye = "FISHEYE",
        Eucm = "EUCM",
        Equirectangular = "EQUIRECTANGULAR",
    }
}

use CameraModel as M;

impl CameraModel {
    /// The model of an id in binary files.
    pub(crate) fn from_id(id: u32) -> Option<Self> {
        Self::ALL.get(id as usize).copied()
    }

    /// The names of the parameters, in their order: focal lengths and principal point in px, and
    /// dimensionless coefficients.
    pub(crate) fn parameter_names(self) -> &'static [&'static str] {
        match self {
            M::SimplePinhole | M::SimpleFisheye => &["f", "cx", "cy"],
            M::Pinhole | M::Fisheye => &["fx", "fy", "cx", "cy"],
            M::SimpleRadial | M::SimpleRadialFisheye | M::SimpleDivision => &["f", "cx", "cy", "k"],
            M::Radial | M::RadialFisheye => &["f", "cx", "cy", "k1", "k2"],
            M::OpenCv => &["fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2"],
            M::OpenCvFisheye => &["fx", "fy", "cx", "cy", "k1", "k2", "k3", "k4"],
            M::FullOpenCv => &["fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"],
            M::Fov => &["fx", "fy", "cx", "cy", "omega"],
            M::ThinPrismFisheye => &["fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3", "k4", "sx1", "sy1"],
            M::RadTanThinPrismFisheye => {
                &["fx", "fy", "cx", "cy", "k0", "k1", "k2", "k3", "k4", "k5", "p0", "p1", "s0", "s1", "s2", "s3"]
            }
            M::Division => &["fx", "fy", "cx", "cy", "k"],
            M::Eucm => &["fx", "fy", "cx", "cy", "alpha", "beta"],
            M::Equirectangular => &["w", "h"],
        }
    }

    /// The intrinsics of a camera of `size` px with these parameters.
    pub(crate) fn intrinsics(self, parameters: &[f64], size: DVec2) -> Result<Intrinsics, Skip> {
        if parameters.len() != self.parameter_names().len() {
            return Err(Skip::BadCamera);
        }
        let (focal, center, rest) = match (self.parameter_names()[0], parameters) {
            ("f", &[f, cx, cy, ref rest @ ..]) => (DVec2::splat(f), dvec2(cx, cy), rest),
            ("fx", &[fx, fy, cx, cy, ref rest @ ..]) => (dvec2(fx, fy), dvec2(cx, cy), rest),
            _ if !is_two_to_one((size.x as u32, size.y as u32)) => return Err(Skip::Panorama),
            _ => return Ok(Intrinsics::panorama(Some(size))),
        };
        let distortion = self.distortion(rest).ok_or(Skip::BadCamera)?;
        Ok(Intrinsics::new(focal, Some(center), size, distortion))
    }

    /// The distortion by the parameters after the principal point; `None` if their number is wrong.
    fn distortion(self, coefficients: &[f64]) -> Option<Distortion> {
        let brown = |radial: [f64; 3], divisor: [f64; 3], tangential: [f64; 2]| {
            let [k1, k2, k3] = radial;
            let lens = BrownConrady { radial: [k1, k2, k3, 0.0], divisor, tangential, skew: 0.0 };
            if lens == BrownConrady::default() { Distortion::None } else { Distortion::BrownConrady(lens) }
        };
        let fisheye = |radial, tangential, prism| Distortion::Fisheye(Fisheye { radial, tangential, prism });
        let (none2, none3) = ([0.0; 2], [0.0; 3]);
        Some(match (self, coefficients) {
            (M::SimplePinhole | M::Pinhole, []) => Distortion::None,
            (M::SimpleRadial, &[k]) => brown([k, 0.0, 0.0], none3, none2),
            (M::Radial, &[k1, k2]) => brown([k1, k2, 0.0], none3, none2),
            (M::OpenCv, &[k1, k2, p1, p2]) => brown([k1, k2, 0.0], none3, [p1, p2]),
            (M::FullOpenCv, &[k1, k2, p1, p2, k3, k4, k5, k6]) => brown([k1, k2, k3], [k4, k5, k6], [p1, p2]),
            (M::SimpleFisheye | M::Fisheye, []) => fisheye([0.0; 4], none2, none2),
            (M::SimpleRadialFisheye, &[k]) => fisheye([k, 0.0, 0.0, 0.0], none2, none2),
            (M::RadialFisheye, &[k1, k2]) => fisheye([k1, k2, 0.0, 0.0], none2, none2),
            (M::OpenCvFisheye, &[k1, k2, k3, k4]) => fisheye([k1, k2, k3, k4], none2, none2),
            (M::ThinPrismFisheye, &[k1, k2, p1, p2, k3, k4, s1, s2]) => fisheye([k1, k2, k3, k4], [p1, p2], [s1, s2]),
            (M::RadTanThinPrismFisheye, &[k0, k1, k2, k3, k4, k5, p0, p1, s0, s1, s2, s3]) => {
                let (radial, prism) = ([k0, k1, k2, k3, k4, k5], [s0, s1, s2, s3]);
                Distortion::AriaFisheye(AriaFisheye { radial, tangential: [p1, p0], prism })
            }
            (M::SimpleDivision | M::Division, &[0.0]) | (M::Fov, &[0.0]) => Distortion::None,
            (M::SimpleDivision | M::Division, &[k]) => Distortion::Division { k },
            (M::Fov, &[omega]) => Distortion::FieldOfView { omega },
            (M::Eucm, &[0.0, _]) => Distortion::None,
            (M::Eucm, &[alpha, beta]) => Distortion::EnhancedUnified { alpha, beta },
            _ => return None,
        })
    }

    /// The model of a distortion, with two focal lengths, and its parameters after the principal point; `None` where
    /// there is none.
    pub(super) fn of(distortion: &Distortion) -> Option<(Self, Vec<f64>)> {
        Some(match *distortion {
            Distortion::None => (M::Pinhole, vec![]),
            Distortion::BrownConrady(BrownConrady { radial, divisor, tangential, skew: 0.0 }) => {
                let ([k1, k2, k3, 0.0], [m1, m2, m3], [p1, p2]) = (radial, divisor, tangential) else { return None };
                match [k3, m1, m2, m3] {
                    [0.0, 0.0, 0.0, 0.0] => (M::OpenCv, vec![k1, k2, p1, p2]),
                    _ => (M::FullOpenCv, vec![k1, k2, p1, p2, k3, m1, m2, m3]),
                }
            }
            Distortion::FieldOfView { omega } => (M::Fov, vec![omega]),
            Distortion::Division { k } => (M::Division, vec![k]),
            Distortion::EnhancedUnified { alpha, beta } => (M::Eucm, vec![alpha, beta]),
            Distortion::Fisheye(Fisheye { radial, tangential: [0.0, 0.0], prism: [0.0, 0.0] }) => {
                (M::OpenCvFisheye, radial.to_vec())
            }
            Distortion::Fisheye(Fisheye { radial: [k1, k2, k3, k4], tangential: [p1, p2], prism: [s1, s2] }) => {
                (M::ThinPrismFisheye, vec![k1, k2, p1, p2, k3, k4, s1, s2])
            }
            Distortion::AriaFisheye(AriaFisheye { radial, tangential: [p1, p0], prism }) => {
                (M::RadTanThinPrismFisheye, [&radial[..], &[p0, p1], &prism].concat())
            }
            Distortion::BrownConrady(_) | Distortion::Equirectangular { .. } => return None,
        })
    }
}

/// The error for a camera model that COLMAP does not have.
pub(super) fn unknown_model(path: &Path, found: impl Display) -> Error {
    Error::unknown_camera_model(path, found, &CameraModel::ALL.map(CameraModel::name).join(", "))
}

#[cfg(test)]
mod tests {
    use gs_core::Choice as _;

    use super::*;

    #[test]
    fn numbers_names_and_parameters_belong_together() {
        for (id, model) in (0..).zip(CameraModel::ALL) {
            assert_eq!((model as u32, CameraModel::from_id(id)), (id, Some(model)));
            assert_eq!(CameraModel::from_name(model.name()), Some(model));
            let parameters = vec![0.5; model.parameter_names().len()];
            assert!(model.intrinsics(&parameters, dvec2(20.0, 10.0)).is_ok(), "{model:?}");
            assert_eq!(model.intrinsics(&parameters[1..], DVec2::ONE), Err(Skip::BadCamera), "{model:?}");
            // Different numbers, so that none takes the place of another.
            let coefficients: Vec<f64> = (1..=parameters.len()).map(|k| 0.01 * k as f64).collect();
            let skipped =
                parameters.iter().zip(model.parameter_names()).filter(|(_, name)| name.starts_with(['f', 'c']));
            let given = model.distortion(&coefficients[..parameters.len() - skipped.count()]);
            match given.as_ref().and_then(CameraModel::of) {
                Some((written, values)) => assert_eq!(written.distortion(&values), given, "{model:?}"),
                None => assert_eq!(model, M::Equirectangular),
            }
        }
        assert_eq!(CameraModel::from_id(18), None);
        assert_eq!(CameraModel::from_name("opencv"), None);
    }
}
