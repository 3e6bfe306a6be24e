//! The search for the frontier.

use gs_core::{Accuracy, Error, Image, RenderSettings, duration};

use super::{
    super::{
        machine::Candidate,
        noise::{Noise, TimeComparison},
        picture_error::PictureError,
        timing::{ROUNDS, Rounds, Timed, Times, interleaved},
    },
    outcome::{BackendNoise, Frontier, Measured, Refused, Role},
    pareto::frontier_of,
    setting::{Setting, alternatives},
};

/// The candidates that render a scene.
#[derive(Debug)]
pub(crate) struct Sweep<'a, V> {
    /// The candidates, at least one. Those of a backend are neighbours, the one that its default is
    /// measured on first.
    pub(super) candidates: Vec<Candidate<'a, V>>,
    /// The default settings of all backends. Their effects define the reference picture.
    pub(super) shown: RenderSettings,
}

impl<V> Sweep<'_, V> {
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
    fn row(&self, candidate: usize, settings: RenderSettings, role: Role, setting: Option<&Setting>) -> Measured {
        let Candidate { backend, name, change, .. } = &self.candidates[candidate];
        Measured {
            backend: backend.clone(),
            machine: name.clone(),
            candidate,
            role,
            change: setting.map(Setting::change).or_else(|| change.clone()),
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
        let all = landmarks.into_iter().map(|(settings, role)| self.row(base, settings, role, None));
        let all = all.chain(alone.map(|s| self.row(base, s.applied_to(&self.shown), Role::Alone, Some(&s))));
        all.chain(others.map(|other| self.row(other, self.shown, Role::Alone, None))).collect()
    }

    /// Splits rows into those that their candidates can render and the others. The default has to be
    /// rendered.
    fn admitted(&self, rows: Vec<Measured>, views: &[V], refused: &mut Vec<Refused>) -> Result<Vec<Measured>, Error> {
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
    fn refusal(&self, candidate: usize, settings: &RenderSettings, views: &[V]) -> Result<Option<String>, Error> {
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
    fn able(&self, settings: &RenderSettings, views: &[V]) -> Result<Option<usize>, Error> {
        for base in self.bases() {
            if self.refusal(base, settings, views)?.is_none() {
                return Ok(Some(base));
            }
        }
        Ok(None)
    }

    /// The reference pictures of the views, and the backend that renders them: the first that can
    /// render without cut-offs.
    fn references(&self, views: &[V]) -> Result<(String, Vec<Image>), Error> {
        let settings = self.tightest();
        let Candidate { backend, renderer, .. } = &self.candidates[self.able(&settings, views)?.unwrap_or_default()];
        let images = views.iter().map(|view| renderer.image(view, &settings)).collect::<Result<_, _>>()?;
        Ok((backend.clone(), images))
    }

    /// The error of a candidate's pictures.
    fn error(
        &self,
        candidate: usize,
        settings: &RenderSettings,
        views: &[V],
        references: &[Image],
    ) -> Result<PictureError, Error> {
        let renderer = &self.candidates[candidate].renderer;
        let one = |(view, reference)| PictureError::between(&renderer.image(view, settings)?, reference);
        let errors = views.iter().zip(references).map(one).collect::<Result<Vec<_>, Error>>()?;
        Ok(PictureError::of_views(&errors))
    }

    /// Seconds per view of each row, measured in turn.
    fn times(&self, rows: &[Measured], views: &[V], seconds: f64) -> Result<Vec<Vec<f64>>, Error> {
        let candidate = |row: &Measured| {
            let Candidate { renderer, backend, .. } = &self.candidates[row.candidate];
            Timed { renderer: renderer.as_ref(), group: backend, settings: row.settings }
        };
        interleaved(&rows.iter().map(candidate).collect::<Vec<_>>(), views, Rounds::Within(seconds))
    }

    /// What a search is about to do with these rows, with the time of the default's second rendering,
    /// after a warm-up.
    fn announcement(&self, rows: &[Measured], views: &[V], least: f64) -> Result<String, Error> {
        // Tried, and its error measured; measured in turn, with a warm-up.
        let renderings = (2 + 1 + ROUNDS[0]) * views.len();
        let (settings, mut seconds) = (rows.len(), 0.0);
        for base in self.bases() {
            let Candidate { renderer, backend, .. } = &self.candidates[base];
            let own = rows.iter().filter(|row| row.backend == *backend).count();
            renderer.seconds(&views[0], &self.shown)?;
            seconds += renderer.seconds(&views[0], &self.shown)? * (own * renderings) as f64;
        }
        let milliseconds = 1e3 * seconds / (settings * renderings) as f64;
        let seconds = seconds.max(least);
        Ok(format!(
            "measuring {settings} settings in {} or more renderings of about {milliseconds:.1} ms: about {}, \
             and some seconds to compare their pictures with the reference",
            settings * renderings,
            duration(seconds)
        ))
    }
}

/// Measures every setting alone, on every backend of the sweep, and times them for `seconds`; at least
/// seven rounds are measured, however long they take. Reports its progress to `watch`.
///
/// # Errors
/// Those of rendering; [`Error::Setting`] without a view or a candidate.
pub(super) fn search<V>(
    sweep: &Sweep<'_, V>,
    views: &[V],
    seconds: f64,
    watch: &mut dyn FnMut(&str),
) -> Result<Frontier, Error> {
    if views.is_empty() || sweep.candidates.is_empty() {
        return Err(Error::setting("the number of views or candidates", 0, "at least 1"));
    }
    let mut rows = Vec::new();
    for base in sweep.bases() {
        rows.extend(sweep.single_rows(base));
    }
    watch(&sweep.announcement(&rows, views, seconds)?);
    let (reference, references) = sweep.references(views)?;
    let mut refused = Vec::new();
    let mut rows = sweep.admitted(rows, views, &mut refused)?;
    watch(&format!("measuring {} settings in turn", rows.len()));
    let times = sweep.times(&rows, views, seconds)?;
    for (row, times) in rows.iter_mut().zip(times) {
        row.seconds = Times::from(times);
        row.error = sweep.error(row.candidate, &row.settings, views, &references)?;
    }
    let noise = sweep.bases().into_iter().map(|base| judge(&sweep.candidates[base].backend, &mut rows)).collect();
    let place = |row: &Measured| sweep.candidates.iter().position(|candidate| candidate.backend == row.backend);
    rows.sort_by(|a, b| place(a).cmp(&place(b)).then(a.median().total_cmp(&b.median())));
    Ok(Frontier { rows, refused, noise, reference, views: views.len() })
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
    // Among rows with the same picture, one without a change is kept on the frontier.
    own.sort_by(|a, b| a.change.is_some().cmp(&b.change.is_some()).then(a.median().total_cmp(&b.median())));
    let on_frontier = frontier_of(&own.iter().map(point).collect::<Vec<_>>(), noise);
    for place in 0..own.len() {
        let is_same = |other: &usize| on_frontier[*other] && own[*other].error == own[place].error;
        own[place].on_frontier =
            on_frontier[place] && own[place].role != Role::Again && !(0..place).any(|other| is_same(&other));
        own[place].comparison = noise.compare(own[place].median(), default);
    }
    BackendNoise { backend: backend.to_owned(), noise }
}
