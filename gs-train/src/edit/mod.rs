//! Edits of 3D scenes by the views of a data set: [`ViewEditor`].

mod evidence;
mod floaters;

use glam::{DAffine3, Vec3};
use gs_core::{
    Camera, Image, Optimizer, Parameterization, RenderSettings, Scene as _, Scene3d, constants::SH_C0,
    effects::Statistics, examination::Examinable as _,
};
use gs_io::{Done, Edit, WorldFrame};

use self::evidence::contribution;
pub use self::floaters::Floaters;
use crate::{
    error::Error,
    train::{PosedView, Views},
};

/// The colour that marks what would be removed.
const MARK: Vec3 = Vec3::new(1.0, 0.0, 1.0);

/// Does [edits](Edit) one after the other, also those that need views of the scene.
///
/// The views are the training views of a data set, in the frame of the scene. They move with it.
#[derive(Debug)]
pub struct ViewEditor<'a, R> {
    on: &'a R,
    views: Views,
    render: RenderSettings,
    /// How many views [`Self::marked`] gets for each [`Edit::Floaters`]; default 0.
    pub pictures: usize,
    /// Pictures with the floaters in magenta, and their names.
    pub marked: Vec<(String, Image)>,
}

impl<'a, R: Optimizer<Scene3d>> ViewEditor<'a, R> {
    /// An editor with these views, in which the scene is rendered with these settings.
    pub fn new(on: &'a R, views: Views, render: RenderSettings) -> Self {
        let render = render.with(|s| s.effects.statistics = Statistics::None);
        Self { on, views, render, pictures: 0, marked: Vec::new() }
    }

    /// Does an edit as [`Edit::apply`] does, and says what it did.
    ///
    /// # Errors
    /// [`Error::Edit`]; [`Error::NothingSeen`] where the views show nothing of the scene; those of the backend and of
    /// reading images. The scene may have changed.
    pub async fn apply(&mut self, edit: &Edit, scene: &mut Scene3d, frame: &mut WorldFrame) -> Result<Done, Error> {
        let keep: Vec<bool> = match edit {
            Edit::Floaters(most_loss) => {
                let found = Floaters::find(self.on, scene, &self.views, &self.render, *most_loss).await?;
                self.mark(scene, &found).await?;
                scene.retain(&found.keep);
                return Ok(Done::Changed(found.to_string()));
            }
            Edit::Select { filter, keep } if filter.needs_views() => {
                let contribution = contribution(self.on, scene, &self.views.train, &self.render).await?;
                contribution.into_iter().map(|value| filter.is_true_of(value) == *keep).collect()
            }
            _ => {
                if let Some(map) = edit.map(scene, *frame)? {
                    let moved = |view: &mut PosedView| view.camera = moved(&view.camera, &map);
                    self.views.train.iter_mut().chain(&mut self.views.test).for_each(moved);
                }
                return Ok(edit.apply(scene, frame)?);
            }
        };
        let gone = keep.iter().filter(|keep| !**keep).count();
        scene.retain(&keep);
        Ok(Done::Removed { gone, of: keep.len() })
    }

    /// Draws some of the views with the floaters in the signal colour.
    async fn mark(&mut self, scene: &Scene3d, found: &Floaters) -> Result<(), Error> {
        let pictures = self.pictures.min(self.views.train.len());
        if pictures == 0 {
            return Ok(());
        }
        let mut marked = scene.clone();
        let (len, color) = (scene.sh_len(), (MARK - 0.5) / SH_C0);
        for index in (0..scene.len()).filter(|&index| !found.keep[index]) {
            marked.sh[index * len..][..len].fill(Vec3::ZERO);
            marked.sh[index * len] = color;
        }
        let splats = self.on.upload(&marked, Parameterization::ScaleRotation)?;
        for picture in 0..pictures {
            let view = &self.views.train[picture * self.views.train.len() / pictures];
            let (image, _) = self.on.draw(&splats, &view.camera, &self.render).await?;
            let number = self.marked.len();
            self.marked.push((format!("floaters-{number}"), image.clamped()));
        }
        Ok(())
    }
}

/// A camera that moves with a scene: it shows the same after a map that turns, scales and shifts.
fn moved(camera: &Camera, map: &DAffine3) -> Camera {
    let (scale, turn, shift) = map.to_scale_rotation_translation();
    let rotation = camera.rotation.as_dmat3() * glam::DMat3::from_quat(turn.inverse());
    let translation = scale.x * camera.translation.as_dvec3() - rotation * shift;
    Camera {
        rotation: rotation.as_mat3(),
        translation: translation.as_vec3(),
        near: (scale.x * f64::from(camera.near)) as f32,
        ..*camera
    }
}
