//! RAD: every encoding, trees of levels of detail, chunks beside the file, and damaged files.

use std::{f32::consts::LN_2, fs};

use glam::Vec3;
use gs_core::{Gaussian3d, Scene, Scene3d, constants::SH_C0, sigmoid};
use gs_io::{Error, Format3d, LevelsInMemory, LodFile3d, WriteOptions3d, read_3d, write_3d};
use serde_json::{Value, json};

use super::samples::{self, rad, rad_floats, rad_properties, rad_tree, read};

/// The sample with properties in place of those of the same name, or in addition.
fn with(properties: &[(Value, Vec<u8>)]) -> Vec<u8> {
    let mut all = rad_properties();
    for new in properties {
        match all.iter_mut().find(|old| old.0["property"] == new.0["property"]) {
            Some(old) => *old = new.clone(),
            None => all.push(new.clone()),
        }
    }
    rad(2, &all, json!({ "maxSh": 1 }), json!({}))
}

fn encoded(property: &str, encoding: &str, range: [f32; 2], bytes: Vec<u8>) -> (Value, Vec<u8>) {
    (json!({ "property": property, "encoding": encoding, "min": range[0], "max": range[1] }), bytes)
}

#[test]
fn a_file_of_32_bit_numbers_is_read_exactly() {
    let file = read(&with(&[]), "a.rad").unwrap();
    assert_eq!((file.format, file.scene.sh_degree), (Format3d::Rad, 1));
    let [first, second] = [0, 1].map(|i| file.scene.gaussian(i));
    assert_eq!((first.mean, second.mean), (Vec3::new(1.0, 2.0, 3.0), Vec3::new(-1.0, 0.0, 0.5)));
    assert_eq!((first.opacity_logit, second.opacity_logit), (-3.0_f32.ln(), 0.0));
    assert!(first.sh[0].abs_diff_eq(Vec3::new(0.0, 0.5, -0.5) / SH_C0, 1e-6));
    assert_eq!((first.sh[1], first.sh[3], second.sh[2]), (Vec3::new(0.0, 1.0, -1.0), first.sh[1], Vec3::splat(0.5)));
    assert_eq!(first.log_scale, Vec3::new(0.0, -LN_2, -2.0 * LN_2));
    assert_eq!((second.log_scale.x, second.log_scale.z), (LN_2, f32::NEG_INFINITY));
    assert_eq!(first.rotation, [1.0, 0.0, 0.0, 0.0]);
    assert!(second.rotation[0] < 1e-3 && second.rotation[1..] == [0.6, 0.0, 0.8]);
}

