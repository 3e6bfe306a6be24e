//! `gs page`: a scene and a viewer as one file for browsers.

use std::{
    fs,
    path::{Path, PathBuf},
};

use base64::{Engine, engine::general_purpose::STANDARD};
use clap::Args;
use gs_io::{AnyScene, SceneFile, Values, WriteOptions3d, encode_2d, encode_3d, write_atomically};

use crate::{
    failure::Failure,
    files::{
        output_folder,
        page_files::{self, ONE_FILE},
        scene,
    },
    terminal::output,
};

/// Where the page takes a scene.
const PLACE: &str = "<!-- scene -->";

/// Size of a scene above which a smaller format is worth a word, bytes.
const LARGE: usize = 20_000_000;

/// The flags of `gs page`.
#[derive(Debug, Clone, Args)]
#[command(after_help = page_files::HELP)]
pub(crate) struct PageArgs {
    /// The scene: a scene file, a checkpoint, or the output folder of gs fit or gs train
    scene: PathBuf,
    /// The page to write, .html; it opens from disk, and fetches nothing
    #[arg(short, long, value_name = "PAGE.html")]
    output: PathBuf,
}

/// Writes a page.
pub(crate) fn run(args: &PageArgs) -> Result<(), Failure> {
    if !args.output.extension().is_some_and(|ending| ending == "html" || ending == "htm") {
        return Err(Failure::usage("a page ends in .html").at(args.output.display()));
    }
    let template = page_files::folder()?.join(ONE_FILE);
    let scene = scene::read(&args.scene, Values::Checked)?;
    let mut inputs = vec![scene.path.clone(), template.clone()];
    if let AnyScene::ThreeD(file) = &scene.scene {
        inputs.extend(file.beside.iter().cloned());
    }
    output_folder::check_file(&args.output, &inputs)?;
    let (name, bytes) = embedded(scene)?;
    let page = fs::read_to_string(&template).map_err(|error| Failure::failed(error).at(template.display()))?;
    let (before, after) = page.split_once(PLACE).ok_or_else(|| {
        Failure::failed("has no place for a scene").at(template.display()).hint("cargo xtask web --install builds it")
    })?;
    let element = format!(
        "<script type=\"text/plain\" id=\"embedded-scene\" data-name=\"{}\">{}</script>",
        escaped(&name),
        STANDARD.encode(&bytes)
    );
    write_atomically(&args.output, |file| {
        [before, &element, after].iter().try_for_each(|part| file.write_all(part.as_bytes()))
    })?;
    if bytes.len() > LARGE && name.ends_with(".ply") {
        output::note("note: gs convert SCENE scene.sog first makes the page about ten times smaller, with some loss");
    }
    let size = before.len() + element.len() + after.len();
    output::result(format_args!("{}: {size} bytes, with {name} of {} bytes", args.output.display(), bytes.len()))
}

/// The name and the bytes of the scene in the page: those of its file, if that is one file that the
/// page reads, or else without any loss.
fn embedded(scene: SceneFile) -> Result<(String, Vec<u8>), Failure> {
    let SceneFile { path, scene, metadata, .. } = scene;
    let is_whole = match &scene {
        AnyScene::TwoD(_) => true,
        AnyScene::ThreeD(file) => file.beside.is_empty(),
    };
    if is_whole && metadata.is_none() {
        let bytes = fs::read(&path).map_err(|error| Failure::failed(error).at(path.display()))?;
        return Ok((file_name(&path), bytes));
    }
    match scene {
        AnyScene::TwoD(file) => Ok(("scene.gs2d.safetensors".to_owned(), encode_2d(&file)?)),
        AnyScene::ThreeD(file) => {
            let options = WriteOptions3d::default().with(|s| s.trained_with = file.trained_with);
            let encoded = encode_3d("scene.ply", &file.scene, &options).map_err(Failure::of_scene)?;
            Ok(("scene.ply".to_owned(), encoded.bytes))
        }
    }
}

fn file_name(path: &Path) -> String {
    path.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned())
}

/// A text as an attribute's value.
fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('"', "&quot;").replace('<', "&lt;")
}
