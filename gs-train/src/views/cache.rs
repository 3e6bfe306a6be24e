//! The images of a run's views: each is read once, ahead of the step that needs it, and kept in few
//! bytes, in memory or in a file.
//!
//! Threads that read ahead end when there is nothing left to read. What a view's image is does not
//! depend on them, nor on where it is kept.

use std::{
    collections::VecDeque,
    fs::File,
    io::{self, Read as _, Seek as _, SeekFrom, Write as _},
    path::{Path, PathBuf},
    sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError},
    thread,
};

use gs_io::dataset::{CompactImage, DepthMap, PosedImage};
use serde::Serialize;
use web_time::Instant;

use super::view::{Counting, ImageSource};

/// What a run's images cost so far.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub struct ImageReading {
    /// Number of images that were read from their files.
    pub read: usize,
    /// Seconds of the threads that read them, added up.
    pub seconds: f64,
    /// Seconds for which the run waited for an image, or read one itself.
    pub waited: f64,
    /// Bytes of images in memory.
    pub in_memory: u64,
    /// Bytes of images in the cache's file.
    pub in_file: u64,
    /// Why images are not kept in a file although they exceed the memory, where this is so.
    pub failure: Option<String>,
}

/// Images that share memory and a file.
pub(crate) struct ImageCache {
    sources: Vec<Arc<dyn ImageSource>>,
    /// Most bytes of images in memory, besides those that were read ahead.
    limit: u64,
    /// Where the file is, if there may be one.
    folder: Option<PathBuf>,
    state: Mutex<State>,
    /// An image has been read.
    changed: Condvar,
    file: Mutex<Option<File>>,
}

#[derive(Default)]
struct State {
    slots: Vec<Slot>,
    /// Views whose images are to be read, in this order.
    ahead: VecDeque<usize>,
    /// Threads that read.
    readers: usize,
    reading: ImageReading,
}

/// The image of one view.
#[derive(Default)]
struct Slot {
    image: Option<Arc<CompactImage>>,
    /// Whether the image stays in memory after it was used.
    stays: bool,
    /// Whether a thread reads it.
    is_read: bool,
    /// Whether the last attempt to read it failed.
    has_failed: bool,
    /// Place and length in the file.
    stored: Option<(u64, usize)>,
}

