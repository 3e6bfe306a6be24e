//! Claims of a study file: statements, each with conditions on the study's runs and the numbers
//! behind them. [`Results::claims`](crate::Results::claims) judges them.

use serde::{Deserialize, Serialize};

use super::{
    column::{Column, Measure},
    definition::Study,
};
use crate::{error::Error, synthetic::SyntheticTarget};

/// A statement that the runs of a study confirm, refute, or confirm in part.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub(crate) struct StatedClaim {
    /// Short name, in kebab-case, unique within the study.
    pub(crate) name: String,
    /// What is claimed, one sentence.
    pub(crate) statement: String,
    /// Where it is claimed, such as a section of a paper.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub(crate) section: String,
    /// The conditions that the verdict follows from: confirmed if all hold in all cases, refuted if
    /// none holds in any.
    pub(crate) circumstances: Vec<Quantity>,
    /// The numbers that are shown beside the verdict.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(crate) numbers: Vec<Quantity>,
    /// What a reader must know besides the numbers.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub(crate) note: String,
}

/// A number of each case (budget, image and seed), how cases are put together, and in a condition
/// the bounds within which it holds.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub(crate) struct Quantity {
    /// The condition, or the number, in words.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub(crate) what: String,
    /// The arm or the choice whose runs are looked at.
    pub(crate) arm: String,
    /// The column of its runs.
    pub(crate) of: Column,
    /// The share of the steps after which the column is read, 0 to 1; by default the end.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) at: Option<f64>,
    /// What is subtracted.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) less: Option<Other>,
    /// What is divided by.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) over: Option<Other>,
    /// The images that are looked at; by default all.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(crate) images: Vec<String>,
    /// Which cases belong together.
    #[serde(default, skip_serializing_if = "is_default")]
    pub(crate) per: Per,
    /// How cases that belong together are put together.
    #[serde(default, skip_serializing_if = "is_default")]
    pub(crate) join: Join,
    /// How a number is taken from what is then left.
    #[serde(default, skip_serializing_if = "is_default")]
    pub(crate) take: Join,
    /// Holds from this value on.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) at_least: Option<f64>,
    /// Holds up to this value.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) at_most: Option<f64>,
    /// Holds above this value.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) above: Option<f64>,
    /// Holds below this value.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) below: Option<f64>,
    /// Further conditions that must hold in the same case.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(crate) and: Vec<Quantity>,
    /// Conditions without which a case does not count.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(crate) given: Vec<Quantity>,
    /// The unit of a number, such as "dB".
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub(crate) unit: String,
}

/// What a quantity is compared with in the same case. What is left out is as in the quantity.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub(crate) struct Other {
    /// The arms or choices; of several, the one with the highest value.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(crate) arms: Vec<String>,
    /// The column.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) of: Option<Column>,
    /// The share of the steps.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) at: Option<f64>,
}

/// Which cases belong together. Those of several budgets never do, but for the whole study.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Per {
    /// Each case stands for itself.
    #[default]
    Run,
    /// Those of an image, from all seeds.
    Image,
    /// Those of a seed, on all images.
    Seed,
    /// All.
    Study,
}

/// How values become one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Join {
    /// Their mean.
    #[default]
    Mean,
    /// Their median.
    Median,
    /// The lowest.
    Lowest,
    /// The highest.
    Highest,
    /// Their sum.
    Sum,
    /// The 95 % interval of their mean, which holds if all of it does; a number has its ends beside
    /// the mean.
    Interval,
    /// A condition holds if it does for every value.
    Every,
    /// A condition holds if it does for some value.
    Some,
}

/// An arm that is chosen in each case: the last one in a list whose run meets a bound.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub(crate) struct Choice {
    /// The name by which claims call it.
    pub(crate) name: String,
    /// The arms, in their order.
    pub(crate) among: Vec<String>,
    /// The column that must meet the bound.
    pub(crate) of: Column,
    /// The bound.
    pub(crate) at_least: f64,
    /// The image on which arms are looked at, with the same budget and seed; by default the case's
    /// own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) image: Option<String>,
}

