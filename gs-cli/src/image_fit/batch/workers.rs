//! The work on several images: small ones side by side, each on a part of the threads, large ones
//! one after the other on all.

use std::{
    path::Path,
    sync::{
        Mutex, PoisonError,
        atomic::{AtomicUsize, Ordering},
    },
    thread,
    time::Instant,
};

use gs_backend::{AnyRasterizer, Chosen, Wanted};
use gs_core::{RenderSettings, counted};
use serde::Serialize;

use super::{BatchImage, Done, Row, shown, table};
use crate::{
    failure::Failure,
    flags::backend::BackendArgs,
    memory,
    terminal::{interrupt::Interrupt, output, progress_bar::Printer},
};

/// Images of at most this many pixels are worked on side by side: two cores encode three of 768x512
/// px in 21 s rather than 26, although one of them is alone at the end. The parts of a larger image
/// keep all threads busy, and several at once would take much memory.
const SMALL_PX: u64 = 4_000_000;

/// Result per image; `None` if not started.
type Outcome<T> = Option<Result<Done<T>, Failure>>;

/// An image in the array that `--json` prints.
#[derive(Debug, Serialize)]
#[serde(untagged)]
enum Entry<T> {
    Done(T),
    Failed { image: String, error: String },
}

/// Does `work` on every image: largest first, so that no large one is left to the end. Prints a line
/// for each as it is done, then a table, or JSON, and the failures. `peak` is the memory that an
/// image of a size takes, bytes.
///
/// After Ctrl-C no further image is begun, and `work` decides how those under way end, which `how`
/// says.
pub(crate) fn run<T: Serialize + Send>(
    images: &[BatchImage],
    (backend, render): (&BackendArgs, &RenderSettings),
    json: bool,
    how: &'static str,
    peak: impl Fn((u32, u32)) -> u64,
    work: impl Fn(&BatchImage, &Chosen, &Interrupt) -> Result<Done<T>, Failure> + Sync,
) -> Result<(), Failure> {
    let started = Instant::now();
    let whole = backend.open_to_render_2d(render)?;
    output::note(&whole.reason);
    let interrupt = Interrupt::listen(Printer::above(None), how);
    let outcomes = Mutex::new((0..images.len()).map(|_| None).collect::<Vec<Outcome<T>>>());
    let log = Log { images, outcomes: &outcomes, done: AtomicUsize::new(0) };
    // The work reads an image again, and says what is wrong with one that has no size.
    let size = |image: &BatchImage| gs_io::read_image_size(&image.file).unwrap_or((1, 1));
    let sizes: Vec<(u32, u32)> = images.iter().map(size).collect();
    let pixels = |&index: &usize| u64::from(sizes[index].0) * u64::from(sizes[index].1);
    let mut order: Vec<usize> = (0..images.len()).collect();
    order.sort_by_key(|index| std::cmp::Reverse(pixels(index)));
    let (large, small) = order.split_at(order.partition_point(|index| pixels(index) > SMALL_PX));

    let one = |index: usize, on: &Chosen| {
        if !interrupt.requested() {
            log.ended(index, work(&images[index], on, &interrupt));
        }
    };
    large.iter().for_each(|&index| one(index, &whole));
    let most = small.first().map_or(0, |&index| peak(sizes[index]));
    match side_by_side(&whole, small.len(), most) {
        0 | 1 => small.iter().for_each(|&index| one(index, &whole)),
        several => {
            let cpu = BackendArgs { backend: Wanted::Cpu, ..backend.clone() };
            on_each(&cpu.open_several(several)?, small, one);
        }
    }
    let outcomes = outcomes.into_inner().unwrap_or_else(PoisonError::into_inner);
    report(images, outcomes, interrupt.requested(), json, started.elapsed().as_secs_f64())
}

/// Does `one` of each index, on whichever backend is free.
fn on_each(backends: &[Chosen], indices: &[usize], one: impl Fn(usize, &Chosen) + Sync) {
    let next = AtomicUsize::new(0);
    thread::scope(|scope| {
        for on in backends {
            scope.spawn(|| {
                while let Some(&index) = indices.get(next.fetch_add(1, Ordering::Relaxed)) {
                    one(index, on);
                }
            });
        }
    });
}

/// How many of `images` images of at most `peak` bytes are worked on at once. A GPU does one after
/// the other.
fn side_by_side(on: &Chosen, images: usize, peak: u64) -> usize {
    let threads = if matches!(on.rasterizer, AnyRasterizer::Cpu(_)) { on.threads } else { 1 };
    let room = memory::room().map_or(usize::MAX, |bytes| (bytes / 2 / peak.max(1)) as usize);
    threads.min(images).min(room)
}

/// Keeps what became of the images, and prints a line for each.
struct Log<'a, T> {
    images: &'a [BatchImage],
    outcomes: &'a Mutex<Vec<Outcome<T>>>,
    done: AtomicUsize,
}

impl<T> Log<'_, T> {
    fn ended(&self, index: usize, outcome: Result<Done<T>, Failure>) {
        let done = self.done.fetch_add(1, Ordering::Relaxed) + 1;
        let (all, file) = (self.images.len(), shown(&self.images[index].file));
        match &outcome {
            Ok(Done { row, .. }) => output::note(format_args!(
                "{done}/{all}  {file}: {}, {} dB, {:.2} s",
                counted(row.bytes, "byte"),
                table::decibels(row.psnr),
                row.seconds
            )),
            Err(_) => output::note(format_args!("{done}/{all}  {file}: failed")),
        }
        self.outcomes.lock().unwrap_or_else(PoisonError::into_inner)[index] = Some(outcome);
    }
}

/// Prints the results in the order of the images, then the failures. Fails if there are any, or if
/// Ctrl-C left images undone.
fn report<T: Serialize>(
    images: &[BatchImage],
    outcomes: Vec<Outcome<T>>,
    interrupted: bool,
    json: bool,
    elapsed: f64,
) -> Result<(), Failure> {
    let (mut rows, mut entries, mut failures) = (Vec::<(&Path, Row)>::new(), Vec::new(), Vec::new());
    for (BatchImage { file, .. }, outcome) in images.iter().zip(outcomes) {
        match outcome {
            Some(Ok(Done { row, summary })) => {
                rows.push((file, row));
                entries.push(Entry::Done(summary));
            }
            Some(Err(failure)) => {
                entries.push(Entry::Failed { image: shown(file), error: failure.message().to_owned() });
                failures.push(with_name(file, &failure));
            }
            None => {}
        }
    }
    let ended = rows.len() + failures.len();
    match json {
        true => output::json(&entries)?,
        false if rows.is_empty() => {}
        false => output::result(table::table(&rows, elapsed))?,
    }
    failures.iter().for_each(|failure| output::note(format_args!("failed: {failure}")));
    if interrupted {
        return Err(Failure::interrupted(format_args!("stopped after {ended} of {} images", images.len())));
    }
    match failures.len() {
        0 => Ok(()),
        failed => Err(Failure::failed(format_args!("{failed} of {} images failed, as said above", images.len()))),
    }
}

/// The failure of an image, which says which.
fn with_name(file: &Path, failure: &Failure) -> String {
    let (name, message) = (file.display().to_string(), failure.message());
    if message.contains(&name) { message.to_owned() } else { format!("{name}: {message}") }
}