impl ImageCache {
    /// Sources that share a cache of at most `limit` bytes in memory and a file in `folder`, in the
    /// order of `sources`.
    pub(crate) fn sources(
        sources: Vec<Arc<dyn ImageSource>>,
        limit: u64,
        folder: Option<PathBuf>,
    ) -> Vec<Arc<dyn ImageSource>> {
        let count = sources.len();
        let slots = (0..count).map(|_| Slot::default()).collect();
        let cache = Arc::new(Self {
            sources,
            limit,
            folder,
            state: Mutex::new(State { slots, ..State::default() }),
            changed: Condvar::new(),
            file: Mutex::new(None),
        });
        (0..count)
            .map(|index| -> Arc<dyn ImageSource> { Arc::new(Cached { index, cache: Arc::clone(&cache) }) })
            .collect()
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The image of a view.
    fn get(&self, index: usize) -> Result<Arc<CompactImage>, gs_io::Error> {
        let mut state = self.state();
        if let Some(image) = state.slots[index].taken() {
            return Ok(image);
        }
        let started = Instant::now();
        while state.slots[index].is_read {
            state = self.changed.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
        let ready = state.slots[index].taken();
        state.slots[index].is_read = ready.is_none();
        drop(state);
        let image = ready.map_or_else(|| self.read(index, false), Ok);
        self.state().reading.waited += started.elapsed().as_secs_f64();
        image
    }

    /// Reads an image whose slot says so, and keeps it: until it is used, if it is read `ahead`.
    fn read(&self, index: usize, ahead: bool) -> Result<Arc<CompactImage>, gs_io::Error> {
        let _done = Done { cache: self, index };
        let stored = self.state().slots[index].stored;
        if let Some(image) = stored.and_then(|place| self.load(place)) {
            let image = Arc::new(image);
            self.state().slots[index].image = ahead.then(|| Arc::clone(&image));
            return Ok(image);
        }
        let started = Instant::now();
        let read = self.sources[index].read_compact();
        self.state().slots[index].has_failed = read.is_err();
        let image = Arc::new(read?);
        let bytes = image.bytes();
        let mut state = self.state();
        state.reading.read += 1;
        state.reading.seconds += started.elapsed().as_secs_f64();
        let stays = state.reading.in_memory + bytes <= self.limit;
        if stays {
            state.reading.in_memory += bytes;
        }
        drop(state);
        let stored = if stays { None } else { self.store(&image) };
        let slot = &mut self.state().slots[index];
        (slot.stays, slot.stored) = (stays, stored);
        slot.image = (stays || ahead).then(|| Arc::clone(&image));
        Ok(image)
    }

    /// Appends an image to the file; `None` where there is none.
    fn store(&self, image: &CompactImage) -> Option<(u64, usize)> {
        let folder = self.folder.as_ref().filter(|_| self.state().reading.failure.is_none())?;
        let bytes = image.to_bytes();
        let written = append(&mut self.file.lock().unwrap_or_else(PoisonError::into_inner), folder, &bytes);
        let mut state = self.state();
        match written {
            Ok(place) => {
                state.reading.in_file += bytes.len() as u64;
                Some((place, bytes.len()))
            }
            Err(error) => {
                let folder = folder.display();
                state.reading.failure = Some(format!("{folder}: cannot keep images there: {error}"));
                None
            }
        }
    }

    /// Reads an image from the file; `None` where that fails.
    fn load(&self, (place, length): (u64, usize)) -> Option<CompactImage> {
        let mut bytes = vec![0; length];
        let mut file = self.file.lock().unwrap_or_else(PoisonError::into_inner);
        let file = file.as_mut()?;
        file.seek(SeekFrom::Start(place)).ok()?;
        file.read_exact(&mut bytes).ok()?;
        CompactImage::from_bytes(&bytes)
    }

    /// Lets threads read the image of a view that will soon be needed.
    fn read_ahead(self: &Arc<Self>, index: usize) {
        let mut state = self.state();
        let slot = &state.slots[index];
        if slot.image.is_some() || slot.is_read || state.ahead.contains(&index) {
            return;
        }
        state.ahead.push_back(index);
        if state.readers < rayon::current_num_threads() {
            let cache = Arc::clone(self);
            let reader = thread::Builder::new().name("images".to_owned()).spawn(move || cache.read_all());
            // Without threads, images are read when they are needed.
            state.readers += usize::from(reader.is_ok());
        }
    }

    /// Reads until nothing is left.
    fn read_all(&self) {
        loop {
            let mut state = self.state();
            let Some(index) = state.ahead.pop_front() else {
                state.readers -= 1;
                return;
            };
            let slot = &mut state.slots[index];
            if slot.image.is_none() && !slot.is_read {
                slot.is_read = true;
                drop(state);
                // Whoever needs the image reads it again, and receives the error.
                let _ = self.read(index, true);
            }
        }
    }
}

/// Appends to a file, which is created without a name if it is not there; returns the place.
fn append(file: &mut Option<File>, folder: &Path, bytes: &[u8]) -> io::Result<u64> {
    let file = match file {
        Some(file) => file,
        none => none.insert(tempfile::tempfile_in(existing(folder))?),
    };
    let place = file.seek(SeekFrom::End(0))?;
    file.write_all(bytes)?;
    Ok(place)
}

/// The folder, or the nearest above it that is there: a run makes its output folder when it begins,
/// which may be later or never.
fn existing(folder: &Path) -> &Path {
    let mut above = folder.ancestors().map(|above| if above.as_os_str().is_empty() { Path::new(".") } else { above });
    above.find(|above| above.is_dir()).unwrap_or(folder)
}

impl Slot {
    /// The image, which is then forgotten unless it stays.
    fn taken(&mut self) -> Option<Arc<CompactImage>> {
        if self.stays { self.image.clone() } else { self.image.take() }
    }
}

/// Ends the reading of an image, even if it failed.
struct Done<'a> {
    cache: &'a ImageCache,
    index: usize,
}

impl Drop for Done<'_> {
    fn drop(&mut self) {
        self.cache.state().slots[self.index].is_read = false;
        self.cache.changed.notify_all();
    }
}

/// A source whose image is in a cache.
struct Cached {
    index: usize,
    cache: Arc<ImageCache>,
}

impl Cached {
    fn source(&self) -> &dyn ImageSource {
        &*self.cache.sources[self.index]
    }
}

impl ImageSource for Cached {
    fn read(&self) -> Result<PosedImage, gs_io::Error> {
        let failed = |source| gs_io::Error::Content { path: "the image of a view".into(), source };
        self.cache.get(self.index)?.to_posed().map_err(failed)
    }

    fn read_compact(&self) -> Result<CompactImage, gs_io::Error> {
        Ok(CompactImage::clone(&*self.cache.get(self.index)?))
    }

    fn read_ahead(&self) {
        self.cache.read_ahead(self.index);
    }

    fn reading(&self) -> Option<ImageReading> {
        Some(self.cache.state().reading.clone())
    }

    fn depth(&self) -> Result<Option<DepthMap>, gs_io::Error> {
        self.source().depth()
    }

