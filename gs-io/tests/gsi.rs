//! Compressed pictures are read wherever 2D scenes are, and damaged ones are refused in one line.

use std::fs;

use glam::{Vec2, Vec3};
use gs_codec::{Alpha, Extent, Layer, LayerHead, Picture, Quantizer};
use gs_core::{Blend, Gaussian2d, effects::Background};
use gs_io::{AnyScene, Error, Values, is_scene, read_gsi, read_scene};

/// A compressed picture of this many Gaussians.
fn gsi(count: usize) -> Vec<u8> {
    picture(count).encode().unwrap()
}

fn picture(count: usize) -> Picture {
    let size = (48, 32);
    let head = LayerHead { step: -64, cell: 8, margin: 1, mean_ratio: 32, shape_ratio: 32, turn_ratio: 32 };
    let gaussian = |k: usize| Gaussian2d {
        mean: Vec2::new((k * 17 % 48) as f32, (k * 7 % 32) as f32),
        log_scale: Vec2::new((k % 5) as f32 * 0.6, (k % 3) as f32 * 0.5),
        rotation: k as f32 * 0.4,
        opacity_logit: f32::INFINITY,
        color: Vec3::new(0.5, 0.1 * (k % 7) as f32, -0.2),
    };
    let quantizer = Quantizer::new(head, size);
    let codes = (0..count).filter_map(|k| quantizer.quantize(&gaussian(k))).collect();
    let (alpha, profile) = (None, Vec::new());
    let layers = vec![Layer { head, codes }];
    Picture { width: size.0, height: size.1, background: [0, 51, 255], layers, alpha, profile }
}

#[test]
fn a_compressed_picture_is_a_scene_by_its_content() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["picture.gsi", "picture"] {
        let path = folder.path().join(name);
        fs::write(&path, gsi(30)).unwrap();
        assert!(is_scene(&path).unwrap());
        let AnyScene::TwoD(file) = read_scene(&path, Values::Checked).unwrap().scene else { panic!("a 3D scene") };
        assert_eq!((file.width, file.height, file.scene.means.len()), (48, 32, 30));
        assert_eq!((file.settings.effects.blend, file.settings.background), (Blend::Sum, [0.0, 0.2, 1.0]));
        assert_eq!(file.settings.effects.background, Background::Solid);
        file.validate().unwrap();
    }
}

#[test]
fn a_transparent_picture_is_a_scene_on_white() {
    let opaque = picture(30);
    let alpha = Some(Alpha { background: 153, layers: picture(20).layers });
    let bytes = Picture { alpha, profile: b"a profile".to_vec(), ..opaque }.encode().unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("picture.gsi");
    fs::write(&path, &bytes).unwrap();
    let file = read_gsi(&path, Extent::Whole).unwrap();
    let (colors, alpha) = (file.colors.scene.clone(), file.alpha.clone().unwrap());
    assert_eq!((colors.means.len(), alpha.scene.means.len(), alpha.width), (30, 20, 48));

    let found = read_scene(&path, Values::Checked).unwrap();
    let AnyScene::TwoD(white) = found.scene else { panic!("a 3D scene") };
    let close = |a: [f32; 3], b: [f32; 3]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-6);
    assert!(found.has_alpha && close(white.settings.background_color(), [0.4, 0.6, 1.4]));
    assert_eq!(white.profile.as_ref().unwrap().bytes(), b"a profile");
    // c + (1 − α), Gaussian by Gaussian.
    assert_eq!(white.scene.colors[..30], colors.colors);
    for (found, alpha) in white.scene.iter().skip(30).zip(alpha.scene.iter()) {
        assert_eq!(found, Gaussian2d { color: Vec3::splat(-alpha.color.x), ..alpha });
    }
    assert_eq!(white.scene.means.len(), 50);
    let black = file.on([0.0; 3]);
    assert_eq!(black.settings.background_color(), [0.0, 0.2, 1.0]);
}

#[test]
fn damaged_pictures_are_refused_in_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("picture.gsi");
    let whole = gsi(30);
    let mut damaged = whole.clone();
    damaged[40] ^= 4;
    let half = &whole[..whole.len() / 2];
    let cases: [(&[u8], &str); 4] = [
        (half, "picture.gsi: ends after"),
        (&damaged, "picture.gsi: is corrupt: the checksum of layer 1 does not match; fetch or encode it again"),
        (b"GSIF\x07\x00", "picture.gsi: version 7 is not supported"),
        (b"\x89PNG\r\n", "picture.gsi: is not a .gsi file"),
    ];
    for (bytes, expected) in cases {
        fs::write(&path, bytes).unwrap();
        let error = read_scene(&path, Values::Checked).unwrap_err();
        assert!(matches!(error, Error::Compressed { .. }));
        let message = error.to_string();
        assert!(message.contains(expected) && !message.contains('\n'), "{message}");
    }
    assert!(matches!(read_gsi(folder.path().join("absent.gsi"), Extent::Whole), Err(Error::Missing { .. })));
}
