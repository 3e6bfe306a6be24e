//! A scene to look at.

use std::{
    cell::{OnceCell, RefCell},
    path::Path,
    rc::Rc,
};

use glam::Vec3;
use gs_backend::{AnyRasterizer, AnySplats};
use gs_core::{
    Camera, Canvas, Culled, Image, Parameterization, Rasterizer, RenderSettings, Scene as _, Scene2d, Scene3d,
    effects::{Antialias, Order},
    view::Bulk,
};
use gs_io::{AnyScene, ConversionLoss, File2d, File3d, decode_scene};
#[cfg(feature = "page")]
use gs_io::{WriteOptions3d, encode_2d, encode_3d, png_bytes};
use serde::{Deserialize, Serialize};
use wasm_bindgen::prelude::*;

use crate::{engine::Engine, failure, parsed, pixels};

/// A scene of a file, where the backend computes.
#[wasm_bindgen]
#[derive(Debug)]
pub struct View {
    on: &'static AnyRasterizer,
    shown: Shown,
}

#[derive(Debug)]
enum Shown {
    TwoD {
        file: Box<File2d>,
        splats: Box<AnySplats<Scene2d>>,
    },
    /// All Gaussians go to the backend when they are first drawn.
    ThreeD {
        file: Box<File3d>,
        all: Box<OnceCell<AnySplats<Scene3d>>>,
        few: Option<Few>,
    },
}

/// Gaussians that stand for all, where those take long, while the camera moves.
#[derive(Debug)]
struct Few {
    coverage: Vec<f32>,
    /// Those that were drawn last, and where the camera was for which they were chosen.
    chosen: RefCell<Option<(Vec3, Rc<AnySplats<Scene3d>>)>>,
}

impl Few {
    /// Returns the Gaussians to draw for this camera. They are chosen anew when it has moved by half of its distance from what it looks at.
    fn of(&self, on: &AnyRasterizer, scene: &Scene3d, pose: &Pose) -> Result<Rc<AnySplats<Scene3d>>, JsError> {
        let (position, target) = (Vec3::from(pose.position), Vec3::from(pose.target));
        let reach = position.distance(target);
        let mut chosen = self.chosen.borrow_mut();
        if let Some((_, few)) = chosen.as_ref().filter(|(before, _)| before.distance(position) < 0.5 * reach) {
            return Ok(Rc::clone(few));
        }
        // What is very near would leave nothing for the rest.
        let nearest = (0.1 * reach).powi(2);
        let weight = |i: usize| self.coverage[i] / scene.means[i].distance_squared(position).max(nearest);
        let few = on.upload(&scene.thinned(FEW, weight), Parameterization::ScaleRotation).map_err(failure)?;
        Ok(Rc::clone(&chosen.insert((position, Rc::new(few))).1))
    }
}

/// The most Gaussians of a 3D scene that the CPU draws while the camera moves.
const FEW: usize = 150_000;

/// Sides of the picture for which the first camera is described, px.
const SQUARE: u32 = 512;

/// What [`View::info`] returns.
#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
struct Info {
    kind: &'static str,
    format: String,
    gaussians: usize,
    sh_degree: u8,
    antialias: &'static str,
    order: &'static str,
    losses: Vec<String>,
    /// Columns and rows of a 2D scene, px.
    size: Option<(u32, u32)>,
    /// The first camera of a 3D scene, and the size of its picture, px, where that is fixed.
    home: Option<Pose>,
}

/// A picture of a scene.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase", deny_unknown_fields)]
pub(crate) struct Frame {
    width: u32,
    height: u32,
    /// The camera of a 3D scene; the first one, if there is none.
    camera: Option<Pose>,
    /// Whether the camera moves, so that the next picture comes soon.
    #[serde(default)]
    moving: bool,
    /// The rectangle of a 2D scene: left, top, width, height, px of its image.
    rectangle: Option<[f32; 4]>,
    order: Option<Order>,
    antialias: Option<Antialias>,
    sh_degree: Option<u8>,
    background: Option<[f32; 3]>,
}

/// A camera: where it is, what it looks at, which way is up, its horizontal field of view in
/// degrees.
#[derive(Debug, Serialize, Deserialize)]
#[serde(rename_all = "camelCase", deny_unknown_fields)]
pub(crate) struct Pose {
    position: [f32; 3],
    target: [f32; 3],
    up: [f32; 3],
    fov: f32,
}

impl Pose {
    /// The camera that `gs render` starts with, slightly above the scene.
    pub(crate) fn home(bulk: &Bulk) -> Option<Self> {
        // The field of view does not depend on the size if that is square.
        let camera = overview(bulk, SQUARE, SQUARE)?;
        Some(Self {
            position: camera.position().to_array(),
            target: bulk.center.to_array(),
            up: UP.to_array(),
            fov: 2.0 * (0.5 * SQUARE as f32 / camera.focal.x).atan().to_degrees(),
        })
    }
}

impl Frame {
    /// The camera of a 3D scene, or the first one for its bulk.
    pub(crate) fn camera(&self, bulk: impl FnOnce() -> Option<Bulk>) -> Result<Camera, JsError> {
        let (width, height) = (self.width, self.height);
        let camera = match &self.camera {
            Some(pose) => Camera::looking_forward(width, height, pose.fov.to_radians()).looking_at(
                pose.position.into(),
                pose.target.into(),
                pose.up.into(),
            ),
            None => bulk().and_then(|bulk| overview(&bulk, width, height)),
        };
        camera.ok_or_else(|| JsError::new("the camera looks straight up or down"))
    }
}

/// Up in a scene that does not say.
const UP: Vec3 = Vec3::NEG_Y;

