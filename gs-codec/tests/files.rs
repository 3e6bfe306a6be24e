//! Files: what comes back, what it costs, and what is refused.

use std::io::Write;

use flate2::{Compression, write::ZlibEncoder};
use glam::{Vec2, Vec3};
use gs_codec::{
    Alpha, Decoded, DecodedAlpha, Error, Extent, Layer, LayerHead, Picture, Quantizer, decode, profile_bytes,
};
use gs_core::{Gaussian2d, Scene as _};
use proptest::prelude::*;

const SIZE: (u32, u32) = (192, 128);
const HEAD: LayerHead = LayerHead { step: -64, cell: 8, margin: 2, mean_ratio: 32, shape_ratio: 32, turn_ratio: 32 };

/// Numbers in 0..1 that follow from `seed`.
fn numbers(seed: u64) -> impl FnMut() -> f32 {
    let mut state = seed;
    move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f32 / (1u64 << 24) as f32
    }
}

fn gaussians(count: usize, seed: u64) -> Vec<Gaussian2d> {
    let mut next = numbers(seed);
    let gaussian = |_| Gaussian2d {
        mean: Vec2::new(next() * 200.0 - 4.0, next() * 136.0 - 4.0),
        log_scale: Vec2::new(next() * 4.0 - 1.0, next() * 4.0 - 1.0),
        rotation: next() * 7.0 - 3.5,
        opacity_logit: f32::INFINITY,
        color: Vec3::new(next() - 0.4, next() - 0.5, next() - 0.6),
    };
    (0..count).map(gaussian).collect()
}

fn layer(head: LayerHead, gaussians: &[Gaussian2d]) -> Layer {
    let quantizer = Quantizer::new(head, SIZE);
    Layer { head, codes: gaussians.iter().filter_map(|g| quantizer.quantize(g)).collect() }
}

fn picture(layers: Vec<Layer>) -> Picture {
    Picture { width: SIZE.0, height: SIZE.1, background: [90, 100, 110], layers, alpha: None, profile: Vec::new() }
}

/// A picture of two layers with alpha of one, and a profile.
fn transparent(count: usize) -> Picture {
    let grey = |g: Gaussian2d| Gaussian2d { color: Vec3::splat(g.color.x), ..g };
    let alpha: Vec<Gaussian2d> = gaussians(count / 2, 22).into_iter().map(grey).collect();
    let layers = vec![layer(HEAD, &gaussians(count, 20)), layer(HEAD, &gaussians(count, 21))];
    let alpha = Some(Alpha { background: 255, layers: vec![layer(HEAD, &alpha)] });
    Picture { alpha, profile: b"a profile".to_vec(), ..picture(layers) }
}

fn sorted(layer: &Layer) -> Vec<Gaussian2d> {
    let mut codes = layer.codes.clone();
    codes.sort_unstable();
    let quantizer = Quantizer::new(layer.head, SIZE);
    codes.iter().map(|code| quantizer.reconstruct(code)).collect()
}

#[test]
fn an_encoded_picture_decodes_to_the_same_gaussians() {
    let coarse = LayerHead { step: 128, cell: 24, margin: 0, mean_ratio: 64, shape_ratio: 16, turn_ratio: 80 };
    let layers = vec![layer(HEAD, &gaussians(500, 1)), layer(coarse, &gaussians(40, 2)), layer(HEAD, &[])];
    let Decoded { width, height, background, scene, alpha, profile, layers: found } =
        decode(&picture(layers.clone()).encode().unwrap(), Extent::Whole).unwrap();
    assert!(alpha.is_none() && profile.is_empty());
    assert_eq!(((width, height), found), (SIZE, (3, 3)));
    assert_eq!(background, [90, 100, 110].map(|level| level as f32 / 255.0));
    let expected: Vec<Gaussian2d> = layers.iter().flat_map(sorted).collect();
    assert!(expected.len() > 500 && scene.iter().eq(expected));
}

