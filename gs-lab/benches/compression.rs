//! Sizes of compressed images against JPEG, WebP and AVIF at equal PSNR.
//!
//! `cargo bench -p gs-lab --bench compression -- [--threads N] [--quick] [--csv FILE]`
//!
//! The other formats are made with `cjpeg` and `djpeg`, `cwebp` and `dwebp`, `avifenc` and `avifdec`;
//! a format whose programs are not there is left out. Sizes are those of files on disk.

#![allow(clippy::print_stdout)]

mod measure;

use std::{
    error::Error,
    fmt::Write as _,
    fs,
    path::{Path, PathBuf},
    process::Command,
    time::Instant,
};

use clap::Parser;
use gs_codec::{Extent, decode};
use gs_core::Image;
use gs_cpu::CpuRasterizer;
use gs_train::{EncodeSettings, EncodeTarget, encode, l1_and_psnr};
use measure::{
    Options, Outcome,
    images::{BenchImage, BenchImages},
    mean, print_columns, print_head, print_row, print_section,
};
use pollster::FutureExt as _;

#[derive(Debug, Parser)]
struct CompressionOptions {
    #[command(flatten)]
    common: Options,
    /// Also writes a line per file to FILE
    #[arg(long)]
    csv: Option<PathBuf>,
}

/// A file of an image.
struct Point {
    image: String,
    format: &'static str,
    /// Size, bits per pixel.
    bpp: f64,
    /// PSNR of the decoded 8-bit image, dB.
    psnr: f64,
    /// Times of encoding and of decoding without rendering, s; 0 for other formats.
    seconds: [f64; 2],
}

/// Sizes of `.gsi` files, bits per pixel.
const SIZES: [f64; 6] = [0.1, 0.2, 0.4, 0.8, 1.4, 2.0];

/// Another format: its name, its qualities from the worst, and the commands that encode `in.png` or
/// `in.ppm` as `file` in the quality `Q`, and decode it into `out`.
struct Other {
    name: &'static str,
    qualities: &'static [u32],
    encode: &'static [&'static str],
    decode: &'static [&'static str],
    out: &'static str,
}

const OTHERS: [Other; 3] = [
    Other {
        name: "JPEG",
        qualities: &[4, 8, 15, 25, 40, 60, 80, 90, 95],
        encode: &["cjpeg", "-quality", "Q", "-optimize", "-outfile", "file", "in.ppm"],
        decode: &["djpeg", "-outfile", "out.ppm", "file"],
        out: "out.ppm",
    },
    Other {
        name: "WebP",
        qualities: &[0, 2, 6, 12, 25, 45, 65, 80, 90, 96],
        encode: &["cwebp", "-quiet", "-m", "6", "-q", "Q", "in.png", "-o", "file"],
        decode: &["dwebp", "-quiet", "file", "-ppm", "-o", "out.ppm"],
        out: "out.ppm",
    },
    Other {
        name: "AVIF",
        qualities: &[60, 56, 50, 44, 38, 32, 26, 20, 14, 9],
        encode: &["avifenc", "-s", "6", "-j", "1", "--min", "Q", "--max", "Q", "in.png", "file"],
        decode: &["avifdec", "file", "out.png"],
        out: "out.png",
    },
];

fn main() -> Outcome {
    let options = CompressionOptions::parse();
    let common = &options.common;
    let mut images = BenchImages::load()?;
    images.all.truncate(common.pick(usize::MAX, 1));
    print_head("Compressed images", common, &[common.threads()], &images.origin);
    let rasterizer = common.rasterizer(common.threads())?;
    let mut points = Vec::new();
    for image in &images.all {
        for &bpp in common.pick(&SIZES[..], &SIZES[..2]) {
            points.push(gsi(&rasterizer, image, bpp)?);
        }
        for other in &OTHERS {
            points.extend(files(other, image)?);
        }
    }
    print_section("Files of these sizes");
    print_columns(&["bits per pixel", "PSNR, dB", "encoding, s", "decoding, ms"]);
    for bpp in SIZES {
        let of: Vec<&Point> = points.iter().filter(|p| p.format == "gsi" && (p.bpp / bpp - 1.0).abs() < 0.1).collect();
        if !of.is_empty() {
            let [size, psnr] = [mean(of.iter().map(|p| p.bpp)), mean(of.iter().map(|p| p.psnr))];
            let [encoding, decoding] = [0, 1].map(|k| mean(of.iter().map(|p| p.seconds[k])));
            let cells = [format!("{size:.3}"), format!("{psnr:.2}"), format!("{encoding:.1}")];
            print_row(&[&cells[..], &[format!("{:.1}", decoding * 1e3)]].concat());
        }
    }
    print_section("Size at equal PSNR");
    println!("Mean over the common range of PSNR of the logarithm of the ratio (BD-rate), in per cent.\n");
    print_columns(&["image", "against JPEG", "WebP", "AVIF"]);
    let mut all: [Vec<f64>; 3] = Default::default();
    for image in &images.all {
        let ours = curve(&points, &image.name, "gsi");
        let mut row = vec![image.name.clone()];
        for (other, all) in OTHERS.iter().zip(&mut all) {
            let ratio = log_ratio(&ours, &curve(&points, &image.name, other.name));
            all.extend(ratio);
            row.push(per_cent(ratio));
        }
        print_row(&row);
    }
    let means = all.map(|ratios| per_cent((!ratios.is_empty()).then(|| mean(ratios))));
    print_row(&[&["mean".to_owned()][..], &means].concat());
    if let Some(path) = &options.csv {
        fs::write(path, as_csv(&points)).map_err(|e| format!("{} cannot be written: {e}", path.display()))?;
    }
    Ok(())
}