#[test]
fn all_encodings_give_the_same_numbers() {
    let half = |v: f32| {
        if v == 0.0 { 0 } else { ((v.to_bits() >> 31) << 15 | (((v.to_bits() >> 13) - (112 << 10)) & 0x7fff)) as u16 }
    };
    let of = |name: &str| rad_properties().into_iter().find(|(p, _)| p["property"] == name).unwrap().1;
    let floats = |name: &str| -> Vec<f32> { of(name).as_chunks().0.iter().map(|b| f32::from_le_bytes(*b)).collect() };
    let halves = |name: &str| -> Vec<u8> { floats(name).iter().flat_map(|v| half(*v).to_le_bytes()).collect() };
    let by_byte = |bytes: &[u8], size: usize| -> Vec<u8> {
        (0..size).flat_map(|k| bytes.iter().skip(k).step_by(size).copied().collect::<Vec<_>>()).collect()
    };
    let unit = [0.0, 1.0];
    let expected = read(&with(&[]), "a.rad").unwrap().scene;
    let colors = [[128, 0], [255, 128], [0, 255]];
    // The signs of 1, 0 and −1, times 127; then halves, which are rounded.
    let signs = [0_i8, 127, -127].repeat(3).into_iter().flat_map(|sign| [sign.cast_unsigned(), 64]);
    let differences =
        |planes: &[u8]| -> Vec<u8> { planes.chunks(2).flat_map(|p| [p[0], p[1].wrapping_sub(p[0])]).collect() };
    let signed: Vec<u8> = signs.collect();
    let unsigned: Vec<u8> = signed.iter().map(|byte| byte.wrapping_add(127)).collect();
    let in_254 = [-1.0, 128.0 / 127.0];
    for property in [
        encoded("center", "f32_lebytes", unit, by_byte(&of("center"), 4)),
        encoded("center", "f16", unit, halves("center")),
        encoded("center", "f16_lebytes", unit, by_byte(&halves("center"), 2)),
        encoded("alpha", "f16", unit, halves("alpha")),
        encoded("alpha", "r8", [0.0, 2.0], vec![32, 64]),
        encoded("rgb", "f16", unit, halves("rgb")),
        encoded("rgb", "r8", unit, colors.concat()),
        encoded("rgb", "r8_delta", unit, differences(&colors.concat())),
        // ln of 1, 2; 1/2, 1; 1/4, 0.
        encoded("scales", "ln_0r8", [-2.0 * LN_2, LN_2], vec![170, 255, 86, 170, 1, 0]),
        encoded("orientation", "f16", unit, halves("orientation")),
        encoded("orientation", "oct88r8", unit, vec![255, 128, 0, 182, 128, 255]),
        encoded("sh1", "f16", unit, halves("sh1")),
        encoded("sh1", "s8", unit, signed.clone()),
        encoded("sh1", "s8_delta", unit, differences(&signed)),
        encoded("sh1", "r8", in_254, unsigned.clone()),
        encoded("sh1", "r8_delta", in_254, differences(&unsigned)),
    ] {
        let found = read(&with(std::slice::from_ref(&property)), "a.rad").unwrap().scene;
        let compressed = (property.0.clone(), deflate(&property.1));
        let mut compressed = compressed;
        compressed.0["compression"] = "gz".into();
        assert_eq!(read(&with(&[compressed]), "a.rad").unwrap().scene, found);
        assert_near(&found, &expected, &property.0.to_string());
    }
    // Logarithms have more digits in 16 bits than scales.
    let logs = [0.0, LN_2, -LN_2, 0.0, -2.0 * LN_2, -1e4].iter().flat_map(|v| half(*v).to_le_bytes());
    let found = read(&with(&[encoded("scales", "ln_f16", unit, logs.collect())]), "a.rad").unwrap().scene;
    assert!((found.log_scales[0].z + 2.0 * LN_2).abs() < 1e-3 && (found.log_scales[1].z + 1e4).abs() < 8.0);
}

fn deflate(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = flate2::write::DeflateEncoder::new(Vec::new(), flate2::Compression::best());
    std::io::Write::write_all(&mut encoder, bytes).unwrap();
    encoder.finish().unwrap()
}

#[track_caller]
fn assert_near(a: &Scene3d, b: &Scene3d, what: &str) {
    for (a, b) in [0, 1].map(|i| (a.gaussian(i), b.gaussian(i))) {
        let triples =
            |g: &gs_core::Gaussian3d| [vec![g.mean, g.log_scale.max(Vec3::splat(-99.0))], g.sh.clone()].concat();
        for (a, b) in triples(&a).into_iter().zip(triples(&b)) {
            assert!(a.abs_diff_eq(b, 0.01), "{what}: {a} {b}");
        }
        assert!((sigmoid(a.opacity_logit) - sigmoid(b.opacity_logit)).abs() < 2e-3, "{what}");
        let cosine: f32 = a.rotation.iter().zip(b.rotation).map(|(a, b)| a * b).sum();
        assert!(cosine.abs() > 0.999, "{what}: {:?} {:?}", a.rotation, b.rotation);
    }
}

