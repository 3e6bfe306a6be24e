//! SPZ, Niantic's compressed format: [`read`]s versions 2 to 4, [`encode`]s 3 and 4.
//!
//! A Gaussian takes 20 bytes (19 in version 2) and one for each coefficient of the spherical sh
//! above degree 0; see [`quantum`]. They are stored by parameter: all positions, opacities,
//! colours, scales, rotations, sh. Versions 2 and 3 are one gzip stream; version 4 has a header in
//! the clear, and a zstd stream for each parameter; see [`container`].
//!
//! *Source:* nianticlabs/spz, README and pull requests 73 (version 4) and 77 (extensions); its axes
//! are right, up, back.

mod container;
mod quantum;

use glam::DAffine3;
use gs_core::{Scene, Scene3d};

use self::{
    container::{Extension, Head, Streams},
    quantum::FractionalBits,
};
use super::{
    Encoded3d, File3d, Format3d, TrainedWith,
    conversion_loss::ConversionLoss,
    options::{SpzVersion, ToWrite, WriteOptions3d},
    source::Source,
    values::{Flips, MAX_DEGREE, UnitRotations, byte_of_logit, logit_of_step, rest_of_degree, transform},
};
use crate::error::Error;

/// The default axes of files: right, up, back.
const AXES: Flips = Flips::new([1.0, -1.0, -1.0]);

/// Reads a scene.
pub(crate) fn read(source: &Source<'_>, format: Format3d) -> Result<File3d, Error> {
    read_with_axes(source, format, AXES)
}

/// Reads a scene from a file whose axes are ours but for these flips, if it does not say otherwise.
pub(crate) fn read_with_axes(source: &Source<'_>, format: Format3d, axes: Flips) -> Result<File3d, Error> {
    let packed = container::read(source)?;
    let head = packed.head;
    let streams = packed.streams();
    let degree = head.degree.min(MAX_DEGREE);
    let mut scene = Scene3d { sh_degree: degree, ..Scene3d::default() };
    scene.means = streams.positions.as_chunks::<9>().0.iter().map(|p| quantum::position(p, head.fraction)).collect();
    scene.opacity_logits = streams.opacities.iter().map(|&byte| logit_of_step(byte.into(), 255)).collect();
    scene.log_scales = streams.scales.as_chunks::<3>().0.iter().map(|s| s.map(quantum::log_scale).into()).collect();
    scene.rotations = match head.version {
        2 => streams.rotations.as_chunks::<3>().0.iter().map(|&q| quantum::rotation_of_three(q)).collect(),
        _ => streams.rotations.as_chunks::<4>().0.iter().map(|&q| quantum::rotation_of_smallest(q)).collect(),
    };
    let per_gaussian = rest_of_degree(head.degree);
    let kept = rest_of_degree(degree);
    scene.sh.reserve_exact(streams.colors.len() / 3 * scene.sh_len());
    for (i, color) in streams.colors.as_chunks::<3>().0.iter().enumerate() {
        scene.sh.push(color.map(quantum::color).into());
        let rest = &streams.sh[i * per_gaussian..][..kept];
        scene.sh.extend(rest.as_chunks::<3>().0.iter().map(|c| glam::Vec3::from(c.map(quantum::sh_of_byte))));
    }
    match packed.extensions.iter().find_map(Extension::axes) {
        None => axes.apply(&mut scene),
        Some(axes) => _ = transform(&mut scene, &DAffine3::from_mat3(axes)),
    }
    let losses = Vec::from_iter(ConversionLoss::of_degree(head.degree, degree));
    let trained_with = TrainedWith::of_spz_flag(head.antialiased);
    Ok(File3d { losses, trained_with, ..File3d::of(format, scene) })
}

/// Encodes a scene.
pub(crate) fn encode(to: &ToWrite<'_>) -> Result<Encoded3d, Error> {
    let (bytes, mut losses) = encode_with(to, AXES, FractionalBits::USUAL)?;
    let trained_with = to.options.trained_with;
    losses.extend(trained_with.lost(&TrainedWith::of_spz_flag(trained_with.spz_flag())));
    Ok(Encoded3d::of(to.format, bytes, losses))
}

/// Encodes a scene as an SPZ that is a part of another file: with axes that are ours but for these flips, and with means
/// as exact as there is room for. Returns it, and what is lost of the Gaussians.
#[cfg(feature = "write")]
pub(crate) fn encode_part(to: &ToWrite<'_>, axes: Flips) -> Result<(Vec<u8>, Vec<ConversionLoss>), Error> {
    encode_with(to, axes, FractionalBits::MOST)
}

fn encode_with(to: &ToWrite<'_>, axes: Flips, most: u8) -> Result<(Vec<u8>, Vec<ConversionLoss>), Error> {
    let &ToWrite { path, scene, options, .. } = to;
    let rotations = UnitRotations::new(scene, path)?;
    let WriteOptions3d { spz_version, trained_with, .. } = *options;
    let too_many = |_| Error::unsupported(path, format!("an SPZ of {} Gaussians", scene.len()), "write a PLY");
    let count = u32::try_from(scene.len()).map_err(too_many)?;
    let fraction = FractionalBits::for_means(&scene.means, most);
    let mut packing = quantum::Packing::new(fraction);
    let rest = scene.sh_len() - 1;
    let room = |each: usize| Vec::with_capacity(each * scene.len());
    let mut streams = Streams {
        positions: room(9),
        opacities: room(1),
        colors: room(3),
        scales: room(3),
        rotations: room(4),
        sh: room(3 * rest),
    };
    for i in 0..scene.len() {
        streams.positions.extend(packing.position(axes.mean(scene.means[i])));
        streams.opacities.push(byte_of_logit(scene.opacity_logits[i]));
        streams.scales.extend(packing.log_scale(scene.log_scales[i]));
        streams.rotations.extend(packing.rotation(axes.rotation(rotations.get(i))));
        let coefficients = &scene.sh[i * scene.sh_len()..][..rest + 1];
        streams.colors.extend(packing.color(coefficients[0]));
        for (k, &c) in coefficients.iter().enumerate().skip(1) {
            streams.sh.extend(packing.sh(k, c * axes.sign_of_coefficient(k)));
        }
    }
    let version = match spz_version {
        SpzVersion::V3 => 3,
        SpzVersion::V4 => 4,
    };
    let antialiased = trained_with.spz_flag();
    let head = Head { version, count, degree: scene.sh_degree, fraction, antialiased };
    let bytes = container::write(&head, &streams).map_err(|source| Error::write(path, source))?;
    Ok((bytes, packing.losses(scene, &rotations)))
}
