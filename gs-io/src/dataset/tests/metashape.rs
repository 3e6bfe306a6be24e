//! The cameras of Agisoft Metashape.

use std::{fs, path::Path};

use glam::{DMat3, DQuat, DVec2, DVec3, dvec2, dvec3};

use super::made::{folder, picture, pixel, read, refusal, skipped, world_points};
use crate::dataset::{DatasetKind, Remark, Skip};

/// Rotation and translation from the camera `i`, with axes right, down, forward, to its component.
fn pose(i: usize) -> (DMat3, DVec3) {
    let axis = dvec3(0.6, -0.64, 0.48);
    (DMat3::from_quat(DQuat::from_axis_angle(axis, 0.2 * i as f64)), dvec3(0.3 * i as f64, -0.2, -4.0))
}

fn words(numbers: impl IntoIterator<Item = f64>) -> String {
    numbers.into_iter().map(|number| number.to_string()).collect::<Vec<_>>().join(" ")
}

fn rows(matrix: DMat3) -> String {
    words(matrix.transpose().to_cols_array())
}

fn camera(i: usize, attributes: &str) -> String {
    let (rotation, position) = pose(i);
    let row = |r: usize| words(rotation.row(r).to_array().into_iter().chain([position[r]]));
    let rows = format!("{} {} {} 0 0 0 1", row(0), row(1), row(2));
    format!("<camera id=\"{i}\" sensor_id=\"0\" label=\"{i}\" {attributes}><transform>{rows}</transform></camera>")
}

fn sensor(attributes: &str, calibration: &[(&str, f64)]) -> String {
    let numbers: String = calibration.iter().map(|(name, value)| format!("<{name}>{value}</{name}>")).collect();
    format!(
        "<sensor id=\"0\" label=\"unknown\" {attributes}><resolution width=\"80\" height=\"60\"/>\
         <calibration {attributes} class=\"initial\"><f>1</f></calibration>\
         <calibration {attributes} class=\"adjusted\"><resolution width=\"80\" height=\"60\"/>{numbers}</calibration></sensor>"
    )
}

fn document(sensor: &str, cameras: &str, more: &str) -> String {
    format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<document version=\"2.0.0\">\n<chunk label=\"1\" enabled=\"true\">\n\
         <sensors next_id=\"1\">{sensor}</sensors>{more}<cameras next_id=\"3\">{cameras}</cameras></chunk></document>"
    )
}

fn write(root: &Path, content: &str) {
    (0..3).for_each(|i| drop(picture(root.join(format!("images/{i}.png")), 40, 30)));
    fs::write(root.join("cameras.xml"), content).unwrap();
}

const FRAME: &str = "type=\"frame\"";
const BENT: [(&str, f64); 11] = [
    ("f", 70.0),
    ("cx", 1.5),
    ("cy", -2.5),
    ("b1", 3.0),
    ("b2", -2.0),
    ("k1", 0.05),
    ("k2", -0.02),
    ("k3", 0.01),
    ("k4", -0.003),
    ("p1", 0.004),
    ("p2", -0.003),
];

fn cameras() -> String {
    (0..3).map(|i| camera(i, "")).collect()
}

/// Small files for the fuzz target, of an image `a.png` of 20×10 px.
pub(super) fn seeds() -> Vec<Vec<u8>> {
    let of = |attributes: &str, calibration: &[(&str, f64)], more: &str| {
        let whole = document(&sensor(attributes, calibration), &camera(1, ""), more);
        whole.replace("label=\"1\"", "label=\"a\"").replace("\"80\" height=\"60\"", "\"20\" height=\"10\"").into_bytes()
    };
    let world = "<transform><rotation>1 0 0 0 1 0 0 0 1</rotation><scale>2</scale></transform>";
    vec![
        of(FRAME, &BENT, world),
        of("type=\"fisheye\"", &[("f", 7.0), ("k1", 0.01)], ""),
        of("type=\"spherical\"", &[], ""),
        b"<!DOCTYPE a [<!ENTITY b \"b\">]><document><chunk>&b;</chunk></document>".to_vec(),
    ]
}

