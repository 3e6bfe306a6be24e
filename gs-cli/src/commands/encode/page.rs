//! The page that `gs encode --page` writes beside a file.

use std::{
    fs,
    path::{Path, PathBuf},
};

use gs_backend::{Chosen, FutureExt as _};
use gs_core::Canvas;
use gs_io::{read_gsi, write_atomically};
use gs_lab::compression::{EncodePage, page};
use gs_train::draw_picture;

use super::{Summary, Work};
use crate::{
    failure::Failure,
    image_fit::target,
    output_folder::{self, OverwriteArgs},
};

/// The page's path: that of the file, with another ending.
pub(super) fn path(file: &Path) -> PathBuf {
    file.with_extension("html")
}

/// Checks that the page may be written. Only a page of an encoded image is replaced.
pub(super) fn check(file: &Path, image: &Path, overwrite: OverwriteArgs) -> Result<(), Failure> {
    let page = path(file);
    output_folder::check_file(&page, [image])?;
    let is_ours = |page: &Path| fs::read_to_string(page).is_ok_and(|text| text.contains(", encoded</title>"));
    if overwrite.overwrite || !page.exists() || is_ours(&page) {
        return Ok(());
    }
    let failure = Failure::failed("exists and was not written by gs encode --page").at(page.display());
    Err(failure.hint("choose another name with --output, or replace it with --overwrite"))
}

/// Decodes the file and writes its page, in sRGB and on white.
pub(super) fn write(on: &Chosen, work: &Work<'_>, summary: &Summary, file: &Path, to: &Path) -> Result<(), Failure> {
    let decoded = read_gsi(file)?;
    let canvas = Canvas::new(decoded.colors.width, decoded.colors.height);
    let picture = draw_picture(&on.rasterizer, &decoded, &canvas).block_on()?;
    let text = page(&EncodePage {
        name: &target::title(work.file),
        original: &work.image.shown()?,
        decoded: &picture.shown()?,
        bytes: summary.bytes as u64,
        gaussians: summary.gaussians,
        seconds: summary.seconds,
    })?;
    Ok(write_atomically(to, |file| file.write_all(text.as_bytes()))?)
}
