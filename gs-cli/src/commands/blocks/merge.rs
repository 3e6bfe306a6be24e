//! `gs blocks merge`: one scene of all blocks, and its quality.

use gs_backend::FutureExt as _;
use gs_core::{Scene as _, counted};
use gs_io::{FolderClaim, Inputs, write_levels_of_parts_3d, write_parts_3d, write_png};
use gs_lab::blocks::BlocksFolder;
use gs_train::{
    blocks::{BlockQuality, BlocksEvaluation, evaluate},
    train::Views,
};

use super::{
    arguments::MergeArgs,
    folder_and_views::{open, views},
};
use crate::{
    failure::Failure,
    files::{
        output_folder::{self, OutputFolder},
        scene,
    },
    memory::{self, Need},
    terminal::output,
};

const SCENE: &str = "scene.ply";
const EVALUATION: &str = "evaluation.json";
const SEAMS: &str = "seams.png";
const LOD: &str = "lod";

/// Joins the blocks, or evaluates another scene.
pub(super) fn run(args: &MergeArgs) -> Result<(), Failure> {
    let folder = open(&args.folder)?;
    let claim = args.overwrite.claim(folder.path(), [SCENE, EVALUATION, SEAMS], Inputs::default());
    let compared = args.compare.as_deref().map(scene::read_3d).transpose()?;
    if compared.is_none() {
        output_folder::check(&claim)?;
    }
    let counts = folder.counts()?;
    let gaussians: usize = counts.iter().sum();
    let of_blocks = folder.plan().settings.render;
    let compared = compared.map(|mut file| {
        file.move_to(folder.origin().frame);
        let background = of_blocks.background_color();
        (file.trained_with.render_settings(file.scene.sh_degree, background), file.scene)
    });
    // Also sets the number of threads.
    let backend = args.backend.or_recorded(&folder.origin().machine).open()?;
    if compared.is_none() {
        let output = OutputFolder::begin(claim.clone())?;
        // First, because levels that are in the way are refused.
        levels(&folder, args.lod.then_some(&counts))?;
        output.leave_out([EVALUATION, SEAMS])?;
        let blocks = (0..counts.len()).map(|block| folder.result(block));
        write_parts_3d(output.file(SCENE), gaussians, &folder.write_options(), blocks)?;
        output::note(format_args!(
            "{} of {} in {}",
            counted(gaussians, "Gaussian"),
            counted(counts.len(), "block"),
            folder.path().join(SCENE).display()
        ));
    }
    let views = views(&folder, &args.data)?;
    if views.test.is_empty() {
        output::note("note: no view is held out, so the scene is not evaluated");
        return Ok(());
    }
    let compared_size = compared.as_ref().map(|(_, scene)| (scene.len(), scene.sh_degree));
    let need = Need {
        what: "evaluating the scene".to_owned(),
        bytes: memory::evaluating([(gaussians, of_blocks.effects.sh_degree)].into_iter().chain(compared_size)),
        held: 0,
        less: "do it on a larger machine",
    };
    match (need.check(), &compared) {
        (Err(failure), None) => {
            output::note(format_args!("note: there is no {EVALUATION}: {}", failure.message()));
            return Ok(());
        }
        (checked, _) => checked?,
    }
    let merged = folder.merged()?;
    let (render, scene) = compared.as_ref().map_or((of_blocks, &merged), |(render, scene)| (*render, scene));
    let views = Views { keep_bytes: 0, ..views }.cached();
    let (on, plan) = (&backend.rasterizer, folder.plan());
    let report = evaluate(on, plan, (scene, &merged), &views.test, &render).block_on()?;
    if compared.is_none() {
        let output = OutputFolder::begin(claim)?;
        output.write_json(EVALUATION, &report)?;
        report.seams.as_ref().map(|seams| write_png(output.file(SEAMS), seams)).transpose()?;
    }
    output::result(table(&report))
}

/// Writes levels of detail of blocks with these numbers of Gaussians: a tree for each block, and one above them. Without
/// numbers, removes the levels of an earlier merge.
fn levels(folder: &BlocksFolder, counts: Option<&Vec<usize>>) -> Result<(), Failure> {
    let (place, meta) = (folder.path().join(LOD), "lod-meta.json");
    let path = place.join(meta);
    let Some(counts) = counts else {
        let claim = FolderClaim::new(&place, [meta.to_owned()]);
        // What gs did not write stays.
        if path.exists() && claim.check().is_ok() {
            claim.begin()?.remove(meta)?;
        }
        return Ok(());
    };
    let (degree, options) = (folder.plan().settings.render.effects.sh_degree, folder.write_options());
    let written = write_levels_of_parts_3d(&path, degree, counts, &options, |block| folder.result(block))?;
    written.losses.iter().for_each(|loss| output::note(format_args!("note: in {}: {loss}", path.display())));
    output::note(format_args!("levels of detail in {}", path.display()));
    Ok(())
}

fn table(BlocksEvaluation { whole, blocks, edges, .. }: &BlocksEvaluation) -> String {
    let cell =
        |value: Option<f64>, digits: usize| value.map_or_else(|| "-".to_owned(), |value| format!("{value:.digits$}"));
    let mut text = format!("{:<24} {:>5} {:>8} {:>8}\n", "held-out views", "views", "PSNR, dB", "SSIM");
    let mut row = |what: String, views: String, psnr, ssim| {
        text += &format!("{what:<24} {views:>5} {:>8} {:>8}\n", cell(psnr, 3), cell(ssim, 4));
    };
    for (number, BlockQuality { views, psnr, ssim }) in blocks.iter().enumerate() {
        row(format!("mostly block {}", number + 1), views.to_string(), *psnr, *ssim);
    }
    row("all".to_owned(), whole.views.len().to_string(), Some(whole.psnr), Some(whole.ssim));
    row("pixels near cell edges".to_owned(), String::new(), edges.near, None);
    row("other pixels".to_owned(), String::new(), edges.rest, None);
    text.trim_end().to_owned()
}
