//! Camera models compared with values computed elsewhere, their inverses, and their folds.

use crate::dataset::{
    AriaFisheye, BrownConrady, CameraModel, ColmapCamera, Distortion, Fisheye, Lens, Skip, SourceCamera,
};
use glam::{DVec2, dvec2};
use proptest::prelude::*;

fn camera(name: &str, parameters: &[f64]) -> Result<SourceCamera, Skip> {
    let model = <CameraModel as gs_core::Choice>::from_name(name).unwrap();
    ColmapCamera { model, width: 640, height: 480, parameters: parameters.to_vec() }.source()
}

/// The position of the ray (0.3, −0.2) by each model, from the formulas of COLMAP's documentation
/// in double precision.
const PROJECTED: [(&str, &[f64], [f64; 2]); 17] = [
    ("SIMPLE_PINHOLE", &[500.0, 320.0, 240.0], [470.0, 140.0]),
    ("PINHOLE", &[500.0, 510.0, 320.0, 240.0], [470.0, 138.0]),
    ("SIMPLE_RADIAL", &[500.0, 320.0, 240.0, -0.1], [468.05, 141.3]),
    ("RADIAL", &[500.0, 320.0, 240.0, -0.1, 0.03], [468.12605, 141.2493]),
    ("OPENCV", &[500.0, 510.0, 320.0, 240.0, -0.1, 0.03, 0.01, -0.02], [464.42605, 141.569286]),
    (
        "OPENCV_FISHEYE",
        &[500.0, 510.0, 320.0, 240.0, -0.1, 0.03, 0.01, -0.004],
        [462.3045614437527, 143.23289821824818],
    ),
    (
        "FULL_OPENCV",
        &[500.0, 510.0, 320.0, 240.0, -0.1, 0.03, 0.01, -0.02, 0.01, 0.05, -0.02, 0.03],
        [463.5125191796757, 142.1904869578205],
    ),
    ("FOV", &[500.0, 510.0, 320.0, 240.0, 0.9], [474.942377154038, 134.63918353525412]),
    ("SIMPLE_RADIAL_FISHEYE", &[500.0, 320.0, 240.0, -0.1], [462.2402756578882, 145.17314956140783]),
    ("RADIAL_FISHEYE", &[500.0, 320.0, 240.0, -0.1, 0.03], [462.30220776363694, 145.1318614909087]),
    (
        "THIN_PRISM_FISHEYE",
        &[500.0, 510.0, 320.0, 240.0, -0.1, 0.03, 0.01, -0.02, 0.01, -0.004, 0.002, -0.003],
        [459.0160839990685, 145.16370426076986],
    ),
    (
        "RAD_TAN_THIN_PRISM_FISHEYE",
        &[
            500.0, 510.0, 320.0, 240.0, -0.02, 0.09, -0.06, 0.003, 0.005, -0.001, 0.002, -0.005, -0.0009, -0.0001,
            0.0007, -0.0017,
        ],
        [464.29657636742274, 141.64817314011796],
    ),
    ("SIMPLE_DIVISION", &[500.0, 320.0, 240.0, -0.15], [467.18380074381855, 141.87746617078764]),
    ("DIVISION", &[500.0, 510.0, 320.0, 240.0, -0.15], [467.18380074381855, 139.91501549420337]),
    ("SIMPLE_FISHEYE", &[500.0, 320.0, 240.0], [463.9642253505457, 144.02384976630285]),
    ("FISHEYE", &[500.0, 510.0, 320.0, 240.0], [463.9642253505457, 142.1043267616289]),
    ("EUCM", &[500.0, 510.0, 320.0, 240.0, 0.6, 1.2], [463.5262976309823, 142.40211761093207]),
];

