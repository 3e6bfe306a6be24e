//! Reads points from a PLY file, such as Nerfstudio's `sparse_pc.ply`: positions and, if present,
//! colours.

use std::path::Path;

use glam::DVec3;
use serde::Deserialize;
use serde_ply::{PlyReader, PropertyType, ScalarType};

use super::{WorldPoint, read_file};
use crate::error::Error;

/// A row of the element `vertex`.
#[derive(Deserialize)]
struct Row {
    x: f64,
    y: f64,
    z: f64,
    // `default` is for binary files, whose rows are sequences, in which a missing value is not
    // `None` by itself.
    #[serde(default)]
    red: Option<f64>,
    #[serde(default)]
    green: Option<f64>,
    #[serde(default)]
    blue: Option<f64>,
}

/// Reads a point cloud; points without a colour are mid-grey.
pub(super) fn read(path: &Path) -> Result<Vec<WorldPoint>, Error> {
    parse(&read_file(path)?).map_err(|message| Error::NotAPointCloud { path: path.to_owned(), message })
}

fn parse(bytes: &[u8]) -> Result<Vec<WorldPoint>, String> {
    let mut rest = bytes;
    let mut reader = PlyReader::from_reader(&mut rest).map_err(|error| one_line(&error))?;
    let Some(vertex) = reader.header().elem_defs.first().filter(|element| element.name == "vertex") else {
        return Err("its first element is not `vertex`".to_owned());
    };
    let kind_of = |name: &str| vertex.get_property(name).map(|property| property.property_type.clone());
    for name in ["x", "y", "z"] {
        if !matches!(kind_of(name), Some(PropertyType::Scalar(_))) {
            return Err(format!("its vertices have no number `{name}`"));
        }
    }
    // A row has three bytes at least, whatever the header claims.
    if vertex.count > bytes.len() / 3 {
        return Err(format!("it counts {} vertices in a file of {} bytes", vertex.count, bytes.len()));
    }
    let white = match kind_of("red") {
        Some(PropertyType::Scalar(ScalarType::F32 | ScalarType::F64)) => 1.0,
        Some(PropertyType::Scalar(ScalarType::U16 | ScalarType::I16)) => 65535.0,
        _ => 255.0,
    };
    let rows: Vec<Row> = reader.next_element().map_err(|error| one_line(&error))?;
    let color =
        |row: &Row| [row.red, row.green, row.blue].map(|c| c.map_or(0.5, |c| (c / white).clamp(0.0, 1.0) as f32));
    let point = |row: &Row| WorldPoint { position: DVec3::new(row.x, row.y, row.z), color: color(row) };
    Ok(rows.iter().map(point).collect())
}

fn one_line(error: &impl ToString) -> String {
    error.to_string().split_whitespace().collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

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
            (ply("ascii", POSITIONS, u64::MAX, b"1 2 3\n"), "counts"),
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
}
