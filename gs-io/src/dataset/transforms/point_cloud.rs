//! Reads points from a PLY file, such as Nerfstudio's `sparse_pc.ply`: positions and, if present,
//! colours.

use std::path::Path;

use glam::DVec3;
use gs_core::constants::SH_C0;

use crate::{
    atomic::read_file,
    dataset::{FILE, Remark, read::WorldPoint},
    error::Error,
    scene3d::{
        ply::{self, Element, Header, Value},
        source::Source,
        values::Number,
    },
};

/// Names of the colours' channels, as programs write them; the first set with a channel counts.
const COLORS: [[&str; 3]; 4] = [
    ["red", "green", "blue"],
    ["diffuse_red", "diffuse_green", "diffuse_blue"],
    ["r", "g", "b"],
    // Gaussians: SH of degree 0.
    ["f_dc_0", "f_dc_1", "f_dc_2"],
];

/// Reads a point cloud. Points without a known colour are mid-grey, with a remark that names `name`,
/// the file as the data set does.
pub(super) fn read(path: &Path, name: &str) -> Result<(Vec<WorldPoint>, Option<Remark>), Error> {
    parse(&read_file(path, FILE)?, path, name)
}

fn parse(bytes: &[u8], path: &Path, name: &str) -> Result<(Vec<WorldPoint>, Option<Remark>), Error> {
    let source = Source { path, what: "a PLY point cloud", bytes, beside: None };
    let refused =
        |message: String| Error::unusable(path, format!("expected a PLY point cloud: {message}"), "export it again");
    let header = Header::parse(&source)?;
    let vertex = header.find("vertex").ok_or_else(|| refused("it has no element `vertex`".to_owned()))?;
    let element = &header.elements[vertex];
    let mut wanted = Vec::with_capacity(6);
    for axis in ["x", "y", "z"] {
        let found = element.find(axis).filter(|&at| matches!(element.properties[at].value, Value::Scalar(_)));
        wanted.push(found.ok_or_else(|| refused(format!("its vertices have no number `{axis}`")))?);
    }
    let channels = COLORS.map(|names| names.map(|name| scalar(element, name)));
    let set = channels.iter().position(|channels| channels.iter().any(Option::is_some));
    let channels = set.map_or([None; 3], |set| channels[set]);
    // The columns of the channels in a row.
    let columns = channels.map(|channel| {
        channel.map(|at| {
            wanted.push(at);
            wanted.len() - 1
        })
    });
    let (mut positions, mut colors) = (Vec::new(), Vec::<[Option<f64>; 3]>::new());
    ply::read_rows(&source, &header, vertex, &wanted, |row| {
        positions.push(DVec3::new(row[0], row[1], row[2]));
        colors.push(columns.map(|column| column.map(|at| row[at])));
    })?;
    let kind = channels.iter().flatten().next().map(|&at| element.properties[at].value);
    let white = white(kind, &colors);
    let color = |values: [Option<f64>; 3]| match set {
        Some(3) => values.map(|v| v.map_or(0.5, |v| (0.5 + f64::from(SH_C0) * v).clamp(0.0, 1.0) as f32)),
        _ => values.map(|v| v.map_or(0.5, |v| (v / white).clamp(0.0, 1.0) as f32)),
    };
    let point = |(position, values)| WorldPoint { position, color: color(values) };
    let points: Vec<WorldPoint> = positions.into_iter().zip(colors).map(point).collect();
    let names = || element.properties.iter().map(|property| property.name.clone()).collect();
    let is_grey = set.is_none() && !points.is_empty();
    Ok((points, is_grey.then(|| Remark::PointsWithoutColor { file: name.to_owned(), properties: names() })))
}

/// The index of a property that is a number.
fn scalar(element: &Element, name: &str) -> Option<usize> {
    let at = element.properties.iter().position(|property| property.name.eq_ignore_ascii_case(name))?;
    matches!(element.properties[at].value, Value::Scalar(_)).then_some(at)
}