/// Where the manual says that a sensor shows a point, px of 80×60.
fn documented(is_fisheye: bool, calibration: &[(&str, f64)], seen: DVec3) -> DVec2 {
    let number = |name: &str| calibration.iter().find(|(known, _)| *known == name).map_or(0.0, |(_, value)| *value);
    let (mut x, mut y) = (seen.x / seen.z, seen.y / seen.z);
    if is_fisheye {
        let r = x.hypot(y);
        (x, y) = (x * r.atan() / r, y * r.atan() / r);
    }
    let r2 = x * x + y * y;
    let radial =
        1.0 + number("k1") * r2 + number("k2") * r2.powi(2) + number("k3") * r2.powi(3) + number("k4") * r2.powi(4);
    let (p1, p2) = (number("p1"), number("p2"));
    let bent_x = x * radial + p1 * (r2 + 2.0 * x * x) + 2.0 * p2 * x * y;
    let bent_y = y * radial + p2 * (r2 + 2.0 * y * y) + 2.0 * p1 * x * y;
    let f = number("f");
    dvec2(
        40.0 + number("cx") + bent_x * f + bent_x * number("b1") + bent_y * number("b2"),
        30.0 + number("cy") + bent_y * f,
    )
}

#[test]
fn points_appear_where_the_manual_says() {
    let fisheye = [("f", 70.0), ("cx", 1.5), ("cy", -2.5), ("k1", 0.05), ("k2", -0.02), ("p1", 0.004), ("p2", -0.003)];
    for (kind, calibration) in
        [("frame", &BENT[..]), ("frame", &BENT[..3]), ("fisheye", &fisheye), ("equidistant_fisheye", &fisheye)]
    {
        let place = folder();
        write(place.path(), &document(&sensor(&format!("type=\"{kind}\""), calibration), &cameras(), ""));
        let dataset = read(place.path());
        assert_eq!((dataset.kind, dataset.views.len()), (DatasetKind::Metashape, 3));
        assert!(dataset.remarks.contains(&Remark::NoPoints));
        for (i, point) in (0..3).flat_map(|i| world_points().map(move |point| (i, point))) {
            let (rotation, position) = pose(i);
            let seen = rotation.transpose() * (point - position);
            // The images have half of the size.
            let expected = 0.5 * documented(kind != "frame", calibration, seen);
            let found = pixel(&dataset, &i.to_string(), point).unwrap();
            assert!(found.distance(expected) < 1e-4, "{found} for {expected} of {kind}");
        }
    }
}

#[test]
fn the_world_is_that_of_the_component_or_the_chunk() {
    let (rotation, translation, scale) = (DMat3::from_rotation_z(0.7), dvec3(1.0, 2.0, 3.0), 2.5);
    let transform = format!(
        "<transform><rotation>{}</rotation><translation>{}</translation><scale>{scale}</scale></transform>",
        rows(rotation),
        words(translation.to_array())
    );
    let component = format!("<components><component id=\"4\">{transform}</component></components>");
    let grouped = format!("<group>{}</group>", (0..3).map(|i| camera(i, "component_id=\"4\"")).collect::<String>());
    for (cameras, more) in [(cameras(), &transform), (grouped, &component)] {
        let place = folder();
        write(place.path(), &document(&sensor(FRAME, &BENT[..3]), &cameras, more));
        let dataset = read(place.path());
        for (i, point) in (0..3).flat_map(|i| world_points().map(move |point| (i, point))) {
            let (turn, position) = pose(i);
            let expected = 0.5 * documented(false, &BENT[..3], turn.transpose() * (point - position));
            let found = pixel(&dataset, &i.to_string(), scale * (rotation * point) + translation).unwrap();
            assert!(found.distance(expected) < 1e-3, "{found} for {expected}");
        }
    }
}

#[test]
fn a_360_image_is_split() {
    let place = folder();
    let whole = document(&sensor("type=\"spherical\"", &[]), &cameras(), "").replace("height=\"60\"", "height=\"40\"");
    write(place.path(), &whole);
    (0..3).for_each(|i| drop(picture(place.path().join(format!("images/{i}.png")), 40, 20)));
    assert_eq!(read(place.path()).views.len(), 18);
}