fn overview(bulk: &Bulk, width: u32, height: u32) -> Option<Camera> {
    bulk.overview(width, height, Bulk::FIELD_OF_VIEW, UP)
}

#[wasm_bindgen]
impl Engine {
    /// Opens the bytes of a scene's file; its name decides where the content doesn't.
    pub fn view(&self, bytes: Vec<u8>, name: String) -> Result<View, JsError> {
        let scene = decode_scene(&bytes, Path::new(&name)).map_err(failure)?;
        drop(bytes);
        View::of(self, scene)
    }
}

impl View {
    pub(crate) fn of(engine: &Engine, scene: AnyScene) -> Result<Self, JsError> {
        let (on, parameterization) = (engine.on, Parameterization::ScaleRotation);
        let shown = match scene {
            AnyScene::TwoD(file) => {
                let splats = Box::new(on.upload(&file.scene, parameterization).map_err(failure)?);
                Shown::TwoD { splats, file }
            }
            AnyScene::ThreeD(file) => {
                let takes_long = matches!(on, AnyRasterizer::Cpu(_)) && file.scene.len() > FEW;
                if takes_long {
                    let few = Some(Few { coverage: file.scene.coverage(), chosen: RefCell::default() });
                    Shown::ThreeD { all: Box::default(), few, file }
                } else {
                    let all = on.upload(&file.scene, parameterization).map_err(failure)?;
                    Shown::ThreeD { all: Box::new(all.into()), few: None, file }
                }
            }
        };
        Ok(Self { on, shown })
    }
}

#[wasm_bindgen]
impl View {
    /// What the scene is, as JSON.
    pub fn info(&self) -> String {
        let settings = self.settings();
        let mut info = Info {
            kind: "2d",
            format: "2D scene".to_owned(),
            gaussians: 0,
            sh_degree: 0,
            antialias: settings.effects.antialias.name(),
            order: settings.effects.order.name(),
            losses: Vec::new(),
            size: None,
            home: None,
        };
        match &self.shown {
            Shown::TwoD { file, .. } => {
                info.gaussians = file.scene.len();
                info.size = Some((file.width, file.height));
            }
            Shown::ThreeD { file, .. } => {
                info.kind = "3d";
                info.format = file.format.to_string();
                info.gaussians = file.scene.len();
                info.sh_degree = file.scene.sh_degree;
                info.losses = file.losses.iter().map(ConversionLoss::to_string).collect();
                info.home = Bulk::of(&file.scene).and_then(|bulk| Pose::home(&bulk));
            }
        }
        serde_json::to_string(&info).unwrap_or_default()
    }

    /// Pixels of a picture, which JSON describes.
    pub async fn pixels(&self, frame: String) -> Result<Vec<u8>, JsError> {
        Ok(pixels::rgba_of(&self.draw(&parsed(&frame)?).await?))
    }

    /// The PNG of a picture.
    #[cfg(feature = "page")]
    pub async fn png(&self, frame: String) -> Result<Vec<u8>, JsError> {
        Ok(png_bytes(&self.draw(&parsed(&frame)?).await?))
    }

    /// The scene as a file in the format of this name's ending.
    #[cfg(feature = "page")]
    pub fn file(&self, name: String) -> Result<Vec<u8>, JsError> {
        match &self.shown {
            Shown::TwoD { file, .. } => encode_2d(file).map_err(failure),
            Shown::ThreeD { file, .. } => {
                let options = WriteOptions3d::default().with(|s| s.trained_with = file.trained_with);
                Ok(encode_3d(&name, &file.scene, &options).map_err(failure)?.bytes)
            }
        }
    }

    fn settings(&self) -> RenderSettings {
        match &self.shown {
            Shown::TwoD { file, .. } => file.settings,
            Shown::ThreeD { file, .. } => file.render_settings(None),
        }
    }

    async fn draw(&self, frame: &Frame) -> Result<Image, JsError> {
        let mut settings = self.settings();
        let effects = &mut settings.effects;
        effects.order = frame.order.unwrap_or(effects.order);
        effects.antialias = frame.antialias.unwrap_or(effects.antialias);
        effects.sh_degree = frame.sh_degree.map_or(effects.sh_degree, |degree| degree.min(effects.sh_degree));
        if let Some(background) = frame.background {
            settings = settings.on(background);
        }
        let Frame { width, height, .. } = *frame;
        let drawn: Result<(Image, Culled), gs_core::Error> = match &self.shown {
            Shown::TwoD { file, splats } => {
                let mut canvas = Canvas::new(file.width, file.height).resized(width, height);
                if let Some([left, top, columns, rows]) = frame.rectangle {
                    canvas = canvas.showing([left, top].into(), [columns, rows].into());
                }
                Rasterizer::<Scene2d>::draw(self.on, splats, &canvas, &settings).await
            }
            Shown::ThreeD { file, all, few } => {
                let all = || match all.get() {
                    Some(all) => Ok(all),
                    None => {
                        let splats = self.on.upload(&file.scene, Parameterization::ScaleRotation).map_err(failure)?;
                        Ok::<_, JsError>(all.get_or_init(|| splats))
                    }
                };
                let few = match (few, &frame.camera) {
                    (Some(few), Some(pose)) if frame.moving => Some(few.of(self.on, &file.scene, pose)?),
                    _ => None,
                };
                let splats = few.as_deref().map_or_else(all, Ok)?;
                let camera = frame.camera(|| Bulk::of(&file.scene))?;
                Rasterizer::<Scene3d>::draw(self.on, splats, &camera, &settings).await
            }
        };
        let (image, _) = drawn.map_err(failure)?;
        Ok(match &self.shown {
            Shown::TwoD { file, .. } => file.in_srgb(image),
            Shown::ThreeD { .. } => image,
        })
    }
}
