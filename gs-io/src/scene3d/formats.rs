//! The table of formats: all that the rest of the crate knows of one is in its row.

use std::path::{Path, PathBuf};

use super::{
    Encoded3d, File3d, Format3d,
    foreign::{TILESET, has_name},
    gltf, ksplat,
    options::ToWrite,
    ply, rad, sog,
    source::Source,
    splat, spz,
    streamed::{self, LodFile3d},
};
use crate::error::Error;

/// Opens the levels of detail of a file; `None` for one without them.
type OpenLevels = fn(&Source<'_>) -> Result<Option<LodFile3d>, Error>;

/// What writes a format.
type Encode = fn(&ToWrite<'_>) -> Result<Encoded3d, Error>;

/// What writes a format, or the refusal to where formats are only read.
const fn written(encode: Encode) -> Encode {
    if cfg!(feature = "write") { encode } else { ROW.encode }
}

/// A format.
pub(super) struct Row {
    pub(super) format: Format3d,
    /// Its name.
    pub(super) name: &'static str,
    /// A file of the format in messages, with an article.
    pub(super) what: &'static str,
    /// The end of the names of files that are written in the format; of a format that is only read, none.
    pub(super) ending: Option<&'static str>,
    /// Whether a file is of the format, by its first bytes and its path.
    recognises: fn(&[u8], &Path) -> bool,
    pub(super) read: fn(&Source<'_>, Format3d) -> Result<File3d, Error>,
    /// Opens the levels of detail of a file, if it has some.
    pub(super) levels: Option<OpenLevels>,
    pub(super) encode: Encode,
    /// The further files that writing a scene of an SH degree to a path makes.
    pub(super) beside: fn(&Path, u8) -> Vec<PathBuf>,
    /// Whether files have the frame of their scene.
    pub(super) stores_frame: bool,
    /// Largest coordinate in a file.
    pub(super) largest: f64,
    /// Bytes of memory that reading takes for each byte of a file. A Gaussian takes 56 in memory, and
    /// 12 for each SH coefficient above degree 0, besides its bytes in the file.
    pub(super) memory: u64,
}

/// All formats. The first that recognises a file is its format.
const FORMATS: &[Row] = &[
    Row {
        format: Format3d::Ply,
        name: "3DGS PLY",
        what: "a PLY of Gaussians",
        ending: Some(".ply"),
        recognises: |start, _| start.starts_with(b"ply\n") || start.starts_with(b"ply\r\n"),
        read: ply::read,
        encode: written(ply::encode),
        stores_frame: true,
        ..ROW
    },
    // The reader of PLY tells it apart.
    Row { format: Format3d::CompressedPly, name: "compressed PLY", what: "a PLY of Gaussians", read: ply::read, ..ROW },
    Row {
        format: Format3d::Spz,
        name: "SPZ",
        what: "an SPZ file",
        ending: Some(".spz"),
        recognises: |start, _| start.starts_with(b"NGSP") || start.starts_with(&[0x1f, 0x8b, 8]),
        read: spz::read,
        encode: written(spz::encode),
        largest: ((1 << 23) - 1) as f64,
        memory: 14,
        ..ROW
    },
    Row {
        format: Format3d::Sog,
        name: "SOG",
        what: "a SOG",
        ending: Some(".sog"),
        recognises: |start, path| {
            sog::recognises_bundle(start) || (start.starts_with(b"PK") && has_ending(path, "sog"))
        },
        read: sog::read,
        encode: written(sog::encode),
        memory: 14,
        ..ROW
    },
    Row {
        format: Format3d::SogFolder,
        name: "SOG in a folder",
        what: "a SOG",
        ending: Some(sog::META),
        recognises: |start, path| gltf::recognises(start) && has_name(path, sog::META),
        read: sog::read,
        encode: written(sog::encode),
        beside: |path, sh_degree| sog::image_names(sh_degree).iter().map(|name| path.with_file_name(name)).collect(),
        memory: 14,
        ..ROW
    },
    Row {
        format: Format3d::StreamedSog,
        name: "streamed SOG",
        what: streamed::WHAT,
        ending: Some(streamed::META),
        recognises: |start, path| gltf::recognises(start) && has_name(path, streamed::META),
        read: |source, _| LodFile3d::parse(source)?.read_finest(),
        levels: Some(|source| LodFile3d::parse(source).map(Some)),
        encode: |write| Err(Error::unsupported(write.path, "a streamed SOG in memory", "write it with write_3d")),
        beside: |path, _| streamed::chunk_files(path),
        memory: 14,
        ..ROW
    },
    Row {
        format: Format3d::Tiles3d,
        name: "3D Tiles",
        what: "a tileset of 3D Tiles",
        ending: Some(TILESET),
        encode: |write| Err(Error::unsupported(write.path, "a tileset in memory", "write it with write_3d")),
        beside: |path, _| streamed::chunk_files(path),
        largest: ((1 << 23) - 1) as f64,
        ..ROW
    },
    Row {
        format: Format3d::Rad,
        name: "RAD",
        what: "a RAD file",
        ending: Some(".rad"),
        recognises: |start, path| start.starts_with(&rad::MAGIC) || has_ending(path, "rad"),
        read: rad::read,
        levels: Some(rad::levels),
        #[cfg(feature = "write")]
        encode: rad::encode,
        memory: 14,
        ..ROW
    },
    Row {
        format: Format3d::Glb,
        name: "binary glTF",
        what: "a glTF of Gaussians",
        ending: Some(".glb"),
        recognises: |start, _| start.starts_with(b"glTF"),
        read: gltf::read,
        encode: written(gltf::encode),
        stores_frame: true,
        ..ROW
    },
    Row {
        format: Format3d::Gltf,
        name: "glTF",
        what: "a glTF of Gaussians",
        ending: Some(".gltf"),
        recognises: |start, _| gltf::recognises(start),
        read: gltf::read,
        encode: written(gltf::encode),
        stores_frame: true,
        ..ROW
    },
    Row {
        format: Format3d::Splat,
        name: ".splat",
        what: "a .splat file",
        ending: Some(".splat"),
        recognises: |_, path| has_ending(path, "splat"),
        read: splat::read,
        encode: written(splat::encode),
        memory: 4,
        ..ROW
    },
    Row {
        format: Format3d::Ksplat,
        name: ".ksplat",
        what: "a .ksplat file",
        recognises: |_, path| has_ending(path, "ksplat"),
        read: ksplat::read,
        memory: 5,
        ..ROW
    },
    ROW,
];

/// What most formats have, and the row of checkpoints, which this module does not read.
const ROW: Row = Row {
    format: Format3d::Checkpoint,
    name: "checkpoint",
    what: "a checkpoint",
    ending: None,
    recognises: |_, _| false,
    read: |source, _| Err(Error::not_a_3d_scene(source.path, "a checkpoint")),
    levels: None,
    encode: |to| Err(Format3d::unknown_ending(to.path)),
    beside: |_, _| Vec::new(),
    stores_frame: false,
    largest: f32::MAX as f64,
    memory: 3,
};

impl Format3d {
    pub(super) fn row(self) -> &'static Row {
        FORMATS.iter().find(|row| row.format == self).expect("every format has a row")
    }

    /// The format of a file by its first bytes or else by its extension; `None` for another kind of
    /// file.
    pub fn recognise(start: &[u8], path: &Path) -> Option<Self> {
        FORMATS.iter().find(|row| (row.recognises)(start, path)).map(|row| row.format)
    }

    /// The format to write by a file's extension; `None` if there is none.
    pub fn to_write(path: &Path) -> Option<Self> {
        let name = path.file_name()?.to_string_lossy().to_lowercase();
        let is_of = |ending: &str| match ending.starts_with('.') {
            true => name.ends_with(ending) && !name.ends_with(".compressed.ply"),
            false => has_name(path, ending),
        };
        FORMATS.iter().find(|row| row.ending.is_some_and(is_of)).map(|row| row.format)
    }

    /// The error for a file whose extension is not that of a format that can be written.
    pub fn unknown_ending(path: &Path) -> Error {
        Error::UnknownEnding { path: path.to_owned(), endings: Self::endings() }
    }

    /// The extensions of the formats that can be written, as a list in words.
    pub fn endings() -> String {
        in_words(FORMATS.iter().filter_map(|row| row.ending).filter(|ending| ending.starts_with('.')))
    }

    /// The names of the formats that can be read, as a list in words.
    pub fn names() -> String {
        let others = [Self::Checkpoint, Self::Tiles3d];
        in_words(FORMATS.iter().filter(|row| !others.contains(&row.format)).map(|row| row.name))
    }

    /// The further files that writing a scene of this degree to a path in this format makes.
    pub fn beside(self, path: &Path, sh_degree: u8) -> Vec<PathBuf> {
        (self.row().beside)(path, sh_degree)
    }

    /// Whether files of the format may have levels of detail, which [`LodFile3d::open`] opens.
    pub fn may_have_levels(self) -> bool {
        self.row().levels.is_some()
    }

    /// Bytes of memory that reading a file takes for each of the file's bytes.
    pub fn memory_per_byte(self) -> u64 {
        self.row().memory
    }
}

/// "a, b or c".
fn in_words(names: impl Iterator<Item = &'static str>) -> String {
    let names: Vec<_> = names.collect();
    match &names[..] {
        [first @ .., last] if !first.is_empty() => format!("{} or {last}", first.join(", ")),
        names => names.concat(),
    }
}

impl std::fmt::Display for Format3d {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.row().name)
    }
}

fn has_ending(path: &Path, ending: &str) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case(ending))
}
