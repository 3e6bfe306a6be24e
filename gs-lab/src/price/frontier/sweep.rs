//! The search for the frontier.

use gs_core::{Accuracy, Error, RenderSettings, Scene};

use super::{
    super::{
        machine::Candidate,
        noise::{Noise, TimeComparison},
        picture_error::PictureError,
        reference::{Reference, Verifiable},
        timing::{ROUNDS, Rounds, Timed, Times, interleaved},
    },
    outcome::{BackendNoise, Frontier, Measured, Refused, Role},
    pareto::frontier_of,
    predict::{Predicted, combinations},
    setting::{Setting, alternatives},
};
use crate::result::median;

/// Share of the time for finding out which combinations are worth measuring.
const SCOUTING: f64 = 0.25;

/// A scene with the candidates that render it.
#[derive(Debug)]
pub(crate) struct Sweep<'a, S: Scene> {
    /// The scene.
    pub(super) scene: &'a S,
    /// The candidates, at least one. Those of a backend are neighbours, the one that its default is
    /// measured on first.
    pub(super) candidates: Vec<Candidate<'a, S::View>>,
    /// The default settings of all backends. Their effects define the reference picture.
    pub(super) shown: RenderSettings,
}

/// Limits of a search.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct SearchLimits {
    /// Seconds for timing. At least seven rounds are measured, however long they take.
    pub(super) seconds: f64,
    /// Largest number of combinations of settings per backend.
    pub(super) combinations: usize,
}

impl Default for SearchLimits {
    fn default() -> Self {
        Self { seconds: 24.0, combinations: 12 }
    }
}

