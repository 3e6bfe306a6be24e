//! `gs eval`: compares two images, a 2D scene with an image, or a 3D scene with the images of a
//! data set.

use std::path::{Path, PathBuf};

use clap::Args;
use gs_backend::FutureExt as _;
use gs_core::{Canvas, Image, Scene as _, counted};
use gs_io::{
    AnyScene, Extent, File2d, File3d, GsiFile, ImageRemark, LoadedImage, dataset::may_be_dataset, is_gsi, read_gsi,
};
use gs_train::{
    ImageQuality, draw_picture,
    train::{ColorMatched, PoseMatched, ViewQuality, Views, evaluate, evaluate_aligned},
};
use serde::Serialize;

use crate::{
    failure::Failure,
    files::scene,
    flags::{
        backend::BackendArgs,
        dataset::DatasetArgs,
        render_args::{self, RenderArgs3d, why_empty},
    },
    memory,
    terminal::output::{self, printable},
};

/// The flags of `gs eval`.
#[derive(Debug, Clone, Args)]
pub(crate) struct EvalArgs {
    /// An image, or a scene: a scene file, a checkpoint, or the output folder of gs fit or gs train
    a: PathBuf,
    /// The image to compare with, of the same size; for a 3D scene, a data set of posed images,
    /// whose test views are used
    b: PathBuf,
    /// Print JSON
    #[arg(long)]
    json: bool,
    /// Also measure with the pose of each view aligned to the left half of its image, on the right half
    #[arg(long)]
    refine_poses: bool,
    #[command(flatten)]
    images: DatasetArgs,
    #[command(flatten)]
    render: RenderArgs3d,
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

/// Compares two images, or evaluates a scene.
pub(crate) fn run(args: &EvalArgs) -> Result<(), Failure> {
    let scene = if is_gsi(&args.a) { None } else { scene::read_if_any(&args.a)? };
    let (a, b) = match scene {
        Some(AnyScene::ThreeD(file)) => return evaluate_3d(args, &file),
        Some(AnyScene::TwoD(file)) => rendered(args, &(*file).into())?,
        None if is_gsi(&args.a) => rendered(args, &read_gsi(&args.a, Extent::Whole)?)?,
        // An image has no views: the reader of scenes says that it is not a scene.
        None if may_be_dataset(&args.b) => return evaluate_3d(args, &scene::read_3d(&args.a)?),
        None => (read(&args.a)?, read(&args.b)?),
    };
    if args.refine_poses {
        return Err(Failure::usage("--refine-poses: only a 3D scene is compared at poses").hint("leave it out"));
    }
    if a.size() != b.size() {
        let size =
            |path: &Path, image: &Image| format!("{} is {}x{} px", path.display(), image.width(), image.height());
        let message = format!("sizes differ: {}, {}", size(&args.a, &a), size(&args.b, &b));
        return Err(Failure::failed(message).hint("compare images of one size; gs render --size makes one"));
    }
    let (width, height) = a.size();
    let quality = ImageQuality::between(&a, &b)?;
    if args.json {
        return output::json(&Comparison { width, height, quality });
    }
    let ImageQuality { psnr, ssim, ms_ssim, l1, .. } = quality;
    let ms_ssim = ms_ssim.map_or_else(|| "none below 161 px a side".to_owned(), |value| format!("{value:.5}"));
    let psnr = if psnr.is_finite() { format!("{psnr:.3} dB") } else { "inf dB (the images are equal)".to_owned() };
    output::result(format_args!(
        "size     {width}x{height} px\nPSNR     {psnr}\nSSIM     {ssim:.5}\nMS-SSIM  {ms_ssim}\nL1       {l1:.6}"
    ))
}

fn read(path: &Path) -> Result<Image, Failure> {
    memory::check_image(path)?;
    let LoadedImage { image, remarks, .. } = gs_io::read_image(path)?;
    let of = |remark: &ImageRemark| printable(&format!("{}: {remark}", path.display())).into_owned();
    remarks.iter().for_each(|remark| output::note(format_args!("note: {}", of(remark))));
    Ok(image)
}

/// A 2D scene rendered at its own size in 8 bits, as an image with its alpha and its profile is read,
/// and the image to compare it with.
fn rendered(args: &EvalArgs, picture: &GsiFile) -> Result<(Image, Image), Failure> {
    if may_be_dataset(&args.b) || args.render.is_some() {
        let message = "is a 2D scene, which is compared with an image, and has no order or background to choose";
        return Err(Failure::usage(message).at(args.a.display()).hint("gs eval SCENE IMAGE"));
    }
    let image = read(&args.b)?;
    let File2d { width, height, .. } = picture.colors;
    memory::check_picture(args.a.display(), (width, height))?;
    let backend = args.backend.open()?;
    let drawn = draw_picture(&backend.rasterizer, picture, &Canvas::new(width, height)).block_on()?;
    Ok((drawn.shown()?, image))
}

/// Evaluates a scene with the test views of a data set, or with all views if none is held out.
fn evaluate_3d(args: &EvalArgs, file: &File3d) -> Result<(), Failure> {
    let scene = &file.scene;
    let dataset = args.images.read_for(file, &args.b)?;
    let render = args.render.settings(file, Some(&dataset));
    // Each image is used once.
    let views = Views { keep_bytes: 0, ..Views::of_dataset(&dataset) }.cached();
    let backend = args.backend.open()?;
    let (rasterizer, used) = (&backend.rasterizer, views.test_or_train());
    let evaluation = match args.refine_poses {
        true => evaluate_aligned(rasterizer, scene, used, &render).block_on()?,
        false => evaluate(rasterizer, scene, used, &render).block_on()?,
    };
    args.render.note_guess(file);
    output::note(format_args!("rendered with {}", render_args::describe(&render)));
    if let Some(why) = why_empty(evaluation.culled, scene.len(), views.test_or_train().len()) {
        output::note(format_args!(
            "note: nothing of the scene is in sight of any view: {why}; does it have the axes and the unit of the data set?"
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
    evaluation
        .unmeasured
        .iter()
        .for_each(|name| text += &format!("{:>33}  {}\n", "all pixels masked", printable(name)));
    let mean = format!("mean of {}", counted(evaluation.views.len(), "view"));
    text += &row(&mean, evaluation.psnr, evaluation.ssim, evaluation.l1);
    if let Some(ColorMatched { psnr, ssim, .. }) = evaluation.color_matched {
        text += &format!(
            "{psnr:>9.3} dB {ssim:>9.5} {:>10}  mean of the right halves, colours matched on the left halves\n",
            ""
        );
    }
    if let Some(PoseMatched { psnr, ssim, .. }) = evaluation.pose_matched {
        text += &format!(
            "{psnr:>9.3} dB {ssim:>9.5} {:>10}  mean of the right halves, poses aligned to the left halves\n",
            ""
        );
    }
    output::result(text.trim_end())
}