#[test]
fn alpha_and_profiles_come_back() {
    let picture = transparent(100);
    let decoded = decode(&picture.encode().unwrap(), Extent::Whole).unwrap();
    let expected = |layers: &[Layer]| layers.iter().flat_map(sorted).collect::<Vec<_>>();
    let DecodedAlpha { background, scene } = decoded.alpha.unwrap();
    assert!(background == 1.0 && scene.iter().eq(expected(&picture.alpha.as_ref().unwrap().layers)));
    assert!(scene.len() > 30 && scene.colors.iter().all(|c| *c == Vec3::splat(c.x)), "grey stays grey");
    assert!(decoded.scene.iter().eq(expected(&picture.layers)));
    assert_eq!((decoded.profile, decoded.layers), (picture.profile.clone(), (3, 3)));
    // Each layer costs as much as in a file of its own.
    let alone = Picture { alpha: None, profile: Vec::new(), ..picture.clone() };
    let alpha = Picture { layers: picture.alpha.clone().unwrap().layers, ..alone.clone() };
    let [whole, colors, alpha] = [&picture, &alone, &alpha].map(|picture| picture.encode().unwrap().len());
    assert_eq!(whole, colors + (alpha - 12) + profile_bytes(&picture.profile));
}

#[test]
fn stripes_are_the_layer_from_top_to_bottom() {
    let whole = layer(HEAD, &gaussians(500, 9));
    for count in [1, 2, 7] {
        let stripes = whole.stripes(count);
        assert_eq!(stripes.len(), count);
        let found = decode(&picture(stripes.clone()).encode().unwrap(), Extent::Whole).unwrap();
        assert!(found.scene.iter().eq(sorted(&whole)) && found.layers == (count, count));
        let largest = stripes.iter().map(|stripe| stripe.codes.len()).max().unwrap();
        assert!(largest < whole.codes.len() / count + 80, "{largest} of {} in {count} stripes", whole.codes.len());
    }
    assert_eq!(layer(HEAD, &[]).stripes(3), [layer(HEAD, &[])]);
    // One row of cells cannot be cut.
    let row = gaussians(50, 9).into_iter().map(|g| Gaussian2d { mean: g.mean.with_y(40.0), ..g });
    let flat = layer(HEAD, &row.collect::<Vec<_>>());
    assert_eq!(flat.stripes(3).len(), 1);
}

#[test]
fn each_parameter_moves_the_image_by_less_than_a_step() {
    let quantizer = Quantizer::new(HEAD, SIZE);
    let step = (f32::from(HEAD.step) / 128.0).exp2();
    for g in gaussians(100, 3) {
        let Some(code) = quantizer.quantize(&g) else { continue };
        let q = quantizer.reconstruct(&code);
        let off = energy(&difference(&g, &q));
        // Eight parameters of at most half a step each, twice as much for the curvature of large
        // steps of faint Gaussians.
        assert!(off < 8.0 * step * step, "{g:?} {q:?}: {off} against {}", step * step);
    }
}

/// The difference of two Gaussians' pictures at every other pixel of every other row around them.
fn difference(a: &Gaussian2d, b: &Gaussian2d) -> Vec<Vec3> {
    let weight = |g: &Gaussian2d, at: Vec2| (-0.5 * (g.factor().inverse() * (at - g.mean)).length_squared()).exp();
    let pixel = |k: u32| 2.0 * Vec2::new((k % 240) as f32 - 70.0, (k / 240) as f32 - 70.0);
    (0..240 * 205).map(|k| a.color * weight(a, pixel(k)) - b.color * weight(b, pixel(k))).collect()
}

fn energy(picture: &[Vec3]) -> f32 {
    picture.iter().map(|pixel| 4.0 * pixel.length_squared()).sum()
}

#[test]
fn the_order_of_gaussians_costs_nothing() {
    let forward = layer(HEAD, &gaussians(400, 4));
    let mut backward = forward.clone();
    backward.codes.reverse();
    let bytes = picture(vec![forward.clone()]).encode().unwrap();
    assert_eq!(bytes, picture(vec![backward]).encode().unwrap());
    // The estimate is that of the coder.
    let (bits, stored) = (forward.bits(SIZE), bytes.len() as f64 * 8.0);
    assert!((stored - bits - 30.0 * 8.0).abs() < 80.0, "{bits} bits estimated, {stored} stored");
}

