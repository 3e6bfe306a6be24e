//! Reads the levels of detail that a camera needs, on a thread of its own, while frames are drawn.

use std::{
    sync::mpsc::{Receiver, SyncSender, TryRecvError, channel, sync_channel},
    thread,
    time::{Duration, Instant},
};

use gs_core::{Camera, LodNode, Scene, Scene3d};
use gs_io::{LevelsInMemory, LodFile3d};

use crate::error::Error;

/// Room for levels that are not drawn at present, bytes: cameras often come back.
const ROOM: usize = 256 << 20;

/// Time between two scenes of a transition.
const BETWEEN: Duration = Duration::from_millis(30);

/// What a thread found that reads levels.
enum Step {
    /// The levels in place of those before.
    Scene(Scene3d),
    /// Nothing more is to be read for this camera.
    Done(Camera),
}

/// The newest scene since the last call, and whether more is being read for this view.
pub(crate) type Finer<S> = Box<dyn FnMut(&<S as Scene>::View) -> Result<(Option<S>, bool), Error> + Send>;

/// Starts to read what the cameras need that the result is called with, up to a budget of Gaussians.
pub(crate) fn finer(file: LodFile3d, budget: usize) -> Finer<Scene3d> {
    // One scene waits at most: they may be large.
    let ((wanted, cameras), (steps, found)) = (channel(), sync_channel(1));
    thread::spawn(move || serve(&mut LevelsInMemory::of(file, ROOM), budget, &cameras, &steps));
    let (mut asked, mut done) = (None, None);
    Box::new(move |camera| {
        if asked != Some(*camera) {
            asked = Some(*camera);
            // If the thread has ended, that is found out below.
            let _gone = wanted.send(*camera);
        }
        let mut newest = None;
        loop {
            match found.try_recv() {
                Ok(step) => match step? {
                    Step::Scene(scene) => newest = Some(scene),
                    Step::Done(camera) => done = Some(camera),
                },
                Err(TryRecvError::Empty) => return Ok((newest, asked != done)),
                Err(TryRecvError::Disconnected) => {
                    return Err(Error::Levels { message: "reading levels of detail has ended in a panic".to_owned() });
                }
            }
        }
    })
}

/// Reads for each camera until there are no more, or until something fails.
fn serve(
    levels: &mut LevelsInMemory,
    budget: usize,
    cameras: &Receiver<Camera>,
    steps: &SyncSender<Result<Step, Error>>,
) {
    let (mut shown, clock) = (None, Instant::now());
    while let Ok(mut camera) = cameras.recv() {
        let mut steps_of_camera = 0..LodNode::STEPS_PX.len();
        loop {
            // What an earlier camera needed is of no use.
            if let Some(newer) = cameras.try_iter().last() {
                (camera, steps_of_camera) = (newer, 0..LodNode::STEPS_PX.len());
            }
            let step = match steps_of_camera.next() {
                None if !levels.is_changing() => Some(Ok(Step::Done(camera))),
                index => {
                    if index.is_none() {
                        thread::sleep(BETWEEN);
                    }
                    let index = index.unwrap_or(LodNode::STEPS_PX.len() - 1);
                    next_scene(levels, (&camera, budget, index), &mut shown, clock).transpose()
                }
            };
            let Some(step) = step else { continue };
            let ends = matches!(step, Ok(Step::Done(_)));
            if step.is_err() | steps.send(step).is_err() {
                return;
            }
            if ends {
                break;
            }
        }
    }
}

/// The scene of a step on the way to what a camera needs, at this time; `None` if it is shown already.
fn next_scene(
    levels: &mut LevelsInMemory,
    (camera, budget, index): (&Camera, usize, usize),
    shown: &mut Option<Vec<usize>>,
    clock: Instant,
) -> Result<Option<Step>, Error> {
    let now = levels.tree().step(shown.as_deref(), camera, budget, index)?;
    if shown.as_ref() == Some(&now) && !levels.is_changing() {
        return Ok(None);
    }
    let seconds = clock.elapsed().as_secs_f64();
    let scene = levels.read_at(&now, camera, seconds).map_err(|error| Error::Levels { message: error.to_string() })?;
    *shown = Some(now);
    Ok(Some(Step::Scene(scene)))
}

#[cfg(test)]
mod tests {
    use std::{fs, path::Path};

    use glam::Vec3;
    use gs_core::{Gaussian3d, Scene as _};
    use gs_io::{WriteOptions3d, write_3d};

    use super::*;

    /// A file with levels of 6,000 Gaussians on a square of 40 by 40, more than a cell has.
    fn square(folder: &Path) -> LodFile3d {
        let gaussian = |i: u32| Gaussian3d {
            mean: Vec3::new((i as f32 * 0.618_034).fract() * 40.0, 0.0, (i as f32 * 0.754_877_7).fract() * 40.0),
            log_scale: Vec3::splat(-1.5),
            rotation: [1.0, 0.0, 0.0, 0.0],
            opacity_logit: 2.0,
            sh: vec![Vec3::splat(0.5)],
        };
        let path = folder.join("lod-meta.json");
        write_3d(&path, &(0..6000).map(gaussian).collect(), &WriteOptions3d::default()).unwrap();
        LodFile3d::open(path).unwrap().unwrap()
    }

    /// A camera above the corner of the square, so far away.
    fn above(distance: f32) -> Camera {
        let lens = Camera::looking_forward(400, 300, 1.0);
        lens.looking_at(Vec3::new(5.0, -distance, 5.0), Vec3::new(5.0, 0.0, 5.1), Vec3::Z).unwrap()
    }

    /// The numbers of Gaussians of the scenes that come for a camera, one after the other.
    fn scenes(finer: &mut Finer<Scene3d>, camera: &Camera) -> Result<Vec<usize>, Error> {
        let mut counts = Vec::new();
        for _ in 0..2000 {
            let (scene, more) = finer(camera)?;
            counts.extend(scene.map(|scene| scene.len()));
            if !more {
                return Ok(counts);
            }
            thread::sleep(Duration::from_millis(5));
        }
        panic!("no end after {counts:?}");
    }

    #[test]
    fn nearer_cameras_get_finer_levels_in_the_end_within_the_budget() {
        let place = tempfile::tempdir().unwrap();
        let file = square(place.path());
        let mut all = finer(file.clone(), 10_000);
        let far = scenes(&mut all, &above(4000.0)).unwrap();
        let near = scenes(&mut all, &above(8.0)).unwrap();
        assert!(far.last() < near.last(), "{far:?} {near:?}");
        // In a transition, both levels are drawn.
        assert!(near.iter().max() > near.last(), "{near:?}");
        assert_eq!(scenes(&mut all, &above(8.0)).unwrap(), [0; 0], "nothing new");
        assert_eq!(scenes(&mut all, &above(4000.0)).unwrap().last(), far.last());
        let few = scenes(&mut finer(file, 1500), &above(8.0)).unwrap();
        assert!(few.last().is_some_and(|&count| count <= 1500) && few.iter().all(|&count| count <= 3000), "{few:?}");
    }

    #[test]
    fn a_level_that_is_gone_is_an_error_that_names_it() {
        let place = tempfile::tempdir().unwrap();
        let file = square(place.path());
        fs::remove_dir_all(place.path().join("0_0")).unwrap();
        let error = scenes(&mut finer(file, 10_000), &above(8.0)).unwrap_err();
        assert!(error.to_string().contains("0_0"), "{error}");
    }
}
