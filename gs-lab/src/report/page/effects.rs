//! The effects of the study's factors.

use maud::{Markup, html};

use crate::{
    error::Error,
    report::{
        html,
        page::{
            Page,
            figures::figure,
            numbers::{remark, value_cells},
            words::{at_equal, capital},
        },
    },
    result::{Effect, EffectOf, Metric},
    study::Matching,
};

impl Page<'_> {
    /// Main effects and interactions; nothing for a study without factors.
    pub(super) fn effects(&self) -> Result<Markup, Error> {
        let study = &self.results.plan.study;
        if study.factors.is_empty() {
            return Ok(Markup::default());
        }
        let mut parts = Vec::new();
        for &matching in &study.matchings {
            let drawn = match figure(self.figures, &format!("effects-at-equal-{}", matching.name())) {
                Some(figure) => html::figure(figure)?,
                None => Markup::default(),
            };
            parts.push(html! {
                h3 { (capital(at_equal(matching))) }
                div.beside { (drawn) (self.effects_table(matching)) }
            });
        }
        Ok(html! {
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
        })
    }

    fn effects_table(&self, matching: Matching) -> Markup {
        let effects = self.results.effects(&[matching]);
        let second = (matching == Matching::Count && self.has_ms_ssim()).then_some(Metric::MsSsim);
        let of = |metric: Metric| effects.iter().filter(move |effect| effect.metric == metric);
        let columns = if second.is_some() { 5 } else { 3 };
        let name = |effect: &Effect| match &effect.of {
            EffectOf::Main { factor, level, against } => format!("{factor}: {level} instead of {against}"),
            EffectOf::Interaction { .. } => effect.of.label(),
        };
        html! {
            div.wide { table.small {
                thead { tr {
                    th { "effect" } th.number { "PSNR, dB" } th { }
                    @if second.is_some() { th.number { "MS-SSIM" } th { } }
                } }
                tbody {
                    @for (index, effect) in of(Metric::Psnr).enumerate() {
                        tr.remarked[remark(&effect.remarks).is_some()] {
                            td { (self.swatch(index)) (name(effect)) }
                            (value_cells(effect.mean, effect.interval, effect.verdict, 2))
                            @if let Some(other) = second.and_then(|metric| of(metric).nth(index)) {
                                (value_cells(other.mean, other.interval, other.verdict, 4))
                            }
                        }
                        @if let Some(text) = remark(&effect.remarks) {
                            tr.remark { td.quiet colspan=(columns) { (text) } }
                        }
                    }
                }
            } }
        }
    }
}
