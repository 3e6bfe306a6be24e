//! `gs eval`: how close two images are, or a scene in space is to the photographs of a data set.

use std::path::{Path, PathBuf};

use clap::Args;
use gs_core::{Image, Rasterizer, RenderSettings, Scene, SpatialScene, counted};
use gs_io::{
    ImageRemark, LoadedImage, SpatialFile,
    dataset::{may_be_dataset, read_dataset},
};
use gs_train::{
    ImageQuality,
    spatial::{Evaluation, PosedView, ViewQuality, Views, evaluate},
};
use serde::Serialize;

use crate::{
    backend::{Backend, BackendArgs, SpatialTask},
    failure::Failure,
    memory,
    output::{self, printable},
    shown::{ShownArgs, effects, why_empty},
    train::DatasetArgs,
};

/// The flags of `gs eval`.
#[derive(Debug, Clone, Args)]
pub(crate) struct EvalArgs {
    /// One image; or a scene in space (PLY, .splat, SPZ, glTF)
    a: PathBuf,
    /// The other, of the same size; or a data set of posed photographs, whose test views judge the scene
    b: PathBuf,
    /// Print JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    photographs: DatasetArgs,
    #[command(flatten)]
    shown: ShownArgs,
    #[command(flatten)]
    backend: BackendArgs,
}

/// What `gs eval --json` prints; a PSNR of ∞ (equal images) is `null`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
struct Comparison {
    width: u32,
    height: u32,
    #[serde(flatten)]
    quality: ImageQuality,
}

/// Compares two images, or judges a scene.
///
/// # Errors
/// Where one cannot be read, or images differ in size.
pub(crate) fn run(args: &EvalArgs) -> Result<(), Failure> {
    // A scene is judged by a data set; what stands in its place is told to be none.
    if may_be_dataset(&args.b) || matches!(gs_io::spatial_format(&args.a), Ok(Some(_))) {
        return judge(args);
    }
    let a = read(&args.a)?;
    let b = read(&args.b)?;
    if a.size() != b.size() {
        let size =
            |path: &Path, image: &Image| format!("{} is {}x{} px", path.display(), image.width(), image.height());
        let message = format!("sizes differ: {}, {}", size(&args.a, &a), size(&args.b, &b));
        return Err(Failure::failed(message).mend("compare images of one size; gs render --size makes one"));
    }
    let (width, height) = a.size();
    let quality = ImageQuality::between(&a, &b)?;
    if args.json {
        return output::json(&Comparison { width, height, quality });
    }
    let ImageQuality { psnr, ssim, ms_ssim, l1 } = quality;
    let ms_ssim = ms_ssim.map_or_else(|| "none below 161 px a side".to_owned(), |value| format!("{value:.5}"));
    output::result(format_args!(
        "size     {width}x{height} px\nPSNR     {psnr:.3} dB\nSSIM     {ssim:.5}\nMS-SSIM  {ms_ssim}\nL1       {l1:.6}"
    ))
}

fn read(path: &Path) -> Result<Image, Failure> {
    memory::check_image(path)?;
    let LoadedImage { image, remarks, .. } = gs_io::read_image(path)?;
    let of = |remark: &ImageRemark| printable(&format!("{}: {remark}", path.display())).into_owned();
    remarks.iter().for_each(|remark| output::note(format_args!("note: {}", of(remark))));
    Ok(image)
}

/// Judges a scene by the test views of a data set; by all, where none is held out.
fn judge(args: &EvalArgs) -> Result<(), Failure> {
    let SpatialFile { scene, trained_with, .. } = gs_io::read_spatial(&args.a).map_err(Failure::of_scene)?;
    let dataset = read_dataset(&args.b, &args.photographs.settings())?;
    let render = args.shown.settings_beside(&scene, trained_with, &dataset);
    let Views { train, test, .. } = Views::of_dataset(&dataset);
    let views = if test.is_empty() { train } else { test };
    let backend = Backend::start(&args.backend)?;
    let evaluation = backend.run_spatial(Judge { scene: &scene, views: &views, render: &render })?;
    args.shown.note_guess(trained_with);
    output::note(format_args!("shown with {}", effects(&render)));
    if let Some(why) = why_empty(evaluation.culled, scene.len(), views.len()) {
        output::note(format_args!(
            "note: nothing of the scene is in sight of any view: {why}; are its axes and its unit those of the data set?"
        ));
    }
    if args.json {
        return output::json(&evaluation);
    }
    let row = |name: &str, psnr: f64, ssim: f64, l1: f64| {
        format!("{psnr:>9.3} dB {ssim:>9.5} {l1:>10.6}  {}\n", printable(name))
    };
    let mut text = format!("{:>12} {:>9} {:>10}\n", "PSNR", "SSIM", "L1");
    for ViewQuality { name, psnr, ssim, l1 } in &evaluation.views {
        text += &row(name, *psnr, *ssim, *l1);
    }
    evaluation.unmeasured.iter().for_each(|name| text += &format!("{:>33}  {}\n", "no pixel counts", printable(name)));
    let mean = format!("mean of {}", counted(evaluation.views.len(), "view"));
    output::result(text + row(&mean, evaluation.psnr, evaluation.ssim, evaluation.l1).trim_end())
}

/// Judges a scene by views of a data set.
pub(crate) struct Judge<'a> {
    pub(crate) scene: &'a SpatialScene,
    pub(crate) views: &'a [PosedView],
    pub(crate) render: &'a RenderSettings,
}

impl SpatialTask for Judge<'_> {
    type Output = Result<Evaluation, gs_train::Error>;

    fn run<R: Rasterizer<SpatialScene>>(self, rasterizer: &R) -> Self::Output {
        evaluate(rasterizer, self.scene, self.views, self.render)
    }
}