#[test]
fn every_model_projects_as_documented_and_back() {
    let ray = dvec2(0.3, -0.2);
    for (name, parameters, expected) in PROJECTED {
        let camera = camera(name, parameters).unwrap();
        let pixel = camera.to_pixel(ray).unwrap();
        assert!(pixel.distance(DVec2::from_array(expected)) < 1e-9, "{name}: {pixel} {expected:?}");
        assert!(camera.to_ray(pixel).unwrap().distance(ray) < 1e-9, "{name}");
        assert_eq!(camera.lens.is_pinhole(), matches!(name, "PINHOLE" | "SIMPLE_PINHOLE"), "{name}");
    }
    assert_eq!(camera("EQUIRECTANGULAR", &[640.0, 480.0]), Err(Skip::Panorama), "not twice as wide as high");
}

#[test]
fn coefficients_of_nothing_are_a_pinhole() {
    for (name, parameters) in [
        ("SIMPLE_RADIAL", &[9.0, 1.0, 1.0, 0.0][..]),
        ("OPENCV", &[9.0, 9.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0]),
        ("FOV", &[9.0, 9.0, 1.0, 1.0, 0.0]),
        ("DIVISION", &[9.0, 9.0, 1.0, 1.0, 0.0]),
        ("EUCM", &[9.0, 9.0, 1.0, 1.0, 0.0, 1.0]),
    ] {
        assert!(camera(name, parameters).unwrap().lens.is_pinhole(), "{name}");
    }
    // The limit of the formulas, not a special case.
    let nearly = Lens::new(Distortion::FieldOfView { omega: 1e-6 }).unwrap();
    assert!(nearly.distort(dvec2(0.4, 0.3)).unwrap().distance(dvec2(0.4, 0.3)) < 1e-11);
}

#[test]
fn impossible_coefficients_make_no_lens() {
    let brown = |radial| Distortion::BrownConrady(BrownConrady { radial, ..BrownConrady::default() });
    for distortion in [
        brown([f64::NAN, 0.0, 0.0, 0.0]),
        brown([f64::INFINITY, 0.0, 0.0, 0.0]),
        brown([-1e30, 0.0, 0.0, 0.0]),
        Distortion::FieldOfView { omega: 4.0 },
        Distortion::FieldOfView { omega: f64::NAN },
        Distortion::Division { k: f64::NAN },
        Distortion::EnhancedUnified { alpha: 1.1, beta: 1.0 },
        Distortion::EnhancedUnified { alpha: 0.5, beta: 0.0 },
        Distortion::Fisheye(Fisheye { prism: [f64::NAN, 0.0], ..Fisheye::default() }),
    ] {
        let seen = Lens::new(distortion).map(|lens| lens.max_angle());
        assert!(seen.is_none_or(|angle| angle < 1e-3), "{distortion:?}: {seen:?}");
    }
}

#[test]
fn a_lens_that_folds_images_nothing_beyond() {
    // d = r − 0.3 r³ turns round at r = √(1/0.9).
    let lens =
        Lens::new(Distortion::BrownConrady(BrownConrady { radial: [-0.3, 0.0, 0.0, 0.0], ..Default::default() }));
    let lens = lens.unwrap();
    let fold = (1.0_f64 / 0.9).sqrt();
    assert!((lens.max_angle().tan() - fold).abs() < 0.02, "{}", lens.max_angle().tan());
    assert!(lens.distort(dvec2(0.0, 1.02)).is_some());
    assert_eq!(lens.distort(dvec2(0.0, 1.1)), None);
    assert_eq!(lens.distort(dvec2(0.0, 2.0)), None, "beyond, it would fall into the picture, mirrored");
    let edge = lens.distort(dvec2(1.03, 0.0)).unwrap();
    assert!(lens.undistort(edge).is_some());
    assert_eq!(lens.undistort(edge * 1.05), None);
    assert_eq!(lens.undistort(dvec2(f64::NAN, 0.0)), None);
    // A pole, beyond which the sign changes.
    let pole = BrownConrady { divisor: [-0.5, 0.0, 0.0], ..BrownConrady::default() };
    let lens = Lens::new(Distortion::BrownConrady(pole)).unwrap();
    assert!(lens.max_angle().tan() <= 2.0_f64.sqrt());
    assert_eq!(lens.distort(dvec2(1.5, 0.0)), None);
}