#[test]
fn coefficients_may_be_in_a_palette() {
    let mut properties = rad_properties();
    properties.retain(|(property, _)| property["property"] != "sh1");
    properties.push(rad_floats("sh1_code", &[[1.0; 9], [2.0; 9], [3.0; 9]]));
    let labels = |labels: [u16; 2]| {
        (json!({ "property": "sh_label", "encoding": "u16" }), labels.map(u16::to_le_bytes).concat())
    };
    let file = |chosen| {
        rad(2, &[&properties[..], &[labels(chosen)]].concat(), json!({ "maxSh": 1, "shCodeCount": 3 }), json!({}))
    };
    let scene = read(&file([2, 0]), "a.rad").unwrap().scene;
    assert_eq!((scene.gaussian(0).sh[1], scene.gaussian(1).sh[3]), (Vec3::splat(3.0), Vec3::ONE));
    assert!(read(&file([2, 3]), "a.rad").unwrap_err().to_string().contains("expected labels below 3, found 3"));
    // Without labels, there are no coefficients above degree 0.
    let scene = read(&rad(2, &properties, json!({ "maxSh": 1, "shCodeCount": 3 }), json!({})), "a.rad").unwrap().scene;
    assert_eq!(scene.gaussian(0).sh[1..], [Vec3::ZERO; 3]);
}

#[test]
fn those_that_stand_for_others_are_left_out() {
    let scene = read(&rad_tree(1, 1), "a.rad").unwrap().scene;
    assert_eq!((scene.len(), scene.means[0]), (1, Vec3::new(-1.0, 0.0, 0.5)));
}

#[test]
fn a_written_file_has_few_more_gaussians_than_its_scene() {
    for (count, most) in [(1, 1), (2, 3), (3, 5), (900, 1300)] {
        let bytes = samples::written("a.rad", &samples::scene(count, 1), &WriteOptions3d::default());
        let head: Value =
            serde_json::from_slice(&bytes[8..8 + u32::from_le_bytes(*bytes[4..].first_chunk().unwrap()) as usize])
                .unwrap();
        let all = head["count"].as_u64().unwrap() as usize;
        assert!(all >= count && all <= most && (count == 1 || all > count), "{all} for {count}");
        assert_eq!(read(&bytes, "a.rad").unwrap().scene.len(), count);
        assert_eq!(bytes.len() % 8, 0);
    }
}

/// The bytes as a file, and its levels of detail.
fn levels(bytes: &[u8]) -> Result<Option<LodFile3d>, Error> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.rad");
    fs::write(&path, bytes).unwrap();
    LodFile3d::open(&path)
}

#[test]
fn levels_of_detail_are_cut_from_the_tree() {
    let gaussian = |i: u32| Gaussian3d {
        mean: Vec3::new((i as f32 * 0.618_034).fract(), 0.0, (i as f32 * 0.754_877_7).fract()) * 40.0,
        log_scale: Vec3::splat(-1.5),
        rotation: [1.0, 0.0, 0.0, 0.0],
        opacity_logit: 1.0,
        sh: vec![Vec3::splat((i as f32 * 0.1).sin())],
    };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.rad");
    write_3d(&path, &(0..9000).map(gaussian).collect(), &WriteOptions3d::default()).unwrap();
    let file = LodFile3d::open(&path).unwrap().unwrap();
    let cells = file.tree().cells();
    for (bounds, levels) in &cells {
        assert!(levels[0].gaussians <= 1 << 9 && levels[0].error == 0.0 && bounds.min.cmple(bounds.max).all());
        assert!(levels.is_sorted_by(|a, b| a.gaussians >= b.gaussians && a.error <= b.error), "{levels:?}");
    }
    let counts = file.counts();
    assert!(cells.len() > 1 && counts[0] == 9000 && counts.windows(2).all(|c| 3 * c[1] < 2 * c[0]), "{counts:?}");
    // The distance of a surface's Gaussians from others in place of 16 of them is about theirs, 40 / √(9000 / 16).
    let error = cells[0].1[4].error;
    assert!((0.4..2.5).contains(&error), "{error}");
    // The finest level is the scene, in the order of the cells.
    let in_order = |scene: Scene3d| {
        let mut means: Vec<_> = scene.means.into_iter().map(|mean| mean.to_array().map(f32::to_bits)).collect();
        means.sort_unstable();
        means
    };
    let finest = file.read(&vec![0; cells.len()]).unwrap();
    let whole = read_3d(&path).unwrap();
    assert_eq!((finest.format, finest.bytes, &finest.losses), (Format3d::Rad, whole.bytes, &whole.losses));
    assert_eq!(in_order(finest.scene), in_order(whole.scene));
    // For moving cameras, all is in memory.
    let mut moving = LevelsInMemory::of(file.clone(), 0);
    let levels: Vec<usize> = (0..cells.len()).map(|cell| cell % counts.len()).collect();
    assert!(moving.missing(&levels, Vec3::ZERO).is_empty());
    fs::remove_file(&path).unwrap();
    let read = file.read(&levels).unwrap().scene;
    assert_eq!(read.len(), cells.iter().zip(&levels).map(|((_, all), level)| all[*level].gaussians).sum::<usize>());
    assert_eq!(moving.read(&levels).unwrap(), read);
    assert_eq!(moving.shown(&levels).iter().map(|part| part.len()).sum::<usize>(), read.len());
}

