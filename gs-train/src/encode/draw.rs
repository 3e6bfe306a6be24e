//! Pictures of `.gsi` files with their alpha.

use gs_core::{Canvas, Error, Rasterizer, Scene2d};
use gs_io::{GsiFile, StoredImage, straight};

/// Draws a picture in 8 bits, as a file stores it: with alpha, and with its profile.
///
/// # Errors
/// Those of the backend.
pub async fn draw_picture<R: Rasterizer<Scene2d>>(
    on: &R,
    picture: &GsiFile,
    canvas: &Canvas,
) -> Result<StoredImage, Error> {
    let GsiFile { colors, alpha, .. } = picture;
    let mut image = on.render(&colors.scene, canvas, &colors.settings).await?;
    let mut values = None;
    if let Some(alpha) = alpha {
        let alpha = on.render(&alpha.scene, canvas, &alpha.settings).await?;
        let (colors, alpha) = straight(image, &alpha)?;
        (image, values) = (colors, Some(alpha));
    }
    let (image, profile) = (image.rounded_to_8_bits(), colors.profile.clone());
    Ok(StoredImage { image, alpha: values, profile, remarks: Vec::new() })
}