#[test]
fn the_decoder_has_the_same_bits_on_every_machine() {
    let bytes = picture(vec![layer(HEAD, &gaussians(200, 5))]).encode().unwrap();
    let scene = decode(&bytes, Extent::Whole).unwrap().scene;
    let words = scene.iter().flat_map(|g| {
        let Gaussian2d { mean, log_scale, rotation, color, .. } = g;
        [mean.x, mean.y, log_scale.x, log_scale.y, rotation, color.x, color.y, color.z].map(f32::to_le_bytes)
    });
    let digest = crc32fast::hash(&words.flatten().collect::<Vec<u8>>());
    assert_eq!((scene.len(), digest), GOLDEN);
}

/// Number and checksum of the Gaussians above.
const GOLDEN: (usize, u32) = (195, 3_048_888_178);

#[test]
fn truncated_files_are_errors_unless_a_prefix_is_enough() {
    let layers = vec![layer(HEAD, &gaussians(60, 6)), layer(HEAD, &gaussians(60, 7))];
    let bytes = picture(layers).encode().unwrap();
    let first = picture(vec![layer(HEAD, &gaussians(60, 6))]).encode().unwrap().len();
    let whole = decode(&bytes, Extent::Whole).unwrap();
    for length in 0..bytes.len() {
        let cut = &bytes[..length];
        assert!(decode(cut, Extent::Whole).is_err(), "{length} bytes");
        match decode(cut, Extent::Prefix) {
            Ok(decoded) => {
                assert_eq!(decoded.layers, (usize::from(length >= first), 2), "{length} bytes");
                // What is there is right: a beginning of the Gaussians of the whole file.
                let means = &decoded.scene.means;
                assert_eq!(*means, whole.scene.means[..means.len()], "{length} bytes");
                let due = whole.scene.means.len() * length.saturating_sub(48) / bytes.len();
                assert!(means.len() + 6 >= due, "{} of {due} Gaussians of {length} bytes", means.len());
            }
            Err(error) => assert!(length < 14, "{length} bytes: {error}"),
        }
    }
    assert!(decode(&bytes, Extent::Prefix).is_ok_and(|decoded| decoded.layers == (2, 2)));
}

#[test]
fn a_truncated_transparent_file_has_the_shape_of_what_it_shows() {
    let picture = transparent(12);
    let bytes = picture.encode().unwrap();
    let header = 14 + 2 + profile_bytes(&picture.profile);
    let whole = decode(&bytes, Extent::Whole).unwrap();
    let all = whole.alpha.as_ref().unwrap().scene.len();
    let mut steps = Vec::new();
    for length in 0..bytes.len() {
        let cut = &bytes[..length];
        assert!(decode(cut, Extent::Whole).is_err(), "{length} bytes");
        let Ok(decoded) = decode(cut, Extent::Prefix) else {
            assert!(length < header, "{length} bytes");
            continue;
        };
        assert!(length >= header && decoded.profile == picture.profile, "{length} bytes");
        let (alpha, means) = (decoded.alpha.unwrap().scene, &decoded.scene.means);
        assert_eq!(*means, whole.scene.means[..means.len()], "{length} bytes");
        assert!(alpha.len() == all || means.is_empty(), "{length} bytes");
        steps.push(decoded.layers);
    }
    steps.dedup();
    assert_eq!(steps, [(0, 3), (1, 3), (2, 3)]);
}

