//! Runs the fuzz targets on the inputs of `corpus/`, which reach most of what the fuzzers reached.
//! `fuzz/README.md` describes their origin.

// The fuzz crate uses this module, too.
#[allow(unreachable_pub)]
mod targets;

use std::{fs, path::Path};

#[test]
fn the_corpus_is_read_or_refused() {
    for (target, run) in targets::TARGETS {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fuzzed/corpus").join(target);
        let inputs: Vec<_> = fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().path()).collect();
        assert!(inputs.len() > 3, "{target}: only {} inputs", inputs.len());
        for input in inputs {
            // Shown if this input fails.
            eprintln!("{}", input.display());
            run(&fs::read(&input).unwrap());
        }
    }
}

#[test]
fn all_checksums_of_a_compressed_picture_are_set_right() {
    let damaged = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fuzzed/corpus/gsi/transparent-damaged");
    let bytes = fs::read(damaged).unwrap();
    let decode = |bytes: &[u8]| gs_codec::decode(bytes, gs_codec::Extent::Whole);
    assert!(matches!(decode(&bytes), Err(gs_codec::Error::Checksum { layer: 1 })));
    let fixed = decode(&targets::with_checksums(&bytes));
    assert!(!matches!(fixed, Err(gs_codec::Error::Checksum { .. })), "{fixed:?}");
}