fn gsi(rasterizer: &CpuRasterizer, of: &BenchImage, bpp: f64) -> Result<Point, Box<dyn Error>> {
    let pixels = of.image.pixels().len() as f64;
    let settings = EncodeSettings::default().with(|s| s.target = EncodeTarget::Bytes((bpp * pixels / 8.0) as u64));
    let encoded = encode(rasterizer, &of.image, &settings).block_on()?;
    let started = Instant::now();
    decode(&encoded.bytes, Extent::Whole)?;
    let seconds = [encoded.seconds, started.elapsed().as_secs_f64()];
    let bpp = encoded.bytes.len() as f64 * 8.0 / pixels;
    Ok(Point { image: of.name.clone(), format: "gsi", bpp, psnr: encoded.psnr, seconds })
}

/// The files of another format; none where its programs are not there.
fn files(other: &Other, of: &BenchImage) -> Result<Vec<Point>, Box<dyn Error>> {
    let folder = tempfile::tempdir()?;
    let source = folder.path().join("in.png");
    gs_io::write_png(&source, &of.image)?;
    write_ppm(&folder.path().join("in.ppm"), &of.image)?;
    let mut points = Vec::new();
    for &quality in other.qualities {
        for command in [other.encode, other.decode] {
            let quality = quality.to_string();
            let arguments = command[1..].iter().map(|&word| if word == "Q" { quality.as_str() } else { word });
            let Ok(run) = Command::new(command[0]).args(arguments).current_dir(folder.path()).output() else {
                return Ok(Vec::new());
            };
            if !run.status.success() {
                return Err(format!("{}: {}", command[0], String::from_utf8_lossy(&run.stderr)).into());
            }
        }
        let decoded = gs_io::read_image(folder.path().join(other.out))?.image;
        let bytes = fs::metadata(folder.path().join("file"))?.len() as f64;
        let bpp = bytes * 8.0 / of.image.pixels().len() as f64;
        let psnr = l1_and_psnr(&decoded, &of.image).1;
        points.push(Point { image: of.name.clone(), format: other.name, bpp, psnr, seconds: [0.0; 2] });
    }
    Ok(points)
}

fn write_ppm(path: &Path, image: &Image) -> std::io::Result<()> {
    let mut bytes = format!("P6 {} {} 255\n", image.width(), image.height()).into_bytes();
    bytes.extend(image.pixels().as_flattened().iter().map(|&value| gs_core::to_8_bits(value)));
    fs::write(path, bytes)
}

/// (PSNR, ln of the size) of the files of an image in a format, by PSNR.
fn curve(points: &[Point], image: &str, format: &str) -> Vec<(f64, f64)> {
    let of = points.iter().filter(|p| p.image == image && p.format == format);
    let mut curve: Vec<(f64, f64)> = of.map(|p| (p.psnr, p.bpp.ln())).collect();
    curve.sort_by(|a, b| a.0.total_cmp(&b.0));
    curve
}

/// Mean of ln(size of `a` / size of `b`) over their common range of PSNR, with sizes interpolated
/// between files.
fn log_ratio(a: &[(f64, f64)], b: &[(f64, f64)]) -> Option<f64> {
    let low = a.first()?.0.max(b.first()?.0);
    let high = a.last()?.0.min(b.last()?.0);
    let at = |curve: &[(f64, f64)], psnr: f64| {
        let after = curve.partition_point(|&(known, _)| known < psnr).clamp(1, curve.len() - 1);
        let [(from, start), (to, end)] = [curve[after - 1], curve[after]];
        start + (end - start) * (psnr - from) / (to - from)
    };
    let steps = 200;
    let psnr = |k: u32| low + (high - low) * (f64::from(k) + 0.5) / f64::from(steps);
    (high > low).then(|| mean((0..steps).map(|k| at(a, psnr(k)) - at(b, psnr(k)))))
}

fn per_cent(log_ratio: Option<f64>) -> String {
    log_ratio.map_or("–".to_owned(), |ratio| format!("{:+.1} %", 100.0 * (ratio.exp() - 1.0)))
}

fn as_csv(points: &[Point]) -> String {
    let mut csv = "image,format,bpp,psnr,encoding_s,decoding_s\n".to_owned();
    for Point { image, format, bpp, psnr, seconds: [encoding, decoding] } in points {
        writeln!(csv, "{image},{format},{bpp:.5},{psnr:.4},{encoding:.3},{decoding:.5}")
            .expect("a string takes all that is written to it");
    }
    csv
}