impl<S: Verifiable> Sweep<'_, S> {
    /// The default settings without cut-offs, which the reference picture has.
    fn tightest(&self) -> RenderSettings {
        self.shown.with(|s| s.accuracy = Accuracy::TIGHTEST)
    }

    /// The first candidate of each backend.
    fn bases(&self) -> Vec<usize> {
        let is_first = |&i: &usize| self.candidates[i].change.is_none();
        (0..self.candidates.len()).filter(is_first).collect()
    }

    /// A row that is not measured yet.
    fn row(&self, candidate: usize, settings: RenderSettings, role: Role, changes: &[Setting]) -> Measured {
        let Candidate { backend, name, change, flags, .. } = &self.candidates[candidate];
        Measured {
            backend: backend.clone(),
            machine: name.clone(),
            flags: flags.clone(),
            candidate,
            role,
            changes: change.iter().cloned().chain(changes.iter().map(Setting::change)).collect(),
            settings,
            seconds: Vec::new().into(),
            error: PictureError::of(std::iter::empty()),
            on_frontier: false,
            comparison: TimeComparison::NoDifference,
        }
    }

    /// The rows of a backend that are measured in any case: the default twice, no cut-offs, 3DGS, each
    /// setting alone, and each other candidate.
    fn single_rows(&self, base: usize) -> Vec<Measured> {
        let three_dgs = self.shown.with(|s| s.accuracy = Accuracy::THREE_DGS);
        let landmarks = [
            (self.shown, Role::Default),
            (self.shown, Role::Again),
            (self.tightest(), Role::Tightest),
            (three_dgs, Role::ThreeDgs),
        ];
        let backend = &self.candidates[base].backend;
        let others = (0..self.candidates.len()).filter(|&i| i != base && self.candidates[i].backend == *backend);
        let alone = alternatives(&self.shown).into_iter();
        let all = landmarks.into_iter().map(|(settings, role)| self.row(base, settings, role, &[]));
        let all = all.chain(alone.map(|s| self.row(base, s.applied_to(&self.shown), Role::Alone, &[s])));
        all.chain(others.map(|other| self.row(other, self.shown, Role::Alone, &[]))).collect()
    }

    /// Splits rows into those that their candidates can render and the others. The default has to be
    /// rendered.
    fn admitted(
        &self,
        rows: Vec<Measured>,
        views: &[S::View],
        refused: &mut Vec<Refused>,
    ) -> Result<Vec<Measured>, Error> {
        let mut admitted = Vec::with_capacity(rows.len());
        for row in rows {
            let is_default = matches!(row.role, Role::Default | Role::Again);
            let refusal = if is_default { None } else { self.refusal(row.candidate, &row.settings, views)? };
            match refusal {
                None => admitted.push(row),
                Some(why) => refused.push(Refused { backend: row.backend.clone(), what: row.name(), why }),
            }
        }
        Ok(admitted)
    }

    /// The reason why a candidate cannot render these views with these settings, if it cannot.
    pub(super) fn refusal(
        &self,
        candidate: usize,
        settings: &RenderSettings,
        views: &[S::View],
    ) -> Result<Option<String>, Error> {
        for view in views {
            match self.candidates[candidate].renderer.seconds(view, settings) {
                Err(Error::Unsupported { effect, .. }) => return Ok(Some(effect)),
                // An example is too many Gaussians at a pixel to be sorted. A lost device fails for
                // all settings, including the default.
                Err(Error::Backend { message, .. }) => return Ok(Some(message)),
                Err(error) => return Err(error),
                Ok(_) => {}
            }
        }
        Ok(None)
    }

    /// The first backend that can render these views with these settings.
    fn able(&self, settings: &RenderSettings, views: &[S::View]) -> Result<Option<usize>, Error> {
        for base in self.bases() {
            if self.refusal(base, settings, views)?.is_none() {
                return Ok(Some(base));
            }
        }
        Ok(None)
    }

    /// The reference pictures of the views. Their worst pixels are found on the first backend that
    /// can render without cut-offs.
    pub(super) fn references(&self, views: &[S::View]) -> Result<Vec<Reference<S>>, Error> {
        let (scene, settings) = (self.scene.rows(), self.tightest());
        let able = self.able(&settings, views)?.unwrap_or_default();
        let reference = |view: &S::View| {
            let tightest = self.candidates[able].renderer.image(view, &settings)?;
            Reference::new(&scene, view, &settings, tightest, views.len())
        };
        views.iter().map(reference).collect()
    }

    /// The error of a candidate's pictures.
    pub(super) fn error(
        &self,
        candidate: usize,
        settings: &RenderSettings,
        views: &[S::View],
        references: &[Reference<S>],
    ) -> Result<PictureError, Error> {
        let renderer = &self.candidates[candidate].renderer;
        let one = |(view, reference): (&S::View, &Reference<S>)| reference.error(&renderer.image(view, settings)?);
        let errors = views.iter().zip(references).map(one).collect::<Result<Vec<_>, Error>>()?;
        Ok(PictureError::of_views(&errors))
    }

    /// Seconds per view of each row, measured in turn.
    pub(super) fn times(&self, rows: &[Measured], views: &[S::View], seconds: f64) -> Result<Vec<Vec<f64>>, Error> {
        let candidate = |row: &Measured| {
            let Candidate { renderer, backend, .. } = &self.candidates[row.candidate];
            Timed { renderer: renderer.as_ref(), group: backend, settings: row.settings }
        };
        interleaved(&rows.iter().map(candidate).collect::<Vec<_>>(), views, Rounds::Within(seconds))
    }

    /// What a search is about to do with these rows, with the time of the default's second rendering,
    /// after a warm-up.
    fn announcement(&self, rows: &[Measured], views: &[S::View], limits: SearchLimits) -> Result<String, Error> {
        // Tried, and its error measured; scouted and measured in turn, with a warm-up each.
        let renderings = (2 + 2 * (1 + ROUNDS[0])) * views.len();
        let (mut settings, mut seconds) = (0, 0.0);
        for base in self.bases() {
            let Candidate { renderer, backend, .. } = &self.candidates[base];
            let own = rows.iter().filter(|row| row.backend == *backend).count() + limits.combinations;
            renderer.seconds(&views[0], &self.shown)?;
            seconds += renderer.seconds(&views[0], &self.shown)? * (own * renderings) as f64;
            settings += own;
        }
        let milliseconds = 1e3 * seconds / (settings * renderings) as f64;
        let seconds = seconds.max(limits.seconds);
        let time = if seconds < 100.0 { format!("{seconds:.0} s") } else { format!("{:.0} min", seconds / 60.0) };
        Ok(format!(
            "measuring up to {settings} settings in {} or more renderings of about {milliseconds:.1} ms: about {time}, \
             and some seconds for reference pictures",
            settings * renderings
        ))
    }

    /// The largest error of each value of each setting, the default's included, if it is the only
    /// approximation; measured on the first backend that supports it.
    fn only(&self, views: &[S::View], references: &[Reference<S>]) -> Result<Vec<(Setting, f64)>, Error> {
        let tightest = self.tightest();
        let mut all: Vec<(Setting, f64)> = Vec::new();
        for setting in alternatives(&self.shown).into_iter().flat_map(|setting| [setting.of(&self.shown), setting]) {
            let settings = setting.applied_to(&tightest);
            if all.iter().any(|(known, _)| *known == setting) {
                continue;
            }
            if let Some(able) = self.able(&settings, views)? {
                all.push((setting, self.error(able, &settings, views, references)?.max));
            }
        }
        Ok(all)
    }

    /// The combinations that are worth measuring on the quickest candidate of a backend, of which
    /// `scouted` rows have a time each.
    fn together(&self, scouted: &[(&Measured, f64)], only: &[(Setting, f64)], most: usize) -> Vec<Measured> {
        let Some(&(base, default)) = scouted.iter().find(|(row, _)| row.role == Role::Default) else {
            return Vec::new();
        };
        let error = |setting: &Setting| only.iter().find(|(known, _)| known == setting).map(|(_, error)| *error);
        let mut axes: Vec<Vec<Predicted>> = Vec::new();
        let mut last = None;
        for setting in alternatives(&self.shown) {
            let settings = setting.applied_to(&self.shown);
            let time = scouted.iter().find(|(row, _)| row.role == Role::Alone && row.settings == settings);
            // An error cannot be attributed to a setting that no backend supports alone.
            let (Some((_, time)), Some(usual), Some(error)) = (time, error(&setting.of(&self.shown)), error(&setting))
            else {
                continue;
            };
            if last.replace(setting.axis) != Some(setting.axis) {
                axes.push(vec![Predicted { settings: Vec::new(), ratio: 1.0, error: usual }]);
            }
            let alone = Predicted { settings: vec![setting], ratio: time / default, error };
            axes.last_mut().into_iter().for_each(|values| values.push(alone.clone()));
        }
        let noise = noise_of(scouted.iter().map(|(row, _)| *row));
        let mut quickest = (base.candidate, default);
        for &(row, time) in scouted.iter().filter(|(row, _)| row.candidate != base.candidate) {
            if noise.compare(time, quickest.1) == TimeComparison::Faster {
                quickest = (row.candidate, time);
            }
        }
        let found = combinations(&axes, most).into_iter().filter_map(|Predicted { settings: changes, .. }| {
            let settings = changes.iter().fold(self.shown, |settings, s| s.applied_to(&settings));
            let is_new = changes.len() > 1 || (quickest.0 != base.candidate && !changes.is_empty());
            is_new.then(|| self.row(quickest.0, settings, Role::Together, &changes))
        });
        found.collect()
    }
}