#[test]
fn no_lens_sees_behind_itself() {
    let lens = Lens::new(Distortion::Fisheye(Fisheye::default())).unwrap();
    assert!((lens.max_angle().to_degrees() - 89.0).abs() < 1e-9);
    assert_eq!(lens.undistort(dvec2(1.6, 0.0)), None, "91.7 degrees off the axis");
    let side = lens.undistort(dvec2(1.5, 0.0)).unwrap();
    assert!((side.x - 1.5_f64.tan()).abs() < 1e-9 && side.y == 0.0);
}

#[test]
fn the_picture_of_a_barrel_lens_holds_all_that_has_no_blank_pixels() {
    let mut source = camera("SIMPLE_RADIAL", &[500.0, 320.0, 240.0, -0.1]).unwrap();
    for center in [dvec2(320.0, 240.0), dvec2(300.0, 260.0)] {
        source.center = center;
        let picture = source.pinhole();
        assert!(
            picture.width > 640 && picture.height > 480,
            "a barrel lens saw more than its frame shows: {picture:?}"
        );
        let (width, height) = (f64::from(picture.width), f64::from(picture.height));
        let inside = |x, y| {
            let pixel = source.to_pixel((dvec2(x, y) - picture.center) / picture.focal).unwrap();
            pixel.x >= 0.0 && pixel.y >= 0.0 && pixel.x <= 640.0 && pixel.y <= 480.0
        };
        let border = (0..=100).map(|k| f64::from(k) / 100.0);
        assert!(border.clone().all(|t| inside(t * width, 0.5) && inside(t * width, height - 0.5)));
        assert!(border.clone().all(|t| inside(0.5, t * height) && inside(width - 0.5, t * height)));
        let outside = |x, y| !inside(x, y);
        assert!(outside(-2.0, height / 2.0) || outside(width + 2.0, height / 2.0) || outside(width / 2.0, -2.0));
    }
    assert_eq!(camera("PINHOLE", &[500.0, 500.0, 1.0, 9.0]).unwrap().pinhole().width, 640);
}

/// Realistic distortions of every kind, one-to-one over a large part of the view.
fn any_distortion() -> impl Strategy<Value = Distortion> {
    let k = || -0.4..0.4_f64;
    let small = || -0.02..0.02_f64;
    let brown = (
        [k(), -0.1..0.1, -0.02..0.02, -0.005..0.005],
        [-0.1..0.1, -0.05..0.05, -0.01..0.01],
        [small(), small()],
        small(),
    )
        .prop_map(|(radial, divisor, tangential, skew)| BrownConrady { radial, divisor, tangential, skew });
    let fisheye = ([k(), -0.1..0.1, -0.02..0.02, -0.005..0.005], [small(), small()], [small(), small()])
        .prop_map(|(radial, tangential, prism)| Fisheye { radial, tangential, prism });
    let aria = (prop::array::uniform6(-0.05..0.05), [small(), small()], prop::array::uniform4(small()))
        .prop_map(|(radial, tangential, prism)| AriaFisheye { radial, tangential, prism });
    prop_oneof![
        Just(Distortion::None),
        brown.prop_map(Distortion::BrownConrady),
        fisheye.prop_map(Distortion::Fisheye),
        aria.prop_map(Distortion::AriaFisheye),
        (-2.0..2.0_f64).prop_map(|omega| Distortion::FieldOfView { omega }),
        k().prop_map(|k| Distortion::Division { k }),
        (0.0..1.0_f64, 0.3..3.0_f64).prop_map(|(alpha, beta)| Distortion::EnhancedUnified { alpha, beta }),
    ]
}

