//! What a hard case is: what is drawn, why that is hard and who met it before, and what is expected of every backend.

use gs_core::{Adam, Error, Image, Loss, RenderSettings, statistics::Culled};

use crate::{scenes, subject::Subject};

/// Training steps of a case, unless it says otherwise.
pub const STEPS: usize = 200;

/// Those of a case with thousands of Gaussians at a pixel, whose steps take a hundred times as long.
pub(super) const STACK_STEPS: usize = 20;

/// Where it is known from that a case is hard.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Source {
    /// A section of the paper.
    Paper(&'static str),
    /// A public report of another engine's trouble with it, by its address.
    Report(&'static str),
    /// An item of gs-core whose definition has an edge here.
    Definition(&'static str),
}

/// One hard case.
#[derive(Debug, Clone)]
pub struct Case<S: Subject> {
    /// Its name.
    pub name: String,
    /// Why it is hard: what goes wrong in engines that do not think of it.
    pub why: &'static str,
    /// Who met it.
    pub source: Source,
    /// The Gaussians.
    pub scene: S,
    /// What they are seen through.
    pub view: S::View,
    /// Effects, accuracy and background.
    pub settings: RenderSettings,
    /// What training is after.
    pub goal: Goal,
    /// What training minimises.
    pub loss: Loss,
    /// How training moves.
    pub adam: Adam,
    /// Training steps in each parameterization; fewer than [`STEPS`] only where one takes long.
    pub steps: usize,
    /// What must come of it.
    pub expected: Expected,
}

/// The image that a case is compared with while it is trained.
#[derive(Debug, Clone)]
pub enum Goal {
    /// A photograph's likeness ([`scenes::target`]) of this seed.
    Likeness(u64),
    /// This image.
    Image(Image),
    /// What the backend itself shows of the scene, so that the loss is 0.
    Itself,
}

/// What must come of a case.
#[derive(Debug, Clone)]
pub enum Expected {
    /// The scene is not accepted, with an error of which this is true.
    Refused(fn(&Error) -> bool),
    /// It is drawn, differentiated and trained.
    Drawn(Drawn),
}

/// What is expected of a case that is drawn.
#[derive(Debug, Clone)]
pub struct Drawn {
    /// What the frame leaves out, by cause. All other Gaussians must be drawn: no case is passed by leaving out what is valid.
    pub culled: Culled,
    /// The image.
    pub picture: Picture,
    /// The gradients.
    pub slopes: Slopes,
    /// The training.
    pub training: Training,
}

/// What is expected of an image.
#[derive(Debug, Clone)]
pub enum Picture {
    /// The oracle's, within [`ROUNDINGS`](crate::tolerance::ROUNDINGS) of its own analysis of this very scene.
    Oracle,
    /// Exactly this, to the bit.
    Exact(Image),
    /// This, to a relative error, where the oracle would take too long.
    Within(Image, f32),
}

/// The share of a Gaussian's largest gradient below which its gradients are measured against that.
pub const NEGLIGIBLE: f64 = 1e-4;

/// What is expected of gradients.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Slopes {
    /// The oracle's, as images.
    Oracle,
    /// As [`Self::Oracle`], but for what is less than [`NEGLIGIBLE`] of the largest of the same Gaussian, for this reason.
    Leading(&'static str),
    /// Finite, and no more: rounding may change them beyond what could be compared, for this reason.
    Finite(&'static str),
    /// All exactly 0.
    Zero,
}

/// What is expected of a training run: losses and parameters that are finite after every number of steps, and this.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Training {
    /// The last loss is no worse than the first.
    Improves,
    /// Nothing more, for this reason.
    Finite(&'static str),
    /// No parameter changes, and no loss.
    StandsStill,
    /// Losses may overflow: +∞, never NaN. Parameters stay finite, and those of every Gaussian still change in the last step.
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
    /// A case whose image and gradients are the oracle's, in which all Gaussians are drawn, and whose training after a photograph's likeness
    /// by [`Loss::L2`] improves.
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

    /// The same, of which a frame leaves out these.
    #[must_use]
    pub fn leaving_out(self, culled: Culled) -> Self {
        self.with(|drawn| drawn.culled = culled)
    }

    /// The same with another picture expected.
    #[must_use]
    pub fn showing(self, picture: Picture) -> Self {
        self.with(|drawn| drawn.picture = picture)
    }

    /// The same with other gradients expected.
    #[must_use]
    pub fn sloping(self, slopes: Slopes) -> Self {
        self.with(|drawn| drawn.slopes = slopes)
    }

    /// The same with other training expected.
    #[must_use]
    pub fn training(self, training: Training) -> Self {
        self.with(|drawn| drawn.training = training)
    }

    /// The same after another goal, by another loss.
    #[must_use]
    pub fn after(self, goal: Goal, loss: Loss) -> Self {
        Self { goal, loss, ..self }
    }

    /// The same that is not accepted.
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
    /// The image, where `shown` is what the backend shows of the scene.
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