/// The value of white: that of the type, or of what is stored in a type that has more.
fn white(kind: Option<Value>, colors: &[[Option<f64>; 3]]) -> f64 {
    let largest = colors.iter().flatten().flatten().fold(0.0, |largest: f64, value| largest.max(*value));
    match kind {
        Some(Value::Scalar(Number::F32 | Number::F64)) if largest <= 1.0 => 1.0,
        Some(Value::Scalar(Number::U8 | Number::I8)) | None => 255.0,
        _ if largest <= 255.0 => 255.0,
        _ => 65535.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(bytes: &[u8]) -> Result<Vec<WorldPoint>, String> {
        super::parse(bytes, Path::new("a.ply"), "a.ply").map(|(points, _)| points).map_err(|error| error.to_string())
    }

    fn ply(format: &str, properties: &str, count: u64, rows: &[u8]) -> Vec<u8> {
        let header = format!("ply\nformat {format} 1.0\nelement vertex {count}\n{properties}end_header\n");
        [header.as_bytes(), rows].concat()
    }

    const POSITIONS: &str = "property float x\nproperty float y\nproperty float z\n";

    #[test]
    fn bytes_and_fractions_are_colours() {
        let bytes = format!("{POSITIONS}property uchar red\nproperty uchar green\nproperty uchar blue\n");
        let text = ply("ascii", &bytes, 2, b"1 2 3 255 0 51\n-1 0.5 4 0 0 0\n");
        let points = parse(&text).unwrap();
        assert_eq!(points[0], WorldPoint { position: DVec3::new(1.0, 2.0, 3.0), color: [1.0, 0.0, 0.2] });
        assert_eq!(points[1].position, DVec3::new(-1.0, 0.5, 4.0));

        let doubles = "property double x\nproperty double y\nproperty double z\nproperty float nx\nproperty float red\nproperty float green\nproperty float blue\n";
        let mut row: Vec<u8> = [1.0_f64, 2.0, 3.0].iter().flat_map(|v| v.to_le_bytes()).collect();
        row.extend([9.0_f32, 0.25, 0.5, 1.0].iter().flat_map(|v| v.to_le_bytes()));
        let points = parse(&ply("binary_little_endian", doubles, 1, &row)).unwrap();
        assert_eq!(points, [WorldPoint { position: DVec3::new(1.0, 2.0, 3.0), color: [0.25, 0.5, 1.0] }]);
    }

    #[test]
    fn without_colours_points_are_grey() {
        let points = parse(&ply("ascii", POSITIONS, 1, b"1 2 3\n")).unwrap();
        assert_eq!(points[0].color, [0.5; 3]);
        assert_eq!(parse(&ply("ascii", POSITIONS, 0, b"")).unwrap(), []);
        let row: Vec<u8> = [1.0_f32, 2.0, 3.0].iter().flat_map(|v| v.to_le_bytes()).collect();
        let points = parse(&ply("binary_little_endian", POSITIONS, 1, &row)).unwrap();
        assert_eq!(points, [WorldPoint { position: DVec3::new(1.0, 2.0, 3.0), color: [0.5; 3] }]);
        let partly = format!("{POSITIONS}property uchar green\n");
        let points = parse(&ply("binary_little_endian", &partly, 1, &[&row[..], &[255]].concat())).unwrap();
        assert_eq!(points[0].color, [0.5, 1.0, 0.5]);
    }

    #[test]
    fn lies_and_fragments_are_refused() {
        let listed = "property list uchar float x\nproperty float y\nproperty float z\n";
        for (bytes, expected) in [
            (ply("ascii", POSITIONS, u64::MAX, b"1 2 3\n"), "rows of element vertex"),
            (ply("binary_little_endian", POSITIONS, 4, &[0; 47]), ""),
            (ply("ascii", listed, 1, b"1 2 3 4\n"), "no number `x`"),
            (ply("ascii", "property float y\nproperty float z\n", 1, b"1 2\n"), "no number `x`"),
            (ply("ascii", POSITIONS, 1, b"1 2 nothing\n"), ""),
            (b"ply\nformat ascii 1.0\nelement face 0\nproperty float x\nend_header\n".to_vec(), "vertex"),
            (b"ply\nformat ascii 1.0\n".to_vec(), ""),
            (Vec::new(), ""),
        ] {
            let error = parse(&bytes).unwrap_err();
            assert!(error.contains(expected) && !error.contains('\n'), "{error}");
        }
    }

    #[test]
    fn colours_have_other_names_and_ranges() {
        let color = |properties: &str, row: &str| {
            let text = ply("ascii", &format!("{POSITIONS}{properties}"), 1, format!("1 2 3 {row}\n").as_bytes());
            parse(&text).unwrap()[0].color
        };
        let named = |kind: &str, names: [&str; 3]| names.map(|name| format!("property {kind} {name}\n")).concat();
        assert_eq!(color(&named("uchar", COLORS[1]), "255 0 51"), [1.0, 0.0, 0.2]);
        assert_eq!(color(&named("ushort", COLORS[0]), "65535 0 13107"), [1.0, 0.0, 0.2]);
        assert_eq!(color(&named("int", COLORS[0]), "255 0 51"), [1.0, 0.0, 0.2]);
        assert_eq!(color(&named("float", COLORS[0]), "255 0 51"), [1.0, 0.0, 0.2]);
        assert_eq!(color(&named("uchar", ["Red", "Green", "Blue"]), "255 0 51"), [1.0, 0.0, 0.2]);
        let of_gaussians = color(&named("float", COLORS[3]), "1.7724539 -9 0");
        assert!((of_gaussians[0] - 1.0).abs() < 1e-6 && of_gaussians[1..] == [0.0, 0.5]);
    }

    #[test]
    fn elements_before_the_vertices_are_passed_over() {
        let text = "ply\nformat ascii 1.0\nelement camera 2\nproperty float f\nelement vertex 1\n\
                    property float x\nproperty float y\nproperty float z\nend_header\n7\n8\n1 2 3\n";
        assert_eq!(parse(text.as_bytes()).unwrap()[0].position, DVec3::new(1.0, 2.0, 3.0));
    }

    #[test]
    fn unknown_colours_are_remarked_on() {
        let text = ply("ascii", &format!("{POSITIONS}property float intensity\n"), 1, b"1 2 3 0.7\n");
        let (_, remark) = super::parse(&text, Path::new("a.ply"), "a.ply").unwrap();
        let remark = remark.unwrap().to_string();
        assert!(remark.contains("a.ply") && remark.contains("x, y, z, intensity"), "{remark}");
    }
}
