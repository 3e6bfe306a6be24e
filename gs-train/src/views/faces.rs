//! The faces of 360° images and wide fish-eyes as sources: an image is decoded once for all its faces
//! if they are read one after the other, as in training.

use std::sync::{
    Arc, Mutex, TryLockError,
    atomic::{AtomicU64, Ordering::Relaxed},
};

use gs_io::dataset::{CompactImage, DepthMap, PosedImage, View, read_images};

use super::view::{Counting, ImageSource};

/// Most bytes of faces that have been made and not been read yet. Beyond that, an image is
/// decoded again for another face.
const MOST_BYTES: u64 = 1 << 30;

/// A face of an image.
struct Face {
    index: usize,
    of: Arc<Whole>,
}

/// An image that is split into faces.
struct Whole {
    faces: Vec<View>,
    /// Faces that were made when another was read, until they are read themselves.
    made: Mutex<Vec<Option<CompactImage>>>,
    /// Bytes of such faces, of all images together.
    held: Arc<AtomicU64>,
}

/// The sources of these views, in their order. Faces of one image are neighbours.
pub(crate) fn sources(views: Vec<View>) -> Vec<Arc<dyn ImageSource>> {
    let held = Arc::new(AtomicU64::new(0));
    let mut sources: Vec<Arc<dyn ImageSource>> = Vec::with_capacity(views.len());
    for faces in views.chunk_by(|a, b| a.source.is_face() && a.image == b.image) {
        if let [view] = faces {
            sources.push(Arc::new(view.clone()));
            continue;
        }
        let made = Mutex::new(faces.iter().map(|_| None).collect());
        let of = Arc::new(Whole { faces: faces.to_vec(), made, held: Arc::clone(&held) });
        sources
            .extend((0..faces.len()).map(|index| -> Arc<dyn ImageSource> { Arc::new(Face { index, of: of.clone() }) }));
    }
    sources
}

impl ImageSource for Face {
    fn read(&self) -> Result<PosedImage, gs_io::Error> {
        let failed = |source| gs_io::Error::Content { path: self.of.faces[self.index].image.clone(), source };
        self.read_compact()?.to_posed().map_err(failed)
    }

    fn read_compact(&self) -> Result<CompactImage, gs_io::Error> {
        let Whole { faces, made, held } = &*self.of;
        let mut made = match made.try_lock() {
            Ok(made) => made,
            Err(TryLockError::Poisoned(made)) => made.into_inner(),
            // Another job is making the faces. Waiting for it could take forever, because it may wait
            // for this thread.
            Err(TryLockError::WouldBlock) => return faces[self.index].read_compact(),
        };
        if let Some(face) = made[self.index].take() {
            held.fetch_sub(face.bytes(), Relaxed);
            return Ok(face);
        }
        if held.load(Relaxed) >= MOST_BYTES {
            return faces[self.index].read_compact();
        }
        let mut images: Vec<Option<CompactImage>> = read_images(faces)?.into_iter().map(Some).collect();
        let read = images[self.index].take();
        let bytes = |images: &[Option<CompactImage>]| images.iter().flatten().map(CompactImage::bytes).sum::<u64>();
        held.fetch_add(bytes(&images), Relaxed);
        held.fetch_sub(bytes(&made), Relaxed);
        *made = images;
        Ok(read.expect("an image for each view"))
    }

    fn depth(&self) -> Result<Option<DepthMap>, gs_io::Error> {
        self.of.faces[self.index].depth()
    }

    fn digest(&self) -> Result<u32, gs_io::Error> {
        self.of.faces[self.index].digest()
    }

    fn is_face(&self) -> bool {
        true
    }

    fn counting(&self) -> Counting {
        self.of.faces[self.index].counting()
    }
}
