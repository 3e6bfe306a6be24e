//! Levels of detail of a streamed SOG, whose files JavaScript fetches.
//!
//! One engine reads them in a worker of its own, and another draws, so that no picture waits for a chunk. The first
//! sends the second an array of numbers.

use std::path::{Path, PathBuf};

use glam::Vec3;
use gs_core::{Camera, Choice as _, LodNode, Scene as _, Scene3d, effects::Antialias, view::Bulk};
use gs_io::{AnyScene, File3d, FilesInMemory, Format3d, LevelsInMemory, LodFile3d};
use serde::Serialize;
use wasm_bindgen::prelude::*;

use crate::{
    engine::Engine,
    failure, parsed,
    view::{Frame, Pose, View},
};

/// The levels that a camera needs. While they are fetched, a picture of those that are there can be drawn.
#[wasm_bindgen]
#[derive(Debug)]
pub struct Levels {
    levels: LevelsInMemory,
    budget: usize,
    camera: Option<Camera>,
    /// The step on the way to what the camera needs.
    step: usize,
    /// The levels of this step.
    wanted: Vec<usize>,
    /// Number of chunks that have come, and the levels wanted with them, when something was shown last.
    shown: Option<(u32, Vec<usize>)>,
    added: u32,
    sh_degree: u8,
    antialias: Option<Antialias>,
}

/// What [`Levels::info`] returns.
#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
struct Info {
    /// Gaussians of the finest level.
    gaussians: usize,
    home: Option<Pose>,
}

#[wasm_bindgen]
impl Levels {
    /// Opens the bytes of a `lod-meta.json`. At most `budget` Gaussians are drawn, unless the coarsest levels have
    /// more. Up to `room` bytes are used for levels that are not drawn at present.
    #[wasm_bindgen(constructor)]
    pub fn open(meta: &[u8], budget: usize, room: usize) -> Result<Levels, JsError> {
        let file = LodFile3d::decode(meta, Path::new("lod-meta.json")).map_err(failure)?;
        if budget == 0 {
            return Err(JsError::new("maxGaussians must be at least 1"));
        }
        let levels = LevelsInMemory::of(file, room);
        Ok(Self {
            levels,
            budget,
            camera: None,
            step: 0,
            wanted: Vec::new(),
            shown: None,
            added: 0,
            sh_degree: 0,
            antialias: None,
        })
    }

    /// What the scene is, as JSON.
    pub fn info(&self) -> String {
        let tree = self.levels.tree();
        let gaussians = tree.cells().iter().filter_map(|(_, levels)| levels.first()).map(|level| level.gaussians).sum();
        serde_json::to_string(&Info { gaussians, home: Bulk::of_cells(tree).and_then(|bulk| Pose::home(&bulk)) })
            .unwrap_or_default()
    }

    /// Begins with the steps to what the camera of a frame needs. The frame is JSON.
    pub fn look(&mut self, frame: String) -> Result<(), JsError> {
        let frame: Frame = parsed(&frame)?;
        self.camera = Some(frame.camera(|| Bulk::of_cells(self.levels.tree()))?);
        self.begin(0)
    }

    /// Goes to the next step, if there is one.
    pub fn next(&mut self) -> Result<bool, JsError> {
        let goes_on = self.step + 1 < LodNode::STEPS_PX.len();
        if goes_on {
            self.begin(self.step + 1)?;
        }
        Ok(goes_on)
    }

    fn begin(&mut self, step: usize) -> Result<(), JsError> {
        self.step = step;
        if let Some(camera) = &self.camera {
            let tree = self.levels.tree();
            self.wanted = tree.step(self.levels.shown_levels(), camera, self.budget, step).map_err(failure)?;
        }
        Ok(())
    }

    /// The `meta.json` of the chunks that are missing in this step, the nearest to the camera first. Their addresses
    /// begin at the folder of `lod-meta.json`.
    pub fn missing(&mut self) -> Vec<String> {
        let position = self.camera.map_or(Vec3::ZERO, |camera| camera.position());
        let paths = self.levels.missing(&self.wanted, position);
        paths.iter().map(|path| path.to_string_lossy().into_owned()).collect()
    }