/// Measures every setting alone and the combinations that are worth it, on every backend of the
/// sweep. Reports its progress to `watch`.
///
/// # Errors
/// Those of rendering, and of the oracle for effects that it does not have; [`Error::Setting`]
/// without a view or a candidate.
pub(super) fn search<S: Verifiable>(
    sweep: &Sweep<'_, S>,
    views: &[S::View],
    limits: SearchLimits,
    watch: &mut dyn FnMut(&str),
) -> Result<Frontier, Error> {
    if views.is_empty() || sweep.candidates.is_empty() {
        return Err(Error::setting("the number of views or candidates", 0, "at least 1"));
    }
    let mut rows = Vec::new();
    for base in sweep.bases() {
        rows.extend(sweep.single_rows(base));
    }
    watch(&sweep.announcement(&rows, views, limits)?);
    watch("computing reference pictures with the 64-bit oracle");
    let references = sweep.references(views)?;
    let mut refused = Vec::new();
    let mut rows = sweep.admitted(rows, views, &mut refused)?;
    watch(&format!("scouting {} settings", rows.len()));
    let scouted = sweep.times(&rows, views, SCOUTING * limits.seconds)?;
    rows.iter_mut().zip(scouted).for_each(|(row, times)| row.seconds = times.into());
    watch("predicting which combinations are worth measuring");
    let only = sweep.only(views, &references)?;
    let mut together = Vec::new();
    for base in sweep.bases() {
        let own = rows.iter().filter(|row| row.backend == sweep.candidates[base].backend);
        let own: Vec<(&Measured, f64)> = own.map(|row| (row, median(&row.seconds.samples))).collect();
        together.extend(sweep.together(&own, &only, limits.combinations));
    }
    rows.extend(sweep.admitted(together, views, &mut refused)?);
    watch(&format!("measuring {} settings in turn", rows.len()));
    let times = sweep.times(&rows, views, (1.0 - SCOUTING) * limits.seconds)?;
    for (row, times) in rows.iter_mut().zip(times) {
        row.seconds = Times::from(times);
        row.error = sweep.error(row.candidate, &row.settings, views, &references)?;
    }
    let noise = sweep.bases().into_iter().map(|base| judge(&sweep.candidates[base].backend, &mut rows)).collect();
    let place = |row: &Measured| sweep.candidates.iter().position(|candidate| candidate.backend == row.backend);
    rows.sort_by(|a, b| place(a).cmp(&place(b)).then(a.median().total_cmp(&b.median())));
    Ok(Frontier {
        rows,
        refused,
        noise,
        views: views.len(),
        sampled: references.iter().map(Reference::sampled).sum(),
        uncertainty: references.iter().map(Reference::uncertainty).fold(0.0, f64::max),
    })
}

