//! `gs eval`: how close two images are, a 2D scene is to an image, or a 3D scene is to the images of a data set.

use pollster::FutureExt as _;
use std::path::{Path, PathBuf};

use clap::Args;
use gs_core::{Canvas, Image, Optimizer, RenderSettings, Scene as _, Scene2d, Scene3d, counted};
use gs_io::{
    File2d, ImageRemark, LoadedImage,
    dataset::{may_be_dataset, read_dataset},
};
use gs_train::{
    ImageQuality, is_scene,
    train::{Evaluation, PosedView, ViewQuality, Views, evaluate},
};
use serde::Serialize;

use crate::{
    backend::{Backend, BackendArgs, Task, Task3d},
    failure::Failure,
    memory,
    opened::{self, Opened3d, Scene},
    output::{self, printable},
    shown::{ShownArgs, effects, why_empty},
    train::DatasetArgs,
};

/// The flags of `gs eval`.
#[derive(Debug, Clone, Args)]
pub(crate) struct EvalArgs {
    /// An image; or a scene: a file of any kind, a checkpoint, or the output folder of gs fit or gs train
    a: PathBuf,
    /// The image to compare with, of the same size; for a 3D scene a data set of posed photographs, whose test views judge it
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
    let (a, b) = match is_scene(&args.a)?.then(|| opened::scene(&args.a)).transpose()? {
        Some(Scene::ThreeD(scene_3d)) => return judge(args, &scene_3d),
        Some(Scene::TwoD(file)) => rendered(args, &file)?,
        // Images have no views; what stands in a scene's place is told to be none.
        None if may_be_dataset(&args.b) => return judge(args, &opened::scene_3d(&args.a)?),
        None => (read(&args.a)?, read(&args.b)?),
    };
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
    let ImageQuality { psnr, ssim, ms_ssim, l1, .. } = quality;
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

/// A 2D scene as it is written in 8 bits at its own size, and the image that it is compared with.
fn rendered(args: &EvalArgs, file: &File2d) -> Result<(Image, Image), Failure> {
    if may_be_dataset(&args.b) || args.shown.is_some() {
        let message = "is a 2D scene, which is compared with an image and has no order or background to choose";
        return Err(Failure::usage(message).at(args.a.display()).mend("gs eval SCENE IMAGE"));
    }
    let image = read(&args.b)?;
    memory::check_picture(args.a.display(), (file.width, file.height))?;
    let backend = Backend::start(&args.backend)?;
    let rendering = backend.run(Draw(file))?;
    Ok((rendering.rounded_to_8_bits(), image))
}

struct Draw<'a>(&'a File2d);

impl Task for Draw<'_> {
    type Output = Result<Image, gs_core::Error>;

    fn run<R: Optimizer<Scene2d>>(self, rasterizer: &R) -> Self::Output {
        let File2d { scene, width, height, settings } = self.0;
        rasterizer.render(scene, &Canvas::new(*width, *height), settings).block_on()
    }
}

/// Judges a scene by the test views of a data set; by all, where none is held out.
fn judge(args: &EvalArgs, opened: &Opened3d) -> Result<(), Failure> {
    let scene = &opened.file.scene;
    let dataset = read_dataset(&args.b, &args.photographs.settings())?;
    let render = opened.settings(&args.shown, Some(&dataset));
    let Views { train, test, .. } = Views::of_dataset(&dataset);
    let views = if test.is_empty() { train } else { test };
    let backend = Backend::start(&args.backend)?;
    let evaluation = backend.run_3d(Judge { scene, views: &views, render: &render })?;
    opened.note_guess(&args.shown);
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
    for ViewQuality { name, psnr, ssim, l1, .. } in &evaluation.views {
        text += &row(name, *psnr, *ssim, *l1);
    }
    evaluation.unmeasured.iter().for_each(|name| text += &format!("{:>33}  {}\n", "no pixel counts", printable(name)));
    let mean = format!("mean of {}", counted(evaluation.views.len(), "view"));
    output::result(text + row(&mean, evaluation.psnr, evaluation.ssim, evaluation.l1).trim_end())
}

/// Judges a scene by views of a data set.
pub(crate) struct Judge<'a> {
    pub(crate) scene: &'a Scene3d,
    pub(crate) views: &'a [PosedView],
    pub(crate) render: &'a RenderSettings,
}

impl Task3d for Judge<'_> {
    type Output = Result<Evaluation, gs_train::Error>;

    fn run<R: Optimizer<Scene3d>>(self, rasterizer: &R) -> Self::Output {
        evaluate(rasterizer, self.scene, self.views, self.render).block_on()
    }
}
