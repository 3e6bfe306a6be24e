//! Effects that a 3D scene requires; see the [module](super). Every view is projected once, for all
//! effects.

mod sh;

use self::sh::ShDegree;
use super::{Decision, RequiresEffects, background, overlap::Shown};
use crate::{
    effects::{Antialias, Blend, Effect, Effects, Order},
    scene::Scene3d,
    settings::RenderSettings,
    view::Camera,
    words::{counted, there_are},
};

impl RequiresEffects for Scene3d {
    fn decide(&self, views: &[Camera], settings: &RenderSettings) -> [Decision; Effect::ALL.len()] {
        let effects = settings.effects;
        let mut order = Orders::of(views, settings);
        let mut sh = ShDegree::of(self, views, settings);
        let mut widths = Widths::default();
        for (number, camera) in (1..).zip(views) {
            if order.is_settled() && sh.is_settled() && widths.is_settled() {
                break;
            }
            let shown = Shown::of(self, camera, settings);
            order.look(number, &shown);
            sh.look(number, camera, &shown);
            widths.look(number, &shown);
        }
        let blend = match effects.blend {
            Blend::Sum => "Gaussians are added up",
            Blend::Over => "one Gaussian may hide another",
        };
        let (sh_degree, reason) = sh.decided(views);
        [
            order.decided(views),
            (effects, blend.to_owned()),
            (Effects { sh_degree, ..effects }, reason),
            widths.decided(self, views, settings),
            background(settings),
        ]
    }
}

/// An order and the next cheaper one, and whether the cheaper one is known not to be enough.
struct Cheaper {
    wanted: Effects,
    cheaper: Effects,
    /// Why the cheaper order is not enough.
    refuted: Option<Refuted>,
}

enum Refuted {
    /// Some Gaussians come out of order: `out` of the `drawn` ones in view `number`.
    By { out: usize, drawn: usize, number: usize },
    /// Too many Gaussians overlap in view `number` to decide.
    Unknown { drawn: usize, number: usize },
}

impl Cheaper {
    fn look(&mut self, number: usize, shown: &Shown) {
        let drawn = shown.drawn.len();
        self.refuted = match shown.out_of_order(self.wanted.order, self.cheaper.order) {
            Some(0) => return,
            Some(out) => Some(Refuted::By { out, drawn, number }),
            None => Some(Refuted::Unknown { drawn, number }),
        };
    }

    /// Why the cheaper order is not enough, and why it is.
    fn words(&self) -> [&'static str; 2] {
        match self.wanted.order {
            Order::PerPixel => ["interpenetrate others in depth", "one depth a Gaussian will do: none interpenetrate"],
            _ => [
                "are hidden out of the order of the scene",
                "no depth order: no Gaussian hides one that is earlier in the scene",
            ],
        }
    }
}

/// What is known about the required order, view by view.
struct Orders {
    wanted: Effects,
    /// Orders from the wanted one down; empty where no view is needed to decide.
    steps: Vec<Cheaper>,
    /// Decision that needs no view.
    at_once: Option<(Effects, &'static str)>,
}

impl Orders {
    fn of(views: &[Camera], settings: &RenderSettings) -> Self {
        let wanted = settings.effects;
        let off = Effect::Order.off(&wanted);
        let at_once = match (wanted.order, wanted.blend) {
            (Order::Index, _) => Some((off, "the settings have the scene's own order")),
            (_, Blend::Sum) => Some((off, "sums do not depend on it")),
            _ if views.is_empty() => Some((wanted, "which Gaussian hides which is not known without a view")),
            _ => None,
        };
        let down = std::iter::successors(Some(wanted), |effects| Effect::Order.cheaper(effects));
        let steps = down.clone().zip(down.skip(1));
        let steps = steps.map(|(wanted, cheaper)| Cheaper { wanted, cheaper, refuted: None });
        Self { wanted, steps: if at_once.is_some() { Vec::new() } else { steps.collect() }, at_once }
    }

    fn is_settled(&self) -> bool {
        // A step that is not possible ends the search.
        self.steps.first().is_none_or(|step| step.refuted.is_some())
    }

    fn look(&mut self, number: usize, shown: &Shown) {
        for step in &mut self.steps {
            if step.refuted.is_none() {
                step.look(number, shown);
            }
            if step.refuted.is_some() {
                break;
            }
        }
    }

    /// The decision once all of these views have been looked at.
    fn decided(self, views: &[Camera]) -> Decision {
        if let Some((effects, reason)) = self.at_once {
            return (effects, reason.to_owned());
        }
        let mut left = (self.wanted, String::new());
        for step in self.steps {
            let [what, so] = step.words();
            match step.refuted {
                None => left = (step.cheaper, format!("{so} {}", in_views(views))),
                Some(Refuted::Unknown { drawn, number }) => {
                    return (left.0, format!("{drawn} Gaussians overlap too much in view {number} to decide"));
                }
                Some(Refuted::By { out, drawn, number }) => {
                    let found = format!("{out} of {} {what} in view {number}", counted(drawn, "Gaussian"));
                    return (left.0, if left.1.is_empty() { found } else { format!("{}; but {found}", left.1) });
                }
            }
        }
        left
    }
}

/// The views as words.
fn in_views(views: &[Camera]) -> String {
    match views {
        [] => "in any view".to_owned(),
        [_] => "in this view".to_owned(),
        _ => format!("in these {} views", views.len()),
    }
}

/// What is known about narrow Gaussians, view by view.
#[derive(Default)]
struct Widths {
    /// Gaussians drawn in all views so far.
    drawn: usize,
    /// Number of narrow Gaussians, in words, in the first view that has some.
    narrow: Option<String>,
}

impl Widths {
    fn is_settled(&self) -> bool {
        self.narrow.is_some()
    }

    fn look(&mut self, number: usize, shown: &Shown) {
        self.drawn += shown.drawn.len();
        let narrow = shown.drawn.iter().filter(|drawn| drawn.narrow).count();
        if narrow > 0 && self.narrow.is_none() {
            let narrow = there_are(narrow, "Gaussian");
            self.narrow = Some(format!("{narrow} narrower than a pixel in view {number}"));
        }
    }

    /// The decision once all of these views have been looked at.
    fn decided(self, scene: &Scene3d, views: &[Camera], settings: &RenderSettings) -> Decision {
        let effects = settings.effects;
        match (effects.antialias, self.narrow) {
            (Antialias::None, None) => (effects, "the settings have none".to_owned()),
            (Antialias::None, Some(narrow)) => (effects, format!("the settings have none, though {narrow}")),
            (_, Some(narrow)) => (effects, narrow),
            (_, None) if self.drawn == 0 && !views.is_empty() => {
                let off = Effect::Antialias.off(&effects);
                // A Gaussian that fades below the cut as it is widened would be drawn without
                // antialiasing.
                match first_drawn(scene, views, &RenderSettings { effects: off, ..*settings }) {
                    None => (off, format!("nothing is drawn {}", in_views(views))),
                    Some((number, count)) => {
                        let drawn = there_are(count, "Gaussian");
                        (effects, format!("without it {drawn} drawn in view {number}"))
                    }
                }
            }
            (_, None) => (effects, "it widens every Gaussian".to_owned()),
        }
    }
}

/// Number of the first view in which something is drawn, and of the Gaussians drawn there.
fn first_drawn(scene: &Scene3d, views: &[Camera], settings: &RenderSettings) -> Option<(usize, usize)> {
    let counts = views.iter().map(|camera| Shown::of(scene, camera, settings).drawn.len());
    (1..).zip(counts).find(|&(_, count)| count > 0)
}

#[cfg(test)]
mod tests;