#[test]
fn files_without_a_tree_have_no_levels_and_damaged_trees_are_refused() {
    assert!(levels(&with(&[])).unwrap().is_none());
    assert!(matches!(levels(&rad_tree(2, 1)), Err(Error::Damaged { .. })));
    let empty = rad(0, &[], json!({ "lodTree": true, "chunks": [] }), json!({}));
    assert!(levels(&empty).unwrap_err().to_string().contains("without Gaussians"));
    let far = [rad_floats("center", &[[f32::NAN; 3], [0.0; 3]])];
    let tree = [rad_properties(), samples::rad_children(&[1, 0], &[1, 0])].concat();
    let mut broken = tree.clone();
    broken[0] = far[0].clone();
    let broken = rad(2, &broken, json!({ "maxSh": 1, "lodTree": true }), json!({}));
    assert!(matches!(levels(&broken), Err(Error::Content { .. })));
    let found = levels(&rad_tree(1, 1)).unwrap().unwrap();
    assert_eq!(found.counts(), [1]);
    assert_eq!(found.read(&[0]).unwrap().scene.means, [Vec3::new(-1.0, 0.0, 0.5)]);
}

#[test]
fn opacities_above_1_of_those_with_children_are_widths() {
    let floats = |name: &str, values: &[[f32; 1]; 3]| rad_floats(name, values);
    let triples = |name: &str| rad_floats(name, &[[0.0; 3], [1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]]);
    let mut all = vec![triples("center"), floats("alpha", &[[1.5], [0.5], [0.5]]), triples("rgb")];
    all.extend([rad_floats("scales", &[[1.0; 3]; 3]), rad_floats("orientation", &[[0.0; 3]; 3])]);
    all.extend(samples::rad_children(&[2, 0, 0], &[1, 0, 0]));
    let file = levels(&rad(3, &all, json!({ "lodTree": true }), json!({}))).unwrap().unwrap();
    let file = file.read(&[1]).unwrap();
    let one = file.scene.gaussian(0);
    assert_eq!((file.scene.len(), sigmoid(one.opacity_logit), file.losses.len()), (1, 1.0, 0));
    // At half its height, what Spark draws has half its height, too.
    let radius = (2.0 * LN_2).sqrt() * one.log_scale.x.exp();
    let n = ((3.0_f32.powi(2) - 1.0) / std::f32::consts::E).exp();
    let drawn = 1.0 - (1.0 - (-0.5 * radius * radius).exp()).powf(n);
    assert!((drawn - 0.5).abs() < 1e-3 && one.log_scale.x > 0.7, "{drawn} {}", one.log_scale);
}

