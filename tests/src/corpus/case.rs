//! A hard case: its scene, the reason why it is hard, its source, and the expected outcome.

use gs_core::{Adam, Culled, Error, Image, Loss, RenderSettings};

use crate::{scenes, subject::Subject};

/// Default number of training steps of a case.
pub const STEPS: usize = 200;

/// Number of training steps with thousands of Gaussians at a pixel, which take a hundred times as
/// long.
pub(super) const STACK_STEPS: usize = 20;

/// The source of a case.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Source {
    /// A section of the paper.
    Paper(&'static str),
    /// The address of a public report about another engine.
    Report(&'static str),
    /// An item of gs-core whose definition has an edge case here.
    Definition(&'static str),
}

/// One hard case.
#[derive(Debug, Clone)]
pub struct Case<S: Subject> {
    /// The name.
    pub name: String,
    /// Why the case is hard: what goes wrong in engines without protection.
    pub why: &'static str,
    /// Where the case is from.
    pub source: Source,
    /// The Gaussians.
    pub scene: S,
    /// The view.
    pub view: S::View,
    /// Effects, accuracy and background.
    pub settings: RenderSettings,
    /// The target of training.
    pub goal: Goal,
    /// The loss of training.
    pub loss: Loss,
    /// The rates of training.
    pub adam: Adam,
    /// Number of training steps in each parameterization; below [`STEPS`] only if one takes long.
    pub steps: usize,
    /// The expected outcome.
    pub expected: Expected,
}

/// The target of training.
#[derive(Debug, Clone)]
pub enum Goal {
    /// A photo-like image ([`scenes::target`]) with this seed.
    Likeness(u64),
    /// An image.
    Image(Image),
    /// The backend's own rendering, so that the loss is 0.
    Itself,
}

/// The expected outcome of a case.
#[derive(Debug, Clone)]
pub enum Expected {
    /// The scene is refused with an error that satisfies this.
    Refused(fn(&Error) -> bool),
    /// The scene is drawn, differentiated and trained.
    Drawn(Drawn),
}

/// The expected outcome of a case that is drawn.
#[derive(Debug, Clone)]
pub struct Drawn {
    /// Number of culled Gaussians by cause. All others must be drawn: culling valid Gaussians is a
    /// failure.
    pub culled: Culled,
    /// The image.
    pub picture: Picture,
    /// The gradients.
    pub slopes: Slopes,
    /// The training.
    pub training: Training,
}

/// The expected image.
#[derive(Debug, Clone)]
pub enum Picture {
    /// The oracle's image, within [`ROUNDINGS`](crate::tolerance::ROUNDINGS) of its analysis of
    /// this scene.
    Oracle,
    /// An image, bit by bit.
    Exact(Image),
    /// An image within a relative error, where the oracle would take too long.
    Within(Image, f32),
}

/// Gradients below this share of the Gaussian's largest are compared relative to the largest.
pub const NEGLIGIBLE: f64 = 1e-4;

/// The expected gradients.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Slopes {
    /// The oracle's gradients.
    Oracle,
    /// The oracle's gradients, except for those below [`NEGLIGIBLE`] of the same Gaussian's
    /// largest, for this reason.
    Leading(&'static str),
    /// Finite gradients: rounding may change them too much for a comparison, for this reason.
    Finite(&'static str),
    /// Gradients of exactly 0.
    Zero,
}

/// The expected training: finite losses and parameters after every step, and this.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Training {
    /// The last loss is no worse than the first.
    Improves,
    /// Finite losses and parameters only, for this reason.
    Finite(&'static str),
    /// No change of parameters or loss.
    StandsStill,
    /// Losses may be +∞, never NaN. Parameters stay finite, and those of every Gaussian change in
    /// the last step.
    Moves,
}

impl Default for Drawn {
    fn default() -> Self {
        Self {
            culled: Culled::default(),
            picture: Picture::Oracle,
            slopes: Slopes::Oracle,
            training: Training::Improves,
        }
    }
}

impl<S: Subject> Case<S> {
    /// A case with the oracle's image and gradients, in which all Gaussians are drawn, and in which
    /// training towards a photo-like image by [`Loss::L2`] improves the loss.
    pub fn new(
        name: impl Into<String>,
        why: &'static str,
        source: Source,
        scene: S,
        view: S::View,
        settings: RenderSettings,
    ) -> Self {
        let expected = Expected::Drawn(Drawn::default());
        let (goal, adam) = (Goal::Likeness(11), S::adam());
        Self {
            name: name.into(),
            why,
            source,
            scene,
            view,
            settings,
            goal,
            loss: Loss::L2,
            adam,
            steps: STEPS,
            expected,
        }
    }

    /// The case with these culled Gaussians.
    #[must_use]
    pub fn leaving_out(self, culled: Culled) -> Self {
        self.with(|drawn| drawn.culled = culled)
    }

    /// The case with another expected image.
    #[must_use]
    pub fn showing(self, picture: Picture) -> Self {
        self.with(|drawn| drawn.picture = picture)
    }

    /// The case with other expected gradients.
    #[must_use]
    pub fn sloping(self, slopes: Slopes) -> Self {
        self.with(|drawn| drawn.slopes = slopes)
    }

    /// The case with another expected training.
    #[must_use]
    pub fn training(self, training: Training) -> Self {
        self.with(|drawn| drawn.training = training)
    }

    /// The case with another target and loss.
    #[must_use]
    pub fn after(self, goal: Goal, loss: Loss) -> Self {
        Self { goal, loss, ..self }
    }

    /// The case as one that is refused.
    #[must_use]
    pub fn refused(self, right: fn(&Error) -> bool) -> Self {
        Self { expected: Expected::Refused(right), ..self }
    }

    fn with(mut self, change: impl FnOnce(&mut Drawn)) -> Self {
        if let Expected::Drawn(drawn) = &mut self.expected {
            change(drawn);
        }
        self
    }
}

impl Goal {
    /// The target. `shown` is the backend's rendering.
    ///
    /// # Errors
    /// [`Error::Size`] for an impossible size.
    pub fn image(&self, shown: &Image) -> Result<Image, Error> {
        let (width, height) = shown.size();
        match self {
            Self::Likeness(seed) => scenes::target(width, height, *seed),
            Self::Image(image) => Ok(image.clone()),
            Self::Itself => Ok(shown.clone()),
        }
    }
}
