//! The search for the frontier.

use gs_core::{Accuracy, Error, Extent, RenderSettings, Scene};

use super::{
    Contender, Frontier, Measured, Noise, PictureError, Role, Setting, TimeComparison, Truth, Verifiable, alternatives,
    frontier_of,
    measure::{Candidate, ROUNDS, interleaved},
    outcome::{BackendNoise, Refused, name},
    predict::{Alone, combinations},
};

/// Share of the time for finding out which combinations are worth measuring.
const SCOUTING: f64 = 0.25;

/// A scene with the contenders that render it.
#[derive(Debug)]
pub struct Field<'a, S: Scene> {
    /// The scene.
    pub scene: &'a S,
    /// The contenders, at least one. Those of a backend are neighbours, the one that its default is
    /// measured on first.
    pub contenders: Vec<Contender<'a, S::View>>,
    /// The default settings of all backends. Their effects define the true picture.
    pub shown: RenderSettings,
}

/// Limits of a search.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct SearchLimits {
    /// Seconds for timing. At least seven rounds are measured, however long they take.
    pub seconds: f64,
    /// Largest number of combinations of settings per backend.
    pub combinations: usize,
}

gs_core::impl_with!(SearchLimits);

impl Default for SearchLimits {
    fn default() -> Self {
        Self { seconds: 24.0, combinations: 12 }
    }
}

/// A candidate with its role.
struct Entry {
    candidate: Candidate,
    role: Role,
    changes: Vec<super::Change>,
}

