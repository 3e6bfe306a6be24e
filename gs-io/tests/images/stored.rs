//! Images as they are stored, and PNGs with alpha and profiles.

use gs_core::Image;
use gs_io::{
    File2d, IccProfile, ImageRemark, PngExtras, premultiplied, read_image, read_stored_image, straight, write_png_with,
};
use moxcms::{ColorProfile, ProfileText};

use super::{
    colors::{hues, png_in},
    folder, saved,
};

fn stored() -> Vec<[f32; 3]> {
    hues().pixels().map(|pixel| pixel.0.map(|value| f32::from(value) / 255.0)).collect()
}

#[test]
fn colours_stay_beside_a_profile_of_matrix_and_curves() {
    let place = folder();
    let icc = ColorProfile::new_display_p3().encode().unwrap();
    let path = saved(place.path(), "a.png", &png_in(&icc));
    let found = read_stored_image(&path).unwrap();
    let profile = found.profile.clone().unwrap();
    assert!(found.image.pixels() == stored() && found.remarks.is_empty() && found.alpha.is_none());
    assert_eq!((profile.bytes(), profile.name().as_str()), (&icc[..], "Display P3"));
    assert_eq!(found.shown().unwrap(), read_image(&path).unwrap().image);
    let scene = File2d { profile: Some(profile.clone()), ..File2d::default() };
    assert_eq!(scene.in_srgb(found.image.clone()), found.shown().unwrap());

    // What is written is read again.
    let again = place.path().join("b.png");
    write_png_with(&again, &found.image, PngExtras { profile: Some(&profile), alpha: None }).unwrap();
    assert_eq!(read_stored_image(&again).unwrap(), found);
    write_png_with(&again, &found.image, PngExtras { profile: Some(&profile), alpha: Some(&[0.2; 256]) }).unwrap();
    let transparent = read_stored_image(&again).unwrap();
    assert!(transparent.alpha.is_some() && transparent.shown().unwrap() == read_image(&again).unwrap().image);
}

#[test]
fn other_profiles_are_converted_and_srgb_needs_none() {
    let place = folder();
    let read = |icc: &[u8]| read_stored_image(saved(place.path(), "a.png", &png_in(icc))).unwrap();
    let srgb = read(&ColorProfile::new_srgb().encode().unwrap());
    assert!(srgb.profile.is_none() && srgb.image.pixels() == stored() && srgb.remarks.is_empty());
    let mut long = ColorProfile::new_display_p3();
    long.description = Some(ProfileText::PlainString("long ".repeat(900)));
    let long = long.encode().unwrap();
    assert!(long.len() > 4096);
    let converted = read(&long);
    assert!(converted.profile.is_none() && converted.image.pixels() != stored());
    assert!(matches!(&converted.remarks[..], [ImageRemark::Converted { .. }]), "{:?}", converted.remarks);
    let damaged = read(b"no profile");
    assert!(damaged.profile.is_none() && damaged.image.pixels() == stored());
    assert!(matches!(&damaged.remarks[..], [ImageRemark::ProfileIgnored { .. }]), "{:?}", damaged.remarks);
    // In another kind of file a damaged profile converts nothing.
    let mut image = Image::filled(2, 2, [0.25, 0.5, 2.0]).unwrap();
    IccProfile::new(b"no profile").unwrap().to_srgb(&mut image);
    assert_eq!(image.pixel(0, 0), [0.25, 0.5, 1.0]);
}

#[test]
fn alpha_is_kept_unless_it_is_opaque() {
    let place = folder();
    let path = place.path().join("a.png");
    let image = Image::from_fn(4, 3, |x, y| [x as f32 / 3.0, y as f32 / 2.0, 1.0]).unwrap().rounded_to_8_bits();
    let alpha: Vec<f32> = (0..12).map(|k| (k * 20) as f32 / 255.0).collect();
    write_png_with(&path, &image, PngExtras { alpha: Some(&alpha), profile: None }).unwrap();
    let found = read_stored_image(&path).unwrap();
    assert_eq!((&found.image, found.alpha.as_ref().unwrap()), (&image, &alpha));
    assert_eq!(found.shown().unwrap(), read_image(&path).unwrap().image, "on white");
    assert_eq!(found.clone().on([0.0; 3]).unwrap().image, premultiplied(&image, &alpha).unwrap());

    // Where there is any alpha, the colours come back from premultiplied ones.
    let grey = Image::from_pixels(4, 3, alpha.iter().map(|&alpha| [alpha; 3]).collect()).unwrap();
    let (colors, alpha) = straight(premultiplied(&image, &alpha).unwrap(), &grey).unwrap();
    assert_eq!((colors.pixel(0, 0), alpha), ([0.0; 3], found.alpha.clone().unwrap()));
    for (found, expected) in colors.pixels().iter().zip(image.pixels()).skip(1) {
        assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6), "{found:?} {expected:?}");
    }

    write_png_with(&path, &image, PngExtras { alpha: Some(&[1.0; 12]), profile: None }).unwrap();
    assert_eq!(read_stored_image(&path).unwrap().alpha, None);
    let short = PngExtras { alpha: Some(&[1.0]), profile: None };
    assert!(write_png_with(&path, &image, short).unwrap_err().to_string().contains("alpha"));
}