#[test]
fn damage_is_found_by_the_checksum() {
    for picture in [picture(vec![layer(HEAD, &gaussians(60, 8))]), transparent(20)] {
        let bytes = picture.encode().unwrap();
        for place in 0..bytes.len() {
            let mut damaged = bytes.clone();
            damaged[place] ^= 1 << (place % 8);
            for extent in [Extent::Whole, Extent::Prefix] {
                let decoded = decode(&damaged, extent);
                // A longer length makes a layer end behind the file, as if the file were truncated.
                let truncated = extent == Extent::Prefix && decoded.as_ref().is_ok_and(|d| d.layers.0 < d.layers.1);
                assert!(decoded.is_err() || truncated, "byte {place}");
            }
        }
        let more = [&bytes[..], b"x"].concat();
        assert!(matches!(decode(&more, Extent::Whole), Err(Error::Value { .. })));
    }
}

#[test]
fn impossible_headers_are_refused() {
    let refused = |flags: u8, rest: &[u8]| {
        let bytes = [&b"GSIF\x01"[..], &[flags], b"\xc0\x00\x80\x00\x00\x00\x00", rest].concat();
        let [whole, prefix] = [Extent::Whole, Extent::Prefix].map(|extent| decode(&bytes, extent).unwrap_err());
        assert_eq!(whole, prefix);
        whole.to_string()
    };
    assert!(refused(4, &[1]).contains("the feature of flag 4"), "{}", refused(4, &[1]));
    assert!(refused(0, &[0]).contains("number of layers is 0"), "{}", refused(0, &[0]));
    assert!(refused(1, &[1, 255, 0]).contains("number of layers is 0"), "{}", refused(1, &[1, 255, 0]));
    let mut bomb = ZlibEncoder::new(Vec::new(), Compression::best());
    bomb.write_all(&[0; 5_000_000]).unwrap();
    let bomb = bomb.finish().unwrap();
    let bomb = [&[1], &(bomb.len() as u16).to_le_bytes()[..], &bomb].concat();
    assert!(refused(2, &bomb).contains("colour profile is 65536"), "{}", refused(2, &bomb));
    for rest in [&[1, 0, 0][..], &[1, 2, 0, 7, 7], &[bomb[..20].as_ref(), &[0; 5000]].concat()] {
        assert!(refused(2, rest).contains("colour profile"), "{}", refused(2, rest));
    }
    for (flags, rest) in [(1, &[1][..]), (1, &[1, 255]), (2, &[1]), (2, &[1, 9]), (3, &[1, 255, 1, 255, 255, 7])] {
        assert!(refused(flags, rest).contains("in the middle of the header"), "{}", refused(flags, rest));
    }
    let long = Picture { profile: vec![0; 65_536], ..transparent(4) };
    assert!(matches!(long.encode(), Err(Error::Value { value: 65_536, .. })));
    assert!(matches!(picture(Vec::new()).encode(), Err(Error::Value { value: 0, .. })));
}

#[test]
fn steps_of_infinite_colours_are_refused() {
    let step_of = |step: i16| LayerHead { step, ..HEAD };
    let bright = Gaussian2d { color: Vec3::splat(1e13), ..gaussians(1, 3)[0] };
    for step in [-LayerHead::MOST_STEP, LayerHead::MOST_STEP] {
        let bytes = picture(vec![layer(step_of(step), &[bright])]).encode().unwrap();
        let color = decode(&bytes, Extent::Whole).unwrap().scene.colors[0];
        assert!(color.is_finite() && color.max_element() > 0.0, "{step}: {color}");
    }
    for step in [i16::MIN, -LayerHead::MOST_STEP - 1, LayerHead::MOST_STEP + 1, i16::MAX] {
        let refused = picture(vec![layer(step_of(step), &[])]).encode();
        assert!(matches!(refused, Err(Error::Value { what: "the step of a layer", .. })), "{step}: {refused:?}");
        // The step follows the header and the four numbers of an empty layer.
        let mut bytes = picture(vec![layer(HEAD, &[])]).encode().unwrap();
        assert_eq!(bytes[18..20], HEAD.step.to_le_bytes());
        bytes[18..20].copy_from_slice(&step.to_le_bytes());
        let end = bytes.len() - 4;
        let checksum = crc32fast::hash(&bytes[..end]).to_le_bytes();
        bytes[end..].copy_from_slice(&checksum);
        let refused = decode(&bytes, Extent::Whole);
        assert!(matches!(refused, Err(Error::Value { what: "the step of a layer", .. })), "{step}: {refused:?}");
    }
}