fn is_default<T: Default + PartialEq>(value: &T) -> bool {
    *value == T::default()
}

impl Quantity {
    /// Whether it bounds its value.
    fn is_bounded(&self) -> bool {
        [self.at_least, self.at_most, self.above, self.below].iter().any(Option::is_some)
    }

    /// Whether a value lies within the bounds; NaN does not.
    pub(crate) fn allows(&self, value: f64) -> bool {
        !value.is_nan()
            && self.at_least.is_none_or(|least| value >= least)
            && self.at_most.is_none_or(|most| value <= most)
            && self.above.is_none_or(|bound| value > bound)
            && self.below.is_none_or(|bound| value < bound)
    }

    fn others(&self) -> impl Iterator<Item = &Other> {
        self.less.iter().chain(&self.over)
    }

    fn conditions(&self) -> impl Iterator<Item = &Self> {
        self.and.iter().chain(&self.given)
    }

    /// Whether a study has everything that the quantity and its conditions name.
    fn is_within(&self, study: &Study) -> bool {
        let arms = std::iter::once(&self.arm).chain(self.others().flat_map(|other| &other.arms));
        let images = self.images.is_empty() || self.images.iter().any(|image| study.target_names().contains(image));
        images
            && arms.into_iter().all(|arm| study.has_arm_or_choice(arm))
            && self.conditions().all(|q| q.is_within(study))
    }

    /// Leaves out the images that a study does not have.
    fn restrict(&mut self, study: &[String]) {
        self.images.retain(|image| study.contains(image));
        self.and.iter_mut().chain(&mut self.given).for_each(|quantity| quantity.restrict(study));
    }
}

impl Study {
    fn has_arm_or_choice(&self, name: &str) -> bool {
        self.arms.iter().any(|arm| arm.name == name) || self.choices.iter().any(|choice| choice.name == name)
    }

    /// Leaves out the choices and claims about arms and images that a part of a study does not have.
    pub(super) fn drop_claims_of_others(&mut self) {
        let (arms, targets) = (&self.arms, self.target_names().to_vec());
        let has_all = |choice: &Choice| {
            choice.among.iter().all(|name| arms.iter().any(|arm| arm.name == *name))
                && choice.image.as_ref().is_none_or(|image| targets.contains(image))
        };
        self.choices.retain(has_all);
        let mut claims = std::mem::take(&mut self.claims);
        claims
            .retain(|claim| claim.circumstances.iter().chain(&claim.numbers).all(|quantity| quantity.is_within(self)));
        for quantity in claims.iter_mut().flat_map(|claim| claim.circumstances.iter_mut().chain(&mut claim.numbers)) {
            quantity.restrict(&targets);
        }
        self.claims = claims;
    }

    /// Fails where a claim or a choice names what the study does not have, or says nothing.
    pub(super) fn validate_claims(&self) -> Result<(), Error> {
        if self.is_of_scenes() && !(self.measure.is_empty() && self.claims.is_empty() && self.choices.is_empty()) {
            return Err(self.wrong("claims, choices and measure are for studies of images", "leave them out"));
        }
        let has_shapes = |image: &str| SyntheticTarget::named(image).is_some_and(|t| t.has_the_papers_shapes());
        if let Some(image) =
            self.images.iter().find(|image| self.measure.contains(&Measure::Shapes) && !has_shapes(image))
        {
            let what = format!("measure: `{image}` does not have the paper's shapes");
            return Err(self.wrong(what, "leave \"shapes\" out, or name paper and its variations of 128 px only"));
        }
        for choice in &self.choices {
            let place = Place { study: self, words: format!("choice `{}`", choice.name) };
            if self.arms.iter().any(|arm| arm.name == choice.name) {
                return Err(place.wrong("name", "an arm has this name, too", "choose another"));
            }
            place.listed("among", choice.among.iter(), self.arms.iter().map(|arm| &arm.name))?;
            place.listed("image", &choice.image, self.images.iter())?;
            place.column("of", choice.of, None)?;
        }
        let names: Vec<&String> = self.claims.iter().map(|claim| &claim.name).collect();
        self.unrepeated("claim", &names)?;
        self.unrepeated("choice", &self.choices.iter().map(|choice| &choice.name).collect::<Vec<_>>())?;
        for claim in &self.claims {
            let place = |key: &str| Place { study: self, words: format!("claim `{}`: {key}", claim.name) };
            if claim.circumstances.is_empty() {
                let hint = "list at least one condition that the verdict follows from";
                return Err(place("circumstances").wrong("", "there are none", hint));
            }
            for (n, condition) in claim.circumstances.iter().enumerate() {
                place(&format!("circumstances.{n}")).condition(condition)?;
            }
            for (n, number) in claim.numbers.iter().enumerate() {
                place(&format!("numbers.{n}")).number(number)?;
            }
        }
        Ok(())
    }
}