    /// Takes a chunk that was missing: the address of its `meta.json`, names and contents of that and of the images
    /// beside it.
    pub fn add(&mut self, path: String, names: Vec<String>, contents: Vec<js_sys::Uint8Array>) -> Result<(), JsError> {
        let path = PathBuf::from(path);
        let files: FilesInMemory =
            names.iter().zip(contents).map(|(name, bytes)| (path.with_file_name(name), bytes.to_vec())).collect();
        self.levels.add(&path, Some(&files)).map_err(failure)?;
        self.added += 1;
        Ok(())
    }

    /// What has been fetched for the levels of this step, as numbers for [`Engine::levels_view`]; `None` if nothing has
    /// changed since the last call, or if there are no Gaussians.
    pub fn shown(&mut self) -> Option<Vec<f32>> {
        let now = (self.added, self.wanted.clone());
        if self.shown.as_ref() == Some(&now) || self.added == 0 {
            return None;
        }
        self.shown = Some(now);
        self.antialias = self.levels.trained_with().antialias;
        let parts = self.levels.shown(&self.wanted);
        self.sh_degree = parts.iter().map(|part| part.sh_degree).max().unwrap_or(0);
        let count: usize = parts.iter().map(|part| part.len()).sum();
        if count == 0 {
            return None;
        }
        let mut numbers = Vec::with_capacity(count * numbers_of(self.sh_degree));
        let flat = |vectors: &[Vec3]| vectors.iter().flat_map(|v| v.to_array()).collect::<Vec<f32>>();
        parts.iter().for_each(|part| numbers.extend(flat(&part.means)));
        parts.iter().for_each(|part| numbers.extend(flat(&part.log_scales)));
        for part in &parts {
            match part.sh_degree == self.sh_degree {
                true => numbers.extend(flat(&part.sh)),
                false => numbers.extend(flat(&part.clone().into_owned().with_degree(self.sh_degree).sh)),
            }
        }
        parts.iter().for_each(|part| numbers.extend(part.rotations.as_flattened()));
        parts.iter().for_each(|part| numbers.extend(&part.opacity_logits));
        Some(numbers)
    }

    /// Degree of the spherical harmonics of what was shown last.
    #[wasm_bindgen(getter, js_name = shDegree)]
    pub fn sh_degree(&self) -> u8 {
        self.sh_degree
    }

    /// How the scene was antialiased in training, where that is known.
    #[wasm_bindgen(getter)]
    pub fn antialias(&self) -> Option<String> {
        self.antialias.map(|antialias| antialias.name().to_owned())
    }
}

/// Numbers of a Gaussian of this degree.
fn numbers_of(sh_degree: u8) -> usize {
    3 + 3 + 3 * (usize::from(sh_degree) + 1).pow(2) + 4 + 1
}

#[wasm_bindgen]
impl Engine {
    /// The Gaussians that [`Levels::shown`] has given as numbers, to look at.
    #[wasm_bindgen(js_name = levelsView)]
    pub fn levels_view(&self, numbers: &[f32], sh_degree: u8, antialias: Option<String>) -> Result<View, JsError> {
        let count = numbers.len() / numbers_of(sh_degree);
        let (mut rest, len) = (numbers, (usize::from(sh_degree) + 1).pow(2));
        let mut next = |len: usize| rest.split_off(..len).unwrap_or_default();
        let vectors = |numbers: &[f32]| numbers.as_chunks::<3>().0.iter().copied().map(Vec3::from_array).collect();
        let scene = Scene3d {
            means: vectors(next(3 * count)),
            log_scales: vectors(next(3 * count)),
            sh: vectors(next(3 * len * count)),
            rotations: next(4 * count).as_chunks::<4>().0.to_vec(),
            opacity_logits: next(count).to_vec(),
            sh_degree,
        };
        let mut file = File3d::of(Format3d::StreamedSog, scene);
        file.trained_with.antialias = antialias.as_deref().and_then(Antialias::from_name);
        View::of(self, AnyScene::ThreeD(Box::new(file)))
    }
}