#[test]
fn impossible_claims_are_refused_by_size() {
    let refusal = |(count, rows): (usize, usize), content: &[u8], cell: u8, size: (u32, u32)| {
        let mut bytes = b"GSIF\x01\x00".to_vec();
        bytes.extend([size.0, size.1].map(|side| (side as u16).to_le_bytes()).concat());
        bytes.extend([0, 0, 0, 1]);
        for mut number in [count, content.len(), 0, rows] {
            while number > 127 {
                bytes.push(number as u8 & 127 | 128);
                number >>= 7;
            }
            bytes.push(number as u8);
        }
        bytes.extend([0, 0, cell, 0, 32, 32, 32]);
        bytes.extend(content);
        bytes.extend(crc32fast::hash(&bytes).to_le_bytes());
        decode(&bytes, Extent::Whole).unwrap_err().to_string()
    };
    let many = refusal((200_000_000, 16), &[0; 100], 8, SIZE);
    assert!(many.contains("number of Gaussians of a layer is 200000000"), "{many}");
    let cells = refusal((10, 16_384), &[0; 100], 1, (16_384, 16_384));
    assert!(cells.contains("number of cells of a layer is 268435456"), "{cells}");
    let size = refusal((10, 1), &[0; 100], 8, (16_385, 1));
    assert!(size.contains("16385x1 px is not possible"), "{size}");
    let row = refusal((10, 17), &[0; 100], 8, SIZE);
    assert!(row.contains("the last row of cells of a layer is 17"), "{row}");
    let cell = refusal((10, 1), &[0; 100], 0, SIZE);
    assert!(cell.contains("cell size or a ratio of a layer is 0"), "{cell}");
    assert_eq!(decode(b"GIF89a", Extent::Whole), Err(Error::Magic));
    assert!(matches!(decode(b"GSIF\x02\x00", Extent::Whole), Err(Error::Unsupported { what: "version", value: 2 })));
}

proptest! {
    #[test]
    fn any_gaussians_survive(
        values in prop::collection::vec((-1e5f32..1e5, -1e5f32..1e5, -30f32..30.0, -30f32..30.0, -1e3f32..1e3, -1e4f32..1e4), 0..40),
        step in -2000i16..2000,
        cell in 8u8..=255,
        ratio in 1u8..=255,
    ) {
        let head = LayerHead { step, cell, margin: 1, mean_ratio: ratio, shape_ratio: ratio, turn_ratio: ratio };
        let gaussian = |&(x, y, a, b, rotation, c): &(f32, f32, f32, f32, f32, f32)| Gaussian2d {
            mean: Vec2::new(x, y),
            log_scale: Vec2::new(a, b),
            rotation,
            opacity_logit: f32::INFINITY,
            color: Vec3::new(c, -c, 0.5),
        };
        let all = layer(head, &values.iter().map(gaussian).collect::<Vec<_>>());
        let decoded = decode(&picture(vec![all.clone()]).encode().unwrap(), Extent::Whole).unwrap();
        prop_assert!(decoded.scene.validate().is_ok());
        prop_assert!(decoded.scene.iter().eq(sorted(&all)));
    }

    #[test]
    fn any_bytes_are_decoded_or_refused(content in prop::collection::vec(any::<u8>(), 0..200), count in 0u8..128) {
        let mut bytes = b"GSIF\x01\x00\xc0\x00\x80\x00\x00\x00\x00\x01".to_vec();
        bytes.extend([count, content.len() as u8 & 127 | 128, (content.len() >> 7) as u8, 0, 18]);
        bytes.extend([0, 0, 8, 1, 32, 32, 32]);
        bytes.extend(&content);
        bytes.extend(crc32fast::hash(&bytes).to_le_bytes());
        if let Ok(decoded) = decode(&bytes, Extent::Whole) {
            prop_assert_eq!(decoded.scene.len(), usize::from(count));
            prop_assert!(decoded.scene.validate().is_ok());
        }
    }
}