fn noise_of<'r>(rows: impl Iterator<Item = &'r Measured> + Clone) -> Noise {
    let of = |wanted: Role| rows.clone().find(|row| row.role == wanted).map(|row| &row.seconds.samples);
    of(Role::Default).zip(of(Role::Again)).map_or(Noise::NONE, |(first, again)| Noise::of(first, again))
}

/// Determines a backend's noise and frontier.
fn judge(backend: &str, rows: &mut [Measured]) -> BackendNoise {
    let mut own: Vec<&mut Measured> = rows.iter_mut().filter(|row| row.backend == *backend).collect();
    let noise = noise_of(own.iter().map(|row| &**row));
    let default = own.iter().find(|row| row.role == Role::Default).map_or(f64::NAN, |row| row.median());
    // The default counts once.
    let point = |row: &&mut Measured| match row.role {
        Role::Again => (f64::INFINITY, f64::INFINITY),
        _ => (row.median(), row.error.max),
    };
    // Among rows with the same picture, the one with the fewest changes is kept on the frontier.
    own.sort_by(|a, b| a.changes.len().cmp(&b.changes.len()).then(a.median().total_cmp(&b.median())));
    let on_frontier = frontier_of(&own.iter().map(point).collect::<Vec<_>>(), noise);
    for place in 0..own.len() {
        let is_same = |other: &usize| on_frontier[*other] && own[*other].error == own[place].error;
        own[place].on_frontier =
            on_frontier[place] && own[place].role != Role::Again && !(0..place).any(|other| is_same(&other));
        own[place].comparison = noise.compare(own[place].median(), default);
    }
    BackendNoise { backend: backend.to_owned(), noise }
}