#[test]
fn labels_may_be_paths_of_another_machine_and_files_have_any_name() {
    let place = folder();
    write(
        place.path(),
        &document(&sensor(FRAME, &BENT), &cameras(), "").replace("label=\"2\"", "label=\"C:\\a\\images\\2.png\""),
    );
    picture(place.path().join("masks/2.png"), 40, 30);
    let (file, other) = (place.path().join("cameras.xml"), place.path().join("b.XML"));
    fs::rename(&file, &other).unwrap();
    fs::write(place.path().join("a.xml"), "<a/>").unwrap();
    for named in [place.path(), &other] {
        let dataset = read(named);
        assert_eq!(dataset.views.len(), 3);
        assert_eq!((dataset.views[2].name.as_str(), dataset.views[2].mask.is_some()), ("2.png", true));
    }
    fs::copy(&other, &file).unwrap();
    let error = refusal(place.path());
    assert!(error.contains("several files of cameras: b.XML, cameras.xml; name one"), "{error}");
}

#[test]
fn cameras_that_cannot_be_used_are_counted() {
    let place = folder();
    let off = camera(1, "enabled=\"false\"");
    let unposed = "<camera id=\"5\" sensor_id=\"0\" label=\"5\"/>";
    let broken = "<camera id=\"6\" sensor_id=\"0\" label=\"6\"><transform>1 0 x</transform></camera>";
    let lost = camera(2, "").replace("sensor_id=\"0\"", "sensor_id=\"9\"");
    let all = [&camera(0, ""), &off, unposed, broken, &lost].concat();
    write(place.path(), &document(&sensor(FRAME, &BENT), &all, ""));
    let dataset = read(place.path());
    assert_eq!(dataset.views.len(), 1);
    for why in [Skip::MarkedBad, Skip::NoPose, Skip::PoseNotFinite, Skip::NoCamera] {
        assert_eq!(skipped(&dataset, why), 1, "{why}");
    }
}

#[test]
fn malformed_files_are_refused_with_the_reason() {
    let place = folder();
    let says = |content: &str, words: &str| {
        write(place.path(), content);
        let error = refusal(place.path());
        assert!(error.contains(words), "{error} does not say {words}");
    };
    let with =
        |attributes: &str, calibration: &[(&str, f64)]| document(&sensor(attributes, calibration), &cameras(), "");
    says(&with("type=\"cylindrical\"", &BENT), "camera model cylindrical is not known (known: frame");
    says(&with(FRAME, &[("cx", 1.0)]), "in sensor 0, there is no calibration with a focal length f (f is 0)");
    says(&with(FRAME, &[("f", f64::NAN)]), "in sensor 0, f is not a finite number");
    says(
        &with(FRAME, &[("f", 70.0), ("p3", 0.1)]),
        "p3 is 0.1, which is not supported: optimize the cameras without it",
    );
    says(&with("type=\"fisheye\"", &[("f", 70.0), ("b2", 0.1)]), "b2 is 0.1, which is not supported");
    says(&with(FRAME, &BENT).replace("width=\"80\"", "width=\"many\""), "in sensor 0, there is no resolution");
    says(&with(FRAME, &BENT).replace("width=\"80\"", "width=\"1e300\""), "the camera has");
    says(&document("", "", ""), "it lists none");
    says(
        "<document><chunks><chunk/></chunks></document>",
        "cameras.xml: it has no element chunk; export the cameras again",
    );
    let apart = camera(0, "component_id=\"0\"") + &camera(1, "component_id=\"1\"");
    says(&document(&sensor(FRAME, &BENT), &apart, ""), "its cameras are in 2 components that are not aligned");
    says(&with(FRAME, &BENT).replace("label=\"2\"", "label=\"../2\""), "the image name `../2` leads out");
    let whole = with(FRAME, &BENT);
    says(&whole[..whole.len() - 12], "export the cameras again, as Agisoft XML");
}

#[test]
fn hostile_xml_is_refused() {
    let place = folder();
    let file = place.path().join("cameras.xml");
    let entities: String =
        (1..9).map(|i| format!("<!ENTITY e{i} \"{}\">", format!("&e{};", i - 1).repeat(10))).collect();
    let bomb = format!("<!DOCTYPE d [<!ENTITY e0 \"e\">{entities}]><document><chunk>&e8;</chunk></document>");
    fs::write(&file, bomb).unwrap();
    assert!(refusal(&file).contains("DTD"), "{}", refusal(&file));
    let deep = 200_000;
    fs::write(&file, format!("<document><chunk>{}{}</chunk></document>", "<a>".repeat(deep), "</a>".repeat(deep)))
        .unwrap();
    assert!(refusal(place.path()).contains("it lists none"));
    fs::write(&file, b"<document><chunk>\xff\xfe</chunk></document>").unwrap();
    assert!(refusal(&file).contains("utf-8"), "{}", refusal(&file));
}
