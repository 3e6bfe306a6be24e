//! The figures and pictures of the page.

use maud::{Markup, html};

use crate::report::{
    html,
    page::{Page, words::gaussians},
    pictures::FULL_SCALE,
};

impl Page<'_> {
    /// The figure of that name; nothing where there is none.
    pub(super) fn figure(&self, name: &str) -> Markup {
        self.figures.iter().find(|figure| figure.name == name).map_or_else(Markup::default, html::figure)
    }

    pub(super) fn curves(&self) -> Markup {
        let is_curve = |name: &str| !["differences", "effects"].iter().any(|start| name.starts_with(start));
        let curves = self.figures.iter().filter(|figure| is_curve(&figure.name));
        html! {
            section {
                h2 { "Curves" }
                p {
                    "Lines are means over " (self.targets()) " and seeds; bands go from the lowest to the highest seed, each a mean over the "
                    (self.targets()) ". "
                    "Files in SVG are in " code { "plots/" } "."
                }
                div.figures { @for figure in curves { (html::figure(figure)) } }
            }
        }
    }

    pub(super) fn pictures(&self) -> Markup {
        let side =
            |window: [u32; 4]| format!("{}×{} px at column {}, row {}", window[2], window[3], window[0], window[1]);
        html! {
            section {
                h2 { "Pictures" }
                p {
                    "At most " (gaussians(self.pictured)) ", seed " (self.results.plan.study.seeds[0]) ": the window of each "
                    @if self.results.plan.study.is_of_scenes() { "of a few held-out views" } @else { "image" }
                    " in which the arms differ most, and below it the largest absolute error of a channel, from black (0) to pale yellow ("
                    (FULL_SCALE) " of full scale and more). PSNR is that of the whole picture. If there is no room for all, the first are shown."
                }
                @for multiples in self.multiples {
                    h3 { (multiples.title) " " span.quiet { (side(multiples.window)) } }
                    div.multiples {
                        figure {
                            img src=(multiples.target) alt={ (multiples.title) ", the image itself" };
                            figcaption { "image" }
                        }
                        @for multiple in &multiples.arms {
                            @let name = &self.results.plan.study.arms[multiple.arm].name;
                            figure {
                                img src=(multiple.reconstruction) alt={ (multiples.title) " by " (name) };
                                img src=(multiple.error_map) alt={ "error of " (name) };
                                figcaption { (self.swatch(multiple.arm)) (name) br; span.quiet { (format!("{:.2} dB", multiple.psnr)) } }
                            }
                        }
                    }
                }
            }
        }
    }
}