    fn digest(&self) -> Result<u32, gs_io::Error> {
        if self.cache.state().slots[self.index].has_failed {
            // What cannot be read has no part in the run, whatever its bytes.
            self.source().read_compact()?;
        }
        self.source().digest()
    }

    fn counting(&self) -> Counting {
        self.source().counting()
    }

    fn is_face(&self) -> bool {
        self.source().is_face()
    }

    fn keeps_image(&self) -> bool {
        true
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicBool, AtomicU32, Ordering::Relaxed};

    use gs_core::Image;

    use super::*;

    /// An image of one colour that counts how often it is read, and may be gone.
    struct Counted {
        level: f32,
        reads: AtomicU32,
        gone: AtomicBool,
    }

    impl ImageSource for Counted {
        fn read(&self) -> Result<PosedImage, gs_io::Error> {
            if self.gone.load(Relaxed) {
                return Err(gs_io::Error::Missing { path: "gone.png".into() });
            }
            self.reads.fetch_add(1, Relaxed);
            Ok(PosedImage { image: Image::filled(8, 4, [self.level; 3]).unwrap(), alpha: None, mask: None })
        }
    }

    /// Twenty sources, and the same with a cache.
    fn cached(limit: u64, folder: Option<&Path>) -> (Vec<Arc<Counted>>, Vec<Arc<dyn ImageSource>>) {
        let source = |number| {
            let (reads, gone) = (AtomicU32::new(0), AtomicBool::new(false));
            Arc::new(Counted { level: number as f32 / 20.0, reads, gone })
        };
        let sources: Vec<_> = (0..20).map(source).collect();
        let all = sources.iter().map(|source| Arc::clone(source) as Arc<dyn ImageSource>).collect();
        (sources, ImageCache::sources(all, limit, folder.map(Path::to_owned)))
    }

    fn reads(sources: &[Arc<Counted>]) -> u32 {
        sources.iter().map(|source| source.reads.load(Relaxed)).sum()
    }

    /// Whether three rounds over the images, with two that are read ahead, give the right ones.
    fn is_right(cached: &[Arc<dyn ImageSource>]) -> bool {
        (0..60).all(|step| {
            (0..3).for_each(|next| cached[(step + next) % 20].read_ahead());
            cached[step % 20].read().unwrap().image.pixels() == [[(step % 20) as f32 / 20.0; 3]; 32]
        })
    }

    #[test]
    fn each_image_is_read_once_wherever_it_is_kept() {
        let place = tempfile::tempdir().unwrap();
        for limit in [u64::MAX, 1_000, 0] {
            let (sources, cached) = cached(limit, Some(place.path()));
            assert!(is_right(&cached));
            assert_eq!(reads(&sources), 20, "limit {limit}");
            let reading = cached[0].reading().unwrap();
            assert_eq!(reading.read, 20);
            assert!(reading.in_memory <= limit && (reading.in_file > 0) == (limit < u64::MAX), "{reading:?}");
            assert_eq!(std::fs::read_dir(place.path()).unwrap().count(), 0, "the file has no name");
        }
    }

    #[test]
    fn images_without_a_place_are_read_again() {
        let (sources, without_file) = cached(0, None);
        assert!(is_right(&without_file) && reads(&sources) >= 60);
        assert_eq!(without_file[0].reading().unwrap().failure, None);
    }

    /// No file can be made below `/proc`.
    #[cfg(target_os = "linux")]
    #[test]
    fn images_that_no_file_can_keep_are_read_again_and_the_reason_is_known() {
        let (sources, failed) = cached(0, Some(Path::new("/proc/self/fd/out")));
        assert!(is_right(&failed) && reads(&sources) >= 60);
        let failure = failed[0].reading().unwrap().failure.unwrap();
        assert!(failure.contains("cannot keep images there"), "{failure}");
    }

    #[test]
    fn a_folder_that_is_not_there_yet_is_not_made() {
        let place = tempfile::tempdir().unwrap();
        let (sources, cached) = cached(0, Some(&place.path().join("out/images")));
        assert!(is_right(&cached) && reads(&sources) == 20);
        assert_eq!(std::fs::read_dir(place.path()).unwrap().count(), 0);
    }

    #[test]
    fn an_image_that_is_gone_is_an_error_until_it_is_back() {
        let (sources, cached) = cached(u64::MAX, None);
        sources[3].gone.store(true, Relaxed);
        cached[3].read_ahead();
        assert!(matches!(cached[3].read(), Err(gs_io::Error::Missing { .. })));
        sources[3].gone.store(false, Relaxed);
        assert!(is_right(&cached));
        // Images that were read do not need their files.
        sources.iter().for_each(|source| source.gone.store(true, Relaxed));
        assert!(is_right(&cached));
    }
}
