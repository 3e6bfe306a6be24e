//! `gs poses` of photographs that are compared with their neighbours, and of thousands, with a program in place of COLMAP.

#![cfg(unix)]

use std::fs;

use gs_core::Image;

use crate::poses::Scene;

/// What `gs` says where only neighbours are compared.
const ONLY_NEIGHBOURS: &str = "note: photographs are compared with their neighbours only, and places visited twice \
    are not recognised: gs poses --vocabulary FILE finds them by a vocabulary tree of COLMAP";

/// So many tiny photographs in the folder `many`, of which COLMAP finds four poses.
fn many(count: usize) -> Scene {
    let scene = Scene::textured();
    gs_io::write_png(scene.path("tiny.png"), &Image::filled(2, 2, [0.5; 3]).unwrap()).unwrap();
    let bytes = fs::read(scene.path("tiny.png")).unwrap();
    fs::create_dir(scene.path("many")).unwrap();
    (0..count).for_each(|i| fs::write(scene.path(&format!("many/{i:04}.png")), &bytes).unwrap());
    scene.write_model(&["0000.png", "0001.png", "0002.png", "0003.png"]);
    // Where no features are found, there is no second attempt.
    scene.before("feature_extractor", "exit 0");
    scene
}

/// Photographs whose EXIF data has these seconds.
fn taken_at(seconds: &[(&str, u32)]) -> Scene {
    let scene = Scene::textured();
    fs::create_dir(scene.path("timed")).unwrap();
    for (name, seconds) in seconds {
        let image = Image::filled(2, 2, [0.5; 3]).unwrap();
        gs_io::write_png(scene.path("timed").join(name), &image).unwrap();
        let mut bytes = fs::read(scene.path("timed").join(name)).unwrap();
        let chunk = exif_chunk(&format!("2026:01:02 03:04:{seconds:02}\0"));
        // Behind the header.
        bytes.splice(33..33, chunk);
        fs::write(scene.path("timed").join(name), bytes).unwrap();
    }
    scene.write_model(&seconds.iter().map(|(name, _)| *name).collect::<Vec<_>>());
    scene
}

/// A chunk of a PNG with EXIF data that has `DateTimeOriginal`.
fn exif_chunk(time: &str) -> Vec<u8> {
    let parts: [&[u8]; 9] = [
        b"eXIfII*\0",
        &8_u32.to_le_bytes(),
        // One entry: where the next list is.
        &[1, 0, 0x69, 0x87, 4, 0, 1, 0, 0, 0],
        &26_u32.to_le_bytes(),
        &[0; 4],
        // One entry: a text of 20 bytes.
        &[1, 0, 0x03, 0x90, 2, 0, 20, 0, 0, 0],
        &44_u32.to_le_bytes(),
        &[0; 4],
        time.as_bytes(),
    ];
    let data = parts.concat();
    let check = !data.iter().fold(u32::MAX, |sum, byte| {
        (0..8).fold(sum ^ u32::from(*byte), |sum, _| if sum & 1 == 1 { sum >> 1 ^ 0xedb8_8320 } else { sum >> 1 })
    });
    [&(data.len() as u32 - 4).to_be_bytes()[..], &data, &check.to_be_bytes()].concat()
}

#[test]
fn thousands_of_photographs_are_compared_with_their_neighbours() {
    let scene = many(3000);
    let run = scene.gs(&["poses", "many", "-o", "set"]).done();
    assert!(run.stdout.starts_with("poor: 4 of 3000 photographs have poses"), "{run:?}");
    assert!(run.stderr.contains(ONLY_NEIGHBOURS), "{run:?}");
    assert_eq!(scene.calls(), ["feature_extractor", "sequential_matcher", "mapper"]);
    assert!(scene.log().contains("--SequentialMatching.overlap 10\n"));
}

#[test]
fn the_global_mapper_takes_the_number_of_threads() {
    let scene = many(251);
    scene.help("", "COLMAP 4.1.1 -- Structure-from-Motion\n  global_mapper\n  mapper");
    for (help, is_given) in [("  --GlobalMapper.num_threads arg (=-1)", true), ("", false)] {
        scene.help("global_mapper", help);
        scene.gs(&["poses", "many", "-o", "set", "--threads", "3"]).done();
        assert_eq!(scene.calls(), ["feature_extractor", "sequential_matcher", "global_mapper"]);
        assert_eq!(scene.log().contains("--GlobalMapper.num_threads 3\n"), is_given, "{}", scene.log());
    }
}

#[test]
fn neighbours_are_those_by_time() {
    let scene = taken_at(&[("a.png", 3), ("b.png", 1), ("c.png", 2)]);
    scene.before("matches_importer", "/bin/cp \"$list\" \"$here/pairs\"");
    let words = ["poses", "timed", "-o", "set", "--pairs", "neighbours"];
    let run = scene.gs(&words).done();
    assert_eq!(scene.calls(), ["feature_extractor", "matches_importer", "mapper"]);
    assert!(run.stderr.contains(ONLY_NEIGHBOURS) && scene.log().contains("--match_type pairs\n"), "{run:?}");
    assert_eq!(fs::read_to_string(scene.path("bin/pairs")).unwrap(), "b.png c.png\nb.png a.png\nc.png a.png\n");
    let run = scene.gs(&[&words[..], &["--vocabulary", "tree.bin"]].concat()).done();
    assert_eq!(scene.calls(), ["feature_extractor", "matches_importer", "sequential_matcher", "mapper"]);
    let expected = "--SequentialMatching.overlap 1 --SequentialMatching.loop_detection 1 \
                    --SequentialMatching.vocab_tree_path tree.bin\n";
    assert!(!run.stderr.contains("--vocabulary") && scene.log().contains(expected), "{run:?}");

    let scene = taken_at(&[("a.png", 1), ("b.png", 2), ("c.png", 2)]);
    scene.gs(&words).done();
    assert_eq!(scene.calls(), ["feature_extractor", "sequential_matcher", "mapper"], "by name is by time");
}

#[test]
fn a_vocabulary_tree_that_colmap_fetches_is_used() {
    let scene = Scene::textured();
    scene.help("", "COLMAP 3.12.6 -- Structure-from-Motion");
    scene.help("sequential_matcher", "  --SequentialMatching.vocab_tree_path arg (=https://host/tree;tree;96ca)");
    let words = ["poses", "photos", "-o", "set", "--pairs", "neighbours"];
    let run = scene.gs(&words).done();
    assert!(scene.log().contains("--SequentialMatching.loop_detection 1\n"), "{}", scene.log());
    assert!(!run.stderr.contains("--vocabulary"), "{run:?}");
    assert_eq!(scene.calls()[2..], ["sequential_matcher", "mapper"]);
    // Without a network, neighbours are compared all the same.
    let fails = "case $all in *loop_detection*) echo 'E2026 file.cc:1] Failed to download file'; exit 1 ;; esac";
    scene.before("sequential_matcher", fails);
    let run = scene.gs(&words).done();
    let why = "note: COLMAP cannot use the vocabulary tree that it fetches: Failed to download file\n";
    assert!(run.stderr.contains(why) && run.stderr.contains(ONLY_NEIGHBOURS), "{run:?}");
    assert_eq!(scene.calls()[2..], ["sequential_matcher", "sequential_matcher", "mapper"]);
    // One that is named must work.
    let run = scene.gs(&[&words[..], &["--vocabulary", "tree.bin"]].concat());
    assert!(run.status == Some(1) && run.stderr.contains("(Failed to download file): see "), "{run:?}");
}
