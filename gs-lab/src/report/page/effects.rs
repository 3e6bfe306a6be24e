//! The effects of the study's factors.

use maud::{Markup, html};

use crate::{
    report::page::{
        Page,
        numbers::{remark, table},
        words::{at_equal, capital},
    },
    result::{Effect, EffectOf, Metric},
    study::Matching,
};

impl Page<'_> {
    /// Main effects and interactions; nothing for a study without factors.
    pub(super) fn effects(&self) -> Markup {
        let study = &self.results.plan.study;
        if study.factors.is_empty() {
            return Markup::default();
        }
        let mut parts = Vec::new();
        for &matching in &study.matchings {
            let drawn = self.figure(&format!("effects-at-equal-{}", matching.name()));
            parts.push(html! {
                h3 { (capital(at_equal(matching))) }
                div.beside { (drawn) (self.effects_table(matching)) }
            });
        }
        html! {
            section {
                h2 { "Effects of the factors" }
                p {
                    "A main effect is what a level of a factor adds to its first level, on average over the other factors. An interaction, marked ×, "
                    "is by how much that is more at a level of another factor than at its first level: if its interval contains 0, the two factors "
                    "may be chosen one by one. Below each effect is its 95 % interval."
                }
                ul { @for factor in &study.factors {
                    li { b { (factor.name) } " " (factor.about) " First level: " b { (factor.levels[0].name) } "." }
                } }
                @for part in parts { (part) }
            }
        }
    }

    fn effects_table(&self, matching: Matching) -> Markup {
        let effects = self.results.effects(&[matching]);
        let second = self.second_metric(matching);
        let of = |metric: Metric| effects.iter().filter(move |effect| effect.metric == metric).cloned();
        let name = |effect: &Effect| match &effect.of {
            EffectOf::Main { factor, level, against } => format!("{factor}: {level} instead of {against}"),
            EffectOf::Interaction { .. } => effect.of.label(),
        };
        let rows = of(Metric::Psnr).enumerate().map(|(index, effect)| {
            let name = html! { td { (self.swatch(index)) (name(&effect)) } };
            (name, remark(&effect.remarks), effect, second.and_then(|metric| of(metric).nth(index)))
        });
        table(&["effect"], second, rows)
    }
}