/// Any distortion that a file can contain.
fn wild_distortion() -> impl Strategy<Value = Distortion> {
    let any = || any::<f64>();
    prop_oneof![
        (prop::array::uniform4(any()), prop::array::uniform3(any()), prop::array::uniform2(any()), any())
            .prop_map(|(radial, divisor, tangential, skew)| BrownConrady { radial, divisor, tangential, skew })
            .prop_map(Distortion::BrownConrady),
        (
            prop::array::uniform4(-9.0..9.0_f64),
            prop::array::uniform3(-9.0..9.0_f64),
            prop::array::uniform2(-9.0..9.0_f64),
            -9.0..9.0_f64
        )
            .prop_map(|(radial, divisor, tangential, skew)| BrownConrady { radial, divisor, tangential, skew })
            .prop_map(Distortion::BrownConrady),
        (prop::array::uniform4(any()), prop::array::uniform2(any()), prop::array::uniform2(any()))
            .prop_map(|(radial, tangential, prism)| Distortion::Fisheye(Fisheye { radial, tangential, prism })),
        (prop::array::uniform6(-9.0..9.0_f64), prop::array::uniform2(any()), prop::array::uniform4(any()))
            .prop_map(|(radial, tangential, prism)| Distortion::AriaFisheye(AriaFisheye { radial, tangential, prism })),
        any().prop_map(|omega| Distortion::FieldOfView { omega }),
        any().prop_map(|k| Distortion::Division { k }),
        (any(), any()).prop_map(|(alpha, beta)| Distortion::EnhancedUnified { alpha, beta }),
    ]
}

proptest! {
    /// Undistorting inverts distorting, to a thousandth of a pixel at a focal length of 1,000 px,
    /// wherever the lens images.
    #[test]
    fn undistorting_inverts_distorting(distortion in any_distortion(), angle in 0.0..6.3_f64, share in 0.0..0.98_f64) {
        let lens = Lens::new(distortion).unwrap();
        prop_assert!(lens.max_angle() > 0.3, "{}", lens.max_angle());
        let ray = DVec2::from_angle(angle) * (share * lens.max_angle().min(1.3)).tan();
        let seen = lens.distort(ray).unwrap();
        let back = lens.undistort(seen);
        prop_assert!(back.is_some_and(|back| back.distance(ray) * 1000.0 < 1e-3), "{ray} {seen} {back:?}");
    }

    /// Distorting inverts undistorting, for every pixel with a ray.
    #[test]
    fn distorting_inverts_undistorting(distortion in any_distortion(), x in 0.0..640.0_f64, y in 0.0..480.0_f64) {
        let source = SourceCamera {
            width: 640,
            height: 480,
            focal: dvec2(500.0, 480.0),
            center: dvec2(310.0, 250.0),
            lens: Lens::new(distortion).unwrap(),
        };
        if let Some(ray) = source.to_ray(dvec2(x, y)) {
            let pixel = source.to_pixel(ray);
            prop_assert!(pixel.is_some_and(|pixel| pixel.distance(dvec2(x, y)) < 1e-3), "{ray} {pixel:?}");
        }
    }

    /// Any coefficients give results that are finite or `None`, and a picture of a possible size.
    #[test]
    fn wild_coefficients_are_survived(
        distortion in wild_distortion(),
        place in prop::array::uniform2(any::<f64>()),
        near in prop::array::uniform2(-2.0..2.0_f64),
        focal in 1e-3..1e6_f64,
    ) {
        let Some(lens) = Lens::new(distortion) else { return Ok(()) };
        for p in [place, near] {
            prop_assert!(lens.distort(DVec2::from_array(p)).is_none_or(|d| d.is_finite()));
            prop_assert!(lens.undistort(DVec2::from_array(p)).is_none_or(|d| d.is_finite()));
        }
        let source = SourceCamera { width: 64, height: 48, focal: DVec2::splat(focal), center: dvec2(31.0, 25.0), lens };
        let picture = source.pinhole();
        prop_assert!((12..=128).contains(&picture.width) && (9..=96).contains(&picture.height), "{picture:?}");
        prop_assert!(picture.center.is_finite());
    }
}
