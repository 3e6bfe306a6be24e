//! `gs blocks merge`: one scene of all blocks, and its quality.

use gs_backend::FutureExt as _;
use gs_core::{RenderSettings, Scene as _, Scene3d, counted};
use gs_io::{Inputs, write_3d, write_png};
use gs_lab::blocks::BlocksFolder;
use gs_train::{
    blocks::{BlockQuality, BlocksEvaluation, evaluate},
    train::Views,
};

use super::{arguments::MergeArgs, open, views};
use crate::{
    failure::Failure,
    files::{
        output_folder::{self, OutputFolder},
        scene,
    },
    terminal::output,
};

const SCENE: &str = "scene.ply";
const EVALUATION: &str = "evaluation.json";
const SEAMS: &str = "seams.png";

/// Joins the blocks, or evaluates another scene.
pub(super) fn run(args: &MergeArgs) -> Result<(), Failure> {
    let folder = open(&args.folder)?;
    let claim = args.overwrite.claim(folder.path(), [SCENE, EVALUATION, SEAMS], Inputs::default());
    let compared = args.compare.as_deref().map(scene::read_3d).transpose()?;
    if compared.is_none() {
        output_folder::check(&claim)?;
    }
    let merged = folder.merged()?;
    let of_blocks = folder.plan().settings.render;
    let compared = compared.map(|mut file| {
        file.move_to(folder.origin().frame);
        let background = of_blocks.background_color();
        (file.trained_with.render_settings(file.scene.sh_degree, background), file.scene)
    });
    if compared.is_none() {
        let output = OutputFolder::begin(claim.clone())?;
        output.leave_out([EVALUATION, SEAMS])?;
        write_3d(output.file(SCENE), &merged, &folder.write_options())?;
        output::note(format_args!(
            "{} of {} in {}",
            counted(merged.len(), "Gaussian"),
            counted(folder.plan().blocks.len(), "block"),
            folder.path().join(SCENE).display()
        ));
    }
    let views = views(&folder, &args.data)?;
    if views.test.is_empty() {
        output::note("note: no view is held out, so the scene is not evaluated");
        return Ok(());
    }
    let (render, scene) = compared.as_ref().map_or((of_blocks, &merged), |(render, scene)| (*render, scene));
    let report = report(args, &folder, (scene, &merged), &render, &views)?;
    if compared.is_none() {
        let output = OutputFolder::begin(claim)?;
        output.write_json(EVALUATION, &report)?;
        report.seams.as_ref().map(|seams| write_png(output.file(SEAMS), seams)).transpose()?;
    }
    output::result(table(&report))
}

fn report(
    args: &MergeArgs,
    folder: &BlocksFolder,
    (scene, merged): (&Scene3d, &Scene3d),
    render: &RenderSettings,
    views: &Views,
) -> Result<BlocksEvaluation, Failure> {
    let views = Views { keep_bytes: 0, ..views.clone() }.cached();
    let backend = args.backend.or_recorded(&folder.origin().machine).open()?;
    Ok(evaluate(&backend.rasterizer, folder.plan(), (scene, merged), &views.test, render).block_on()?)
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
