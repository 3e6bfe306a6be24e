//! Measurements that take turns, and the table of them; what benchmarks of effects share.

use std::time::Instant;

use gs_core::{Error, Parameterization, Rasterizer, RenderSettings, Scene, profile::Quantiles};

/// Measurements of a row.
pub(crate) const ROUNDS: usize = 15;

/// A row: its name, and what is measured.
pub(crate) type Row<'a> = (String, Box<dyn Fn() -> Result<(), Error> + 'a>);

/// The time of a row, ms, after one that is not measured.
pub(crate) fn milliseconds((_, run): &Row<'_>) -> Result<f64, Error> {
    run()?;
    let started = Instant::now();
    run().map(|()| started.elapsed().as_secs_f64() * 1e3)
}

/// Measures rows in turns and prints them. Each runs once before it is measured, so that none finds its data in the cache, or not there, for
/// the sake of the row before it; the first is measured again after the last.
pub(crate) fn table(title: &str, rows: &[Row<'_>]) -> Result<(), Error> {
    let mut times = vec![Vec::new(); rows.len()];
    let mut again = Vec::new();
    for _ in 0..ROUNDS {
        for (row, times) in rows.iter().zip(&mut times) {
            times.push(milliseconds(row)?);
        }
        again.push(milliseconds(&rows[0])?);
    }
    let apart =
        |other: &[f64]| -> Vec<f64> { other.iter().zip(&times[0]).map(|(other, first)| other - first).collect() };
    let noise: Vec<f64> = apart(&again).into_iter().map(f64::abs).collect();
    println!(
        "\n## {title}\n\nnoise {:.2} ms\n\n| | ms | more than the first, ms | times the first |\n|---|---|---|---|",
        Quantiles::of(&noise).median
    );
    for ((name, _), of_row) in rows.iter().zip(&times) {
        let (time, more) = (Quantiles::of(of_row).median, Quantiles::of(&apart(of_row)).median);
        let ratios: Vec<f64> = of_row.iter().zip(&times[0]).map(|(time, first)| time / first).collect();
        println!("| {name} | {time:.2} | {more:+.2} | {:.2} |", Quantiles::of(&ratios).median);
    }
    Ok(())
}

/// A picture of a scene, again and again, until the device is done with it.
pub(crate) fn picture<'a, S: Scene, R: Rasterizer<S>>(
    name: &str,
    on: &'a R,
    scene: &S,
    view: &'a S::View,
    settings: RenderSettings,
) -> Result<Row<'a>, Error>
where
    R::Splats: 'a,
{
    let splats = on.upload(scene, Parameterization::ScaleRotation)?;
    Ok((name.to_owned(), Box::new(move || on.culled(&on.forward(&splats, view, &settings)?).map(drop))))
}