#[test]
fn chunks_may_be_in_files_of_their_own() {
    let bytes = with(&[]);
    let place = bytes.windows(4).position(|part| part == b"RADC").unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.rad");
    let heads = |names: &[&str]| {
        let range = |name: &&str| json!({ "offset": 0, "bytes": bytes.len() - place, "filename": name });
        let ranges: Vec<_> = names.iter().map(range).collect();
        let all = rad(2, &[], json!({ "chunks": ranges, "maxSh": 1 }), json!({}));
        let end = all.windows(4).position(|part| part == b"RADC").unwrap();
        fs::write(&path, &all[..end]).unwrap();
        read_3d(&path)
    };
    let head = |name: &str| heads(&[name]);
    assert!(matches!(head("a-0.radc"), Err(Error::Missing { path }) if path.ends_with("a-0.radc")));
    fs::write(folder.path().join("a-0.radc"), &bytes[place..]).unwrap();
    let file = head("a-0.radc").unwrap();
    assert_eq!((file.scene.len(), file.beside.len()), (2, 1));
    assert!(file.bytes > (bytes.len() - place) as u64);
    let twice = heads(&["a-0.radc"; 2]).map(drop).unwrap_err().to_string();
    assert!(twice.contains("another file for each chunk"), "{twice}");
    for name in ["../a-0.radc", "/etc/hostname", ""] {
        let text = head(name).map(drop).unwrap_err().to_string();
        assert!(text.contains("names of chunks below its folder"), "{text}");
    }
}