/// Where in the study file a quantity stands, for errors.
struct Place<'a> {
    study: &'a Study,
    words: String,
}

impl Place<'_> {
    fn wrong(&self, key: &str, what: impl std::fmt::Display, hint: &'static str) -> Error {
        let key = if key.is_empty() { String::new() } else { format!(".{key}") };
        self.study.wrong(format!("{}{key}: {what}", self.words), hint)
    }

    /// Fails where a name is not among those that are known.
    fn listed<'n>(
        &self,
        key: &str,
        names: impl IntoIterator<Item = &'n String>,
        known: impl Iterator<Item = &'n String>,
    ) -> Result<(), Error> {
        let known: Vec<&str> = known.map(String::as_str).collect();
        match names.into_iter().find(|name| !known.contains(&name.as_str())) {
            Some(unknown) => Err(self.wrong(
                key,
                format_args!("there is no `{unknown}`: it has {}", known.join(", ")),
                "name one of these",
            )),
            None => Ok(()),
        }
    }

    fn column(&self, key: &str, column: Column, at: Option<f64>) -> Result<(), Error> {
        if at.is_some_and(|at| !(0.0..=1.0).contains(&at)) {
            return Err(self.wrong("at", "is a share of the steps", "choose it from 0 to 1"));
        }
        if at.is_some() && !column.has_course() {
            let what = format_args!("`{column}` is known at the end only");
            return Err(self.wrong("at", what, "leave `at` out, or choose gaussians, psnr, loss or ln-loss"));
        }
        match column.measure().filter(|measure| !self.study.measure.contains(measure)) {
            Some(Measure::Start) => {
                Err(self.wrong(key, format_args!("`{column}` is not measured"), "add measure = [\"start\"]"))
            }
            Some(Measure::Shapes) => {
                Err(self.wrong(key, format_args!("`{column}` is not measured"), "add measure = [\"shapes\"]"))
            }
            None => Ok(()),
        }
    }

    fn quantity(&self, quantity: &Quantity) -> Result<(), Error> {
        let known =
            || self.study.arms.iter().map(|arm| &arm.name).chain(self.study.choices.iter().map(|choice| &choice.name));
        self.listed("arm", [&quantity.arm], known())?;
        self.listed("images", &quantity.images, self.study.images.iter())?;
        self.column("of", quantity.of, quantity.at)?;
        for other in quantity.others() {
            self.listed("arms", &other.arms, known())?;
            self.column("of", other.of.unwrap_or(quantity.of), other.at.or(quantity.at))?;
        }
        Ok(())
    }

    fn condition(&self, quantity: &Quantity) -> Result<(), Error> {
        self.quantity(quantity)?;
        if !quantity.is_bounded() {
            let hint = "add at-least, at-most, above or below";
            return Err(self.wrong("", "has no bound, so that it always holds", hint));
        }
        quantity.conditions().try_for_each(|condition| self.condition(condition))
    }

    fn number(&self, quantity: &Quantity) -> Result<(), Error> {
        self.quantity(quantity)?;
        let is_of_conditions = |join: Join| matches!(join, Join::Every | Join::Some);
        if quantity.is_bounded() || is_of_conditions(quantity.join) || is_of_conditions(quantity.take) {
            return Err(self.wrong("", "is a number, which has no bounds", "list it under circumstances"));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STUDY: &str = "name = 'x'\nimages = ['paper']\nbudgets = [10]\nseeds = [0]\n[[arm]]\nname = 'a'\n[[arm]]\nname = 'b'\n\
                         [[choice]]\nname = 'last'\namong = ['a', 'b']\nof = 'gaussians'\nat-least = 10\n\
                         [[claim]]\nname = 'c'\nstatement = 's'\ncircumstances = [{ arm = 'a', of = 'psnr', above = 3 }]\n\
                         numbers = [{ what = 'n', arm = 'last', of = 'psnr' }]\n";

    #[test]
    fn an_unusable_claim_is_refused_with_its_place_and_valid_names() {
        assert!(Study::from_toml(STUDY, "x.toml").is_ok());
        for (from, to, expected) in [
            (
                "arm = 'a', of",
                "arm = 'd', of",
                "study `x`: claim `c`: circumstances.0.arm: there is no `d`: it has a, b, last",
            ),
            (
                "of = 'psnr', above",
                "of = 'psn', above",
                "x.toml: line 17: unknown name `psn` in [claim.circumstances]: did you mean `psnr`?",
            ),
            ("above = 3", "over-all = 3", "unknown key `over-all`"),
            ("above = 3", "at = 0.5", "circumstances.0: has no bound"),
            ("above = 3", "at = 2, above = 3", "circumstances.0.at: is a share of the steps"),
            ("of = 'psnr', above", "of = 'ssim', at = 0.5, above", "`ssim` is known at the end only"),
            (
                "of = 'psnr', above",
                "of = 'start-pull', above",
                "`start-pull` is not measured: add measure = [\"start\"]",
            ),
            ("above = 3", "images = ['p'], above = 3", "circumstances.0.images: there is no `p`: it has paper"),
            ("above = 3", "less = { arms = ['z'] }, above = 3", "there is no `z`: it has a, b, last"),
            ("[{ arm = 'a', of = 'psnr', above = 3 }]", "[]", "claim `c`: circumstances: there are none"),
            ("arm = 'last', of = 'psnr'", "arm = 'last', of = 'psnr', below = 3", "numbers.0: is a number"),
            ("among = ['a', 'b']", "among = ['a', 'd']", "study `x`: choice `last`.among: there is no `d`"),
            ("name = 'last'", "name = 'a'", "choice `a`.name: an arm has this name"),
            ("seeds = [0]", "seeds = [0]\nmeasure = ['end']", "unknown name `end`"),
            ("['paper']", "['paper-64px']\nmeasure = ['shapes']", "`paper-64px` does not have the paper's shapes"),
        ] {
            let text = STUDY.replace(from, to);
            let message = Study::from_toml(&text, "x.toml").unwrap_err().to_string();
            assert!(message.contains(expected), "{to}: {message}");
        }
    }

    #[test]
    fn a_bound_is_as_its_name_says_and_nothing_meets_none() {
        let study = Study::from_toml(STUDY, "x.toml").unwrap();
        let of = |bounds: &str| Quantity {
            above: None,
            ..toml::from_str::<Quantity>(&format!("arm = 'a'\nof = 'psnr'\n{bounds}")).unwrap()
        };
        let above = &study.claims[0].circumstances[0];
        assert_eq!(
            [2.0, 3.0, 4.0, f64::INFINITY, f64::NAN].map(|v| above.allows(v)),
            [false, false, true, true, false]
        );
        let between = of("at-least = 1\nat-most = 2");
        assert_eq!([0.9, 1.0, 2.0, 2.1].map(|v| between.allows(v)), [false, true, true, false]);
        assert_eq!([-1.0, 0.0].map(|v| of("below = 0").allows(v)), [true, false]);
    }
}