impl<S: Verifiable> Field<'_, S> {
    /// The default settings without cut-offs, which the true picture has.
    fn tightest(&self) -> RenderSettings {
        self.shown.with(|s| s.accuracy = Accuracy::TIGHTEST)
    }

    /// What a search is about to do, with the time of the default's second rendering, after a warm-up.
    fn announcement(&self, views: &[S::View], limits: SearchLimits) -> Result<String, Error> {
        /// Default, the default again, no cut-offs, 3DGS.
        const LANDMARKS: usize = 4;
        // Tried, and its error measured; scouted and measured in turn, with a warm-up each.
        let renderings = (2 + 2 * (1 + ROUNDS[0])) * views.len();
        let (mut settings, mut seconds) = (0, 0.0);
        for base in self.bases() {
            let Contender { renderer, backend, .. } = &self.contenders[base];
            let others = self.contenders.iter().filter(|c| c.change.is_some() && c.backend == *backend).count();
            let own = LANDMARKS + alternatives(&self.shown).len() + others + limits.combinations;
            renderer.seconds(&views[0], &self.shown)?;
            seconds += renderer.seconds(&views[0], &self.shown)? * (own * renderings) as f64;
            settings += own;
        }
        let milliseconds = 1e3 * seconds / (settings * renderings) as f64;
        let seconds = seconds.max(limits.seconds);
        let time = if seconds < 100.0 { format!("{seconds:.0} s") } else { format!("{:.0} min", seconds / 60.0) };
        Ok(format!(
            "measuring up to {settings} settings in {} or more renderings of about {milliseconds:.1} ms: about {time}, \
             and some seconds for true pictures",
            settings * renderings
        ))
    }

    /// The true pictures of the views. Their worst pixels are found on the first backend that can
    /// render without cut-offs.
    pub(super) fn truths(&self, views: &[S::View]) -> Result<Vec<Truth<S>>, Error> {
        let (scene, settings) = (self.scene.rows(), self.tightest());
        let able = self.able(&settings, views)?.unwrap_or_default();
        let truth = |view: &S::View| {
            let tightest = self.contenders[able].renderer.image(view, &settings)?;
            Truth::new(&scene, view, &settings, tightest, views.len())
        };
        views.iter().map(truth).collect()
    }

    /// The error of a candidate's pictures.
    pub(super) fn error(
        &self,
        contender: usize,
        settings: &RenderSettings,
        views: &[S::View],
        truths: &[Truth<S>],
    ) -> Result<PictureError, Error> {
        let renderer = &self.contenders[contender].renderer;
        let one = |(view, truth): (&S::View, &Truth<S>)| truth.error(&renderer.image(view, settings)?);
        let errors = views.iter().zip(truths).map(one).collect::<Result<Vec<_>, Error>>()?;
        Ok(PictureError::of_views(&errors))
    }

    /// Seconds per view of each row, measured interleaved as by [`search`].
    pub(super) fn times(&self, rows: &[&Measured], views: &[S::View], seconds: f64) -> Result<Vec<Vec<f64>>, Error> {
        let candidates: Vec<Candidate> =
            rows.iter().map(|row| Candidate { contender: row.contender, settings: row.settings }).collect();
        interleaved(&self.contenders, &candidates, views, seconds)
    }

    /// The first contender of each backend.
    fn bases(&self) -> Vec<usize> {
        let is_first = |&i: &usize| self.contenders[i].change.is_none();
        (0..self.contenders.len()).filter(is_first).collect()
    }

    fn entry(&self, contender: usize, settings: RenderSettings, role: Role, changes: &[Setting]) -> Entry {
        let own = self.contenders[contender].change.iter().cloned();
        let changes = own.chain(changes.iter().map(|setting| setting.change())).collect();
        Entry { candidate: Candidate { contender, settings }, role, changes }
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

    /// Adds an entry to `admitted` if its contender can render it, else to `refused`.
    fn admit(
        &self,
        entry: Entry,
        views: &[S::View],
        admitted: &mut Vec<Entry>,
        refused: &mut Vec<Refused>,
    ) -> Result<(), Error> {
        let Candidate { contender, settings } = &entry.candidate;
        match self.refusal(*contender, settings, views)? {
            None => admitted.push(entry),
            Some(why) => {
                let (backend, what) = (self.contenders[*contender].backend.clone(), name(entry.role, &entry.changes));
                refused.push(Refused { backend, what, why });
            }
        }
        Ok(())
    }

    /// The entries that every backend's table contains.
    fn landmarks(&self, base: usize, views: &[S::View], refused: &mut Vec<Refused>) -> Result<Vec<Entry>, Error> {
        let three_dgs = self.shown.with(|s| s.accuracy = Accuracy::THREE_DGS);
        let without_extent = Setting::Extent(Extent::AlphaCut).applied_to(&three_dgs);
        let mut all =
            vec![self.entry(base, self.shown, Role::Default, &[]), self.entry(base, self.shown, Role::Again, &[])];
        self.admit(self.entry(base, self.tightest(), Role::Tightest, &[]), views, &mut all, refused)?;
        let closest = if self.refusal(base, &three_dgs, views)?.is_none() { three_dgs } else { without_extent };
        self.admit(self.entry(base, closest, Role::ThreeDgs, &[]), views, &mut all, refused)?;
        Ok(all)
    }

    /// The reason why a contender cannot render these views with these settings, if it cannot.
    pub(super) fn refusal(
        &self,
        contender: usize,
        settings: &RenderSettings,
        views: &[S::View],
    ) -> Result<Option<String>, Error> {
        for view in views {
            match self.contenders[contender].renderer.seconds(view, settings) {
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

    /// Measures each setting alone, and each contender.
    fn alone(&self, base: usize, views: &[S::View], refused: &mut Vec<Refused>) -> Result<Vec<Entry>, Error> {
        let backend = &self.contenders[base].backend;
        let mut all = Vec::new();
        for setting in alternatives(&self.shown) {
            let entry = self.entry(base, setting.applied_to(&self.shown), Role::Alone, &[setting]);
            self.admit(entry, views, &mut all, refused)?;
        }
        for other in (0..self.contenders.len()).filter(|&i| i != base && self.contenders[i].backend == *backend) {
            self.admit(self.entry(other, self.shown, Role::Alone, &[]), views, &mut all, refused)?;
        }
        Ok(all)
    }

    /// The largest error of each value of each setting, the default's included, if it is the only
    /// approximation; measured on the first backend that supports it.
    fn only(&self, views: &[S::View], truths: &[Truth<S>]) -> Result<Vec<(Setting, f64)>, Error> {
        let tightest = self.tightest();
        let mut all: Vec<(Setting, f64)> = Vec::new();
        for setting in alternatives(&self.shown).into_iter().flat_map(|setting| [setting.of(&self.shown), setting]) {
            let settings = setting.applied_to(&tightest);
            if all.iter().any(|(known, _)| *known == setting) {
                continue;
            }
            if let Some(able) = self.able(&settings, views)? {
                all.push((setting, self.error(able, &settings, views, truths)?.max));
            }
        }
        Ok(all)
    }

    /// The combinations that are worth measuring, on the quickest contender of the backend.
    fn together(
        &self,
        base: usize,
        scouted: &[(Entry, f64)],
        noise: Noise,
        most: usize,
        only: &[(Setting, f64)],
    ) -> Vec<Entry> {
        let default = scouted.iter().find(|(entry, _)| entry.role == Role::Default).map_or(1.0, |(_, time)| *time);
        let error = |setting: Setting| only.iter().find(|(s, _)| *s == setting).map(|(_, error)| *error);
        let mut axes: Vec<(String, Vec<Alone>)> = Vec::new();
        for setting in alternatives(&self.shown) {
            let settings = setting.applied_to(&self.shown);
            let Some((_, time)) =
                scouted.iter().find(|(e, _)| e.role == Role::Alone && e.candidate.settings == settings)
            else {
                continue;
            };
            // An error cannot be attributed to a setting that no backend supports alone.
            let (Some(usual), Some(error)) = (error(setting.of(&self.shown)), error(setting)) else {
                continue;
            };
            let axis = setting.change().axis;
            if axes.last().is_none_or(|(last, _)| *last != axis) {
                axes.push((axis, vec![Alone { setting: None, ratio: 1.0, error: usual }]));
            }
            let alone = Alone { setting: Some(setting), ratio: time / default, error };
            axes.last_mut().into_iter().for_each(|(_, values)| values.push(alone));
        }
        let mut quickest = (base, default);
        for (Entry { candidate: Candidate { contender, .. }, .. }, time) in scouted {
            if self.contenders[*contender].change.is_some()
                && noise.compare(*time, quickest.1) == TimeComparison::Faster
            {
                quickest = (*contender, *time);
            }
        }
        let values: Vec<Vec<Alone>> = axes.into_iter().map(|(_, values)| values).collect();
        let found = combinations(&values, most).into_iter().filter_map(|combination| {
            let settings = combination.settings.iter().fold(self.shown, |settings, s| s.applied_to(&settings));
            let is_new = combination.settings.len() > 1 || (quickest.0 != base && !combination.settings.is_empty());
            is_new.then(|| self.entry(quickest.0, settings, Role::Together, &combination.settings))
        });
        found.collect()
    }
}

/// Measures every setting alone and the combinations that are worth it, on every backend of the
/// field. Reports its progress to `watch`.
///
/// # Errors
/// Those of rendering, and of the oracle for effects that it does not have; [`Error::Setting`]
/// without a view or a contender.
pub fn search<S: Verifiable>(
    field: &Field<'_, S>,
    views: &[S::View],
    limits: SearchLimits,
    watch: &mut dyn FnMut(&str),
) -> Result<Frontier, Error> {
    if views.is_empty() || field.contenders.is_empty() {
        return Err(Error::setting("the number of views or contenders", 0, "at least 1"));
    }
    watch(&field.announcement(views, limits)?);
    watch("computing true pictures with the 64-bit oracle");
    let truths = field.truths(views)?;
    let bases = field.bases();
    let (mut refused, mut entries, mut groups) = (Vec::new(), Vec::new(), Vec::new());
    for &base in &bases {
        let mut own = field.landmarks(base, views, &mut refused)?;
        own.extend(field.alone(base, views, &mut refused)?);
        groups.push(own.len());
        entries.extend(own);
    }
    watch(&format!("scouting {} settings", entries.len()));
    let candidates = |entries: &[Entry]| entries.iter().map(|entry| entry.candidate.clone()).collect::<Vec<_>>();
    let scouted = interleaved(&field.contenders, &candidates(&entries), views, SCOUTING * limits.seconds)?;
    watch("predicting which combinations are worth measuring");
    let only = field.only(views, &truths)?;
    let mut all = Vec::new();
    let mut scouted = entries.into_iter().zip(scouted);
    for (&base, group) in bases.iter().zip(groups) {
        let own: Vec<(Entry, Vec<f64>)> = scouted.by_ref().take(group).collect();
        let noise = noise_of(own.iter().map(|(entry, times)| (entry.role, &times[..])));
        let medians: Vec<(Entry, f64)> = own
            .into_iter()
            .map(|(entry, times)| {
                let median = crate::result::median(times);
                (entry, median)
            })
            .collect();
        let together = field.together(base, &medians, noise, limits.combinations, &only);
        all.extend(medians.into_iter().map(|(entry, _)| entry));
        for entry in together {
            field.admit(entry, views, &mut all, &mut refused)?;
        }
    }
    watch(&format!("measuring {} settings in turn", all.len()));
    let times = interleaved(&field.contenders, &candidates(&all), views, (1.0 - SCOUTING) * limits.seconds)?;
    let mut rows = Vec::with_capacity(all.len());
    for (Entry { candidate: Candidate { contender, settings }, role, changes }, seconds) in all.into_iter().zip(times) {
        let error = field.error(contender, &settings, views, &truths)?;
        let Contender { backend, name, .. } = &field.contenders[contender];
        rows.push(Measured {
            backend: backend.clone(),
            machine: name.clone(),
            contender,
            role,
            changes,
            settings,
            seconds,
            error,
            on_frontier: false,
            comparison: TimeComparison::NoDifference,
        });
    }
    let noise = judge(&mut rows);
    Ok(Frontier {
        rows,
        refused,
        noise,
        views: views.len(),
        sampled: truths.iter().map(Truth::sampled).sum(),
        uncertainty: truths.iter().map(Truth::uncertainty).fold(0.0, f64::max),
    })
}

fn noise_of<'t>(rows: impl Iterator<Item = (Role, &'t [f64])> + Clone) -> Noise {
    let of = |wanted: Role| rows.clone().find(|(role, _)| *role == wanted).map(|(_, times)| times);
    match (of(Role::Default), of(Role::Again)) {
        (Some(first), Some(again)) => Noise::of(first, again),
        _ => Noise { factor: 1.0, again: 1.0 },
    }
}

/// Sorts rows by backend and time, and determines each backend's noise and frontier.
fn judge(rows: &mut [Measured]) -> Vec<BackendNoise> {
    let mut backends: Vec<String> = Vec::new();
    for row in rows.iter() {
        if !backends.contains(&row.backend) {
            backends.push(row.backend.clone());
        }
    }
    let place = |backend: &String| backends.iter().position(|known| known == backend);
    rows.sort_by(|a, b| {
        let by_time = a.times().median.total_cmp(&b.times().median);
        place(&a.backend).cmp(&place(&b.backend)).then(by_time)
    });
    let mut all = Vec::new();
    for backend in &backends {
        let mut own: Vec<&mut Measured> = rows.iter_mut().filter(|row| row.backend == *backend).collect();
        let noise = noise_of(own.iter().map(|row| (row.role, &row.seconds[..])));
        let default = own.iter().find(|row| row.role == Role::Default).map_or(f64::NAN, |row| row.times().median);
        // The default counts once.
        let points: Vec<(f64, f64)> = own
            .iter()
            .map(|row| match row.role {
                Role::Again => (f64::INFINITY, f64::INFINITY),
                _ => (row.times().median, row.error.max),
            })
            .collect();
        for (row, on_frontier) in own.iter_mut().zip(frontier_of(&points, noise)) {
            row.on_frontier = on_frontier && row.role != Role::Again;
            row.comparison = noise.compare(row.times().median, default);
        }
        // Only the row with the fewest changes is kept on the frontier, among rows with the same
        // picture.
        for place in 0..own.len() {
            let simpler = |other: usize| {
                let (changes, others) = (own[place].changes.len(), own[other].changes.len());
                let same = own[other].on_frontier && own[other].error == own[place].error;
                same && (others < changes || (others == changes && other < place))
            };
            if (0..own.len()).any(simpler) {
                own[place].on_frontier = false;
            }
        }
        all.push(BackendNoise { backend: backend.clone(), noise });
    }
    all
}