#[test]
fn damaged_files_are_refused_with_the_place_and_what_to_do() {
    let head = |head: Value| rad(2, &rad_properties(), head, json!({}));
    let chunk = |chunk: Value| rad(2, &rad_properties(), json!({ "maxSh": 1 }), chunk);
    let range = |offset: u64, bytes: u64| head(json!({ "chunks": [{ "offset": offset, "bytes": bytes }] }));
    let property = |name: &str, key: &str, value: Value| {
        let mut properties = rad_properties();
        let there = properties.iter_mut().find(|(property, _)| property["property"] == name).unwrap();
        there.0[key] = value;
        rad(2, &properties, json!({ "maxSh": 1 }), json!({}))
    };
    let good = with(&[]);
    let mut long_head = good.clone();
    long_head[4..8].fill(0xff);
    let tree = rad_tree(1, 1);
    let three = |children: [u16; 3], starts: [u32; 3]| {
        let mut all = samples::rad_children(&children, &starts);
        all.extend(
            [("center", 3), ("alpha", 1), ("rgb", 3), ("scales", 3), ("orientation", 3)]
                .map(|(name, width)| (json!({ "property": name, "encoding": "f32" }), vec![0; 12 * width])),
        );
        rad(3, &all, json!({ "lodTree": true }), json!({}))
    };
    let tree_without = |name: &str| {
        let mut all = [rad_properties(), samples::rad_children(&[1, 0], &[1, 0])].concat();
        all.retain(|(property, _)| property["property"] != name);
        rad(2, &all, json!({ "maxSh": 1, "lodTree": true }), json!({}))
    };
    let empty = json!({ "property": "x", "encoding": "f32" });
    for (bytes, expected) in [
        (good[..good.len() - 9].to_vec(), "bytes of a chunk, found"),
        (good[..6].to_vec(), "byte 4: expected 4 bytes of the head, found 2 until the end of the file"),
        (b"RAD1....".to_vec(), "byte 0: expected `RAD0`"),
        (long_head, "4294967295 bytes of the head"),
        (tree[..tree.len() - 8].to_vec(), "of a chunk"),
        (range(1 << 40, 8), "expected 8 bytes of a chunk, found 0 until the end of the file"),
        (range(u64::MAX, 8), "expected offsets of chunks in the file, found 18446744073709551615"),
        (range(0, 1 << 60), "expected 1152921504606846976 bytes of a chunk"),
        (range(8, 64), "expected `RADC`"),
        (rad_tree(1, 0), "expected children of Gaussian 0 behind it and before 2, found 1 from 0"),
        (rad_tree(2, 1), "expected children of Gaussian 0 behind it and before 2, found 2 from 1"),
        (rad_tree(1, u32::MAX), "found 1 from 4294967295"),
        (three([2, 1, 0], [1, 2, 0]), "expected Gaussian 2 as the child of one other, found it also as one of 1"),
        (three([1, 1, 0], [1, 1, 0]), "expected children of Gaussian 1 behind it and before 3, found 1 from 1"),
        (three([1, 1, 0], [2, 0, 0]), "expected children of Gaussian 1 behind it and before 3, found 1 from 0"),
        (tree_without("child_count"), "expected the property `child_count`, as `lodTree` is true, found none"),
        (tree_without("child_start"), "expected the property `child_start`, as `lodTree` is true, found none"),
        (head(json!({ "count": 3 })), "expected 3 Gaussians in the chunks, found 2"),
        (head(json!({ "count": 1 })), "expected a chunk of at most 1 Gaussians from 0, found 2 from 0"),
        (chunk(json!({ "base": 1 })), "expected a chunk of at most 2 Gaussians from 0, found 2 from 1"),
        (head(json!({ "count": 1_u64 << 50 })), "more than its size allows; fetch it again"),
        (head(json!({ "count": u64::MAX, "maxSh": 3 })), "more than its size allows"),
        (head(json!({ "shCodeCount": u32::MAX })), "more than its size allows"),
        (head(json!({ "maxSh": 4 })), "expected an SH degree of 0 to 3, found 4"),
        (head(json!({ "version": 2 })), "expected a RAD file of version 1 or older, found version 2; update"),
        (chunk(json!({ "version": 7 })), "found version 7"),
        (head(json!({ "type": "mesh" })), "a RAD file of \"mesh\" is not supported"),
        (head(json!({ "chunks": 1 })), "expected the head as JSON, found one with: invalid type"),
        (chunk(json!({ "properties": [] })), "expected the property `center`, found none"),
        (chunk(json!({ "properties": [empty] })), "expected a chunk's head as JSON"),
        (property("alpha", "property", "opacity".into()), "expected the property `alpha`, found none"),
        (property("rgb", "encoding", "r4".into()), "the encoding \"r4\" of `rgb`"),
        (property("rgb", "encoding", "oct88r8".into()), "the encoding \"oct88r8\" of `rgb`"),
        (property("rgb", "compression", "zstd".into()), "the compression \"zstd\""),
        (property("rgb", "compression", "gz".into()), "a stream of Deflate"),
        (property("rgb", "bytes", 20.into()), "expected 24 bytes of `rgb`, found 20"),
        (property("rgb", "bytes", (1_u64 << 60).into()), "1152921504606846976 bytes of rgb"),
        (property("rgb", "offset", u64::MAX.into()), "expected an offset of `rgb` in the file"),
        (with(&[(json!({ "property": "alpha", "encoding": "r8", "min": 0 }), vec![0, 1])]), "a `max` of `alpha`"),
        (with(&[(json!({ "property": "sh1", "encoding": "s8" }), vec![0; 18])]), "a `max` of `sh1`"),
    ] {
        let text = read(&bytes, "a.rad").map(drop).expect_err(expected).to_string();
        assert!(text.starts_with("a.rad") && text.contains(expected) && !text.contains('\n'), "{text}, not {expected}");
        assert!(text.contains("; "), "{text} says nothing about what to do");
    }
}

#[test]
fn opacities_above_1_are_clamped_and_reported() {
    let file = read(&with(&[rad_floats("alpha", &[[1.5], [0.5]])]), "a.rad").unwrap();
    assert_eq!((sigmoid(file.scene.opacity_logits[0]), file.losses.len()), (1.0, 1));
}
