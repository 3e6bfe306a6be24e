//! The camera parameters of RealityScan.

use std::{fs, path::Path};

use glam::{DVec2, DVec3, dvec2, dvec3};

use super::made::{folder, picture, pixel, read, refusal, skipped, world_points};
use crate::dataset::{DatasetKind, Remark, Skip};

const OLD: &str = "#name,x,y,alt,heading,pitch,roll,f,px,py,k1,k2,k3,k4,t1,t2";
const NEW: &str = "#name,x,y,alt,yaw,pitch,roll,f_35mm,px_norm,py_norm,k1,k2,k3,k4,t1,t2";

/// f, px, py, k1 to k4, t1, t2.
const LENS: [f64; 9] = [30.0, 0.02, -0.01, 0.05, -0.02, 0.01, -0.003, 0.004, -0.003];

/// Position, heading, pitch and roll of the image `i`, which looks north past the origin.
fn pose(i: usize) -> [f64; 6] {
    let i = i as f64;
    [0.3 * i, -4.0, 0.2, 3.0 * i, 88.0 - 5.0 * i, 4.0 - 6.0 * i]
}

fn row(name: &str, pose: [f64; 6], lens: &[f64]) -> String {
    let numbers = pose.iter().chain(lens).map(f64::to_string);
    std::iter::once(name.to_owned()).chain(numbers).collect::<Vec<_>>().join(",")
}

fn file(header: &str, lens: &[f64]) -> String {
    let rows: String = (0..3).map(|i| row(&format!("{i}.png"), pose(i), lens) + "\r\n").collect();
    format!("{header}\r\n{rows}")
}

fn write(root: &Path, content: &str) {
    (0..3).for_each(|i| drop(picture(root.join(format!("images/{i}.png")), 40, 30)));
    fs::write(root.join("cameras.csv"), content).unwrap();
}

/// Small files for the fuzz target, of an image `a.png` of 20×10 px.
pub(super) fn seeds() -> Vec<Vec<u8>> {
    let of = |header: &str, lens: &[f64]| format!("{header}\n{}\n", row("a.png", pose(1), lens)).into_bytes();
    let pinhole = "#name,x,y,alt,heading,pitch,roll,f";
    let lost = of(OLD, &LENS[..4]);
    vec![of(OLD, &LENS), of(NEW, &LENS), of(pinhole, &LENS[..1]), lost]
}

/// Where the program shows what a camera sees at (right, up, back), px of 40×30.
fn documented(lens: &[f64], seen: DVec3) -> DVec2 {
    let [f, px, py, k1, k2, k3, k4, t1, t2] = std::array::from_fn(|i| lens.get(i).copied().unwrap_or(0.0));
    let (x, y) = (seen.x / -seen.z, seen.y / seen.z);
    let r2 = x * x + y * y;
    let radial = 1.0 + k1 * r2 + k2 * r2.powi(2) + k3 * r2.powi(3) + k4 * r2.powi(4);
    let bent_x = x * radial + t1 * (r2 + 2.0 * x * x) + 2.0 * t2 * x * y;
    let bent_y = y * radial + t2 * (r2 + 2.0 * y * y) + 2.0 * t1 * x * y;
    dvec2(20.0 + 40.0 * (px + bent_x * f / 36.0), 15.0 + 40.0 * (py + bent_y * f / 36.0))
}

/// The axes right, up and back of a camera by the elements of its matrix.
fn axes([_, _, _, heading, pitch, roll]: [f64; 6]) -> [DVec3; 3] {
    let ((sh, ch), (sp, cp), (sr, cr)) =
        (heading.to_radians().sin_cos(), pitch.to_radians().sin_cos(), roll.to_radians().sin_cos());
    [
        dvec3(cr * ch + sr * sp * sh, ch * sr * sp - cr * sh, -cp * sr),
        dvec3(cp * sh, cp * ch, sp),
        dvec3(ch * sr - cr * sp * sh, -(cr * ch * sp + sr * sh), cr * cp),
    ]
}

#[test]
fn points_appear_where_the_program_says() {
    let short = "name,X,Y,Alt,Heading,Pitch,Roll,F";
    for (header, lens) in [(OLD, &LENS[..]), (NEW, &LENS), (short, &LENS[..1])] {
        let place = folder();
        write(place.path(), &file(header, lens));
        let dataset = read(place.path());
        assert_eq!((dataset.kind, dataset.views.len()), (DatasetKind::RealityScan, 3));
        assert!(dataset.remarks.contains(&Remark::NoPoints));
        for (i, point) in (0..3).flat_map(|i| world_points().map(move |point| (i, point))) {
            let pose = pose(i);
            let [right, up, back] = axes(pose);
            let ray = point - dvec3(pose[0], pose[1], pose[2]);
            let expected = documented(lens, dvec3(ray.dot(right), ray.dot(up), ray.dot(back)));
            let found = pixel(&dataset, &format!("{i}.png"), point).unwrap();
            assert!(found.distance(expected) < 1e-4, "{found} for {expected} by {header}");
        }
    }
}

#[test]
fn a_level_camera_that_looks_east_is_that() {
    let place = folder();
    let row = row("0.png", [0.0, 0.0, 0.0, 90.0, 90.0, 0.0], &[36.0]);
    write(place.path(), &format!("#cameras 1\nname,x,y,alt,heading,pitch,roll,f\n\n{row}\n"));
    let dataset = read(place.path());
    let seen = |x, y, z| pixel(&dataset, "0.png", dvec3(x, y, z));
    assert!(seen(4.0, 0.0, 0.0).unwrap().distance(dvec2(20.0, 15.0)) < 1e-4, "east is ahead");
    assert!(seen(4.0, -1.0, 1.0).unwrap().distance(dvec2(30.0, 5.0)) < 1e-4, "south is right, up is up");
    assert_eq!(seen(-4.0, 0.0, 0.0), None, "west is behind");
}

#[test]
fn smaller_copies_and_masks_are_found_and_the_file_may_be_named() {
    let place = folder();
    write(place.path(), &format!("\u{feff}{}", file(OLD, &LENS)));
    fs::rename(place.path().join("images"), place.path().join("images_2")).unwrap();
    picture(place.path().join("masks/1.png"), 40, 30);
    fs::write(place.path().join("metrics.csv"), "step,loss\n1,2\n").unwrap();
    for named in [place.path().to_owned(), place.path().join("cameras.csv")] {
        let dataset = read(&named);
        let view = &dataset.views[1];
        assert_eq!((dataset.views.len(), view.mask.is_some()), (3, true));
        assert!(view.source.focal.distance(DVec2::splat(40.0 * 30.0 / 36.0)) < 1e-9);
        assert!(view.source.center.distance(dvec2(20.8, 14.6)) < 1e-9);
    }
}

#[test]
fn rows_that_cannot_be_used_are_counted() {
    let place = folder();
    let blind = [&[0.0], &LENS[1..]].concat();
    let rows = [
        row("0.png", pose(0), &LENS),
        row("1.png", pose(1), &LENS).replace(",83,", ",level,"),
        row("2.png", pose(2), &blind),
        row("3.png", pose(2), &LENS),
    ];
    let content = format!("{OLD}\n{}", rows.join("\n"));
    write(place.path(), &content);
    let dataset = read(place.path());
    assert_eq!(dataset.views.len(), 1);
    for why in [Skip::PoseNotFinite, Skip::BadCamera, Skip::NoImage] {
        assert_eq!(skipped(&dataset, why), 1, "{why}: {:?}", dataset.remarks);
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
    says(&format!("{OLD}\n"), "it lists none");
    says(
        &format!("{OLD}\n0.png,1,2\n"),
        "cameras.csv: line 2 has 3 fields, but the header 16; export Internal/External",
    );
    let whole = file(OLD, &LENS);
    says(&whole[..whole.len() - 30], "line 4 has");
    says(&whole.replace("2.png", "../2.png"), "the image name `../2.png` leads out");
    says(&whole.replace(",30,", ",inf,"), "line 2 of cameras.csv has f = inf");
    says(&whole.replace(",30,", ",1e300,"), "3 images skipped: the camera's size, focal lengths or lens");
    says(&whole.replace(",pitch,", ",angle,"), "is no data set");
    fs::write(place.path().join("cameras.csv"), [b"\xff\xfe#".as_slice(), &[0; 9]].concat()).unwrap();
    assert!(refusal(&place.path().join("cameras.csv")).contains("is no data set"));
}
