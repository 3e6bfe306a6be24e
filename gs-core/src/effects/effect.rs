//! The effects one by one: their names, their values as words, and the next cheaper value.

use std::fmt;

use super::{Antialias, Background, Blend, Effects, Order};

crate::choices! {
    /// An effect that a scene may require. Statistics are not among them: they are a matter of
    /// training.
    #[derive(PartialOrd, Ord)]
    pub enum Effect {
        /// [`Effects::order`].
        Order = "order",
        /// [`Effects::blend`].
        Blend = "blend",
        /// [`Effects::sh_degree`].
        ShDegree = "sh-degree",
        /// [`Effects::antialias`].
        Antialias = "antialias",
        /// [`Effects::background`].
        Background = "background",
    }
}

/// The SH degrees as words.
const DEGREES: [&str; 4] = ["0", "1", "2", "3"];

impl Effect {
    /// The effects that can be left out of a rendering. Without its blending, a scene is another one.
    pub const OPTIONAL: [Self; 4] = [Self::Order, Self::ShDegree, Self::Antialias, Self::Background];

    /// The effect's value in `effects`, as a word.
    pub fn value(self, effects: &Effects) -> &'static str {
        match self {
            Self::Order => effects.order.name(),
            Self::Blend => effects.blend.name(),
            Self::ShDegree => DEGREES.get(usize::from(effects.sh_degree)).copied().unwrap_or("beyond 3"),
            Self::Antialias => effects.antialias.name(),
            Self::Background => effects.background.name(),
        }
    }

    /// Returns `effects` with each value of this effect, the cheapest first; SH degrees up to that of
    /// `effects`.
    pub fn values(self, effects: &Effects) -> Vec<Effects> {
        match self {
            Self::Order => Order::ALL.map(|order| Effects { order, ..*effects }).to_vec(),
            Self::Blend => Blend::ALL.map(|blend| Effects { blend, ..*effects }).to_vec(),
            Self::ShDegree => (0..=effects.sh_degree).map(|sh_degree| Effects { sh_degree, ..*effects }).collect(),
            Self::Antialias => Antialias::ALL.map(|antialias| Effects { antialias, ..*effects }).to_vec(),
            Self::Background => Background::ALL.map(|background| Effects { background, ..*effects }).to_vec(),
        }
    }

    /// Returns `effects` with this effect a step cheaper; `None` where it is off. All kinds of
    /// antialiasing cost the same, so a step from any of them is to none.
    pub fn cheaper(self, effects: &Effects) -> Option<Effects> {
        let values = self.values(effects);
        let below = values.iter().position(|value| value == effects)?.checked_sub(1)?;
        Some(values[if self == Self::Antialias { 0 } else { below }])
    }

    /// Returns `effects` with this effect off.
    pub fn off(self, effects: &Effects) -> Effects {
        let mut left = *effects;
        while let Some(cheaper) = self.cheaper(&left) {
            left = cheaper;
        }
        left
    }

    /// Returns `effects` with this effect's value taken from `source`.
    pub fn copied(self, source: &Effects, effects: &Effects) -> Effects {
        let mut copy = *effects;
        match self {
            Self::Order => copy.order = source.order,
            Self::Blend => copy.blend = source.blend,
            Self::ShDegree => copy.sh_degree = source.sh_degree,
            Self::Antialias => copy.antialias = source.antialias,
            Self::Background => copy.background = source.background,
        }
        copy
    }
}

impl fmt::Display for Effects {
    /// The blending and the effects that are on: "blend over, antialias dilate".
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let is_shown = |effect: &Effect| *effect == Effect::Blend || effect.cheaper(self).is_some();
        let shown = Effect::ALL.into_iter().filter(is_shown).map(|effect| format!("{effect} {}", effect.value(self)));
        f.write_str(&shown.collect::<Vec<_>>().join(", "))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_effect_goes_down_to_off_step_by_step() {
        let all = Effects {
            order: Order::PerPixel,
            blend: Blend::Over,
            sh_degree: 3,
            antialias: Antialias::Mip,
            background: Background::Solid,
            ..Effects::default()
        };
        for (effect, steps) in Effect::ALL.into_iter().zip([2, 1, 3, 1, 1]) {
            let down: Vec<Effects> =
                std::iter::successors(Some(all), |effects| effect.cheaper(effects)).skip(1).collect();
            assert_eq!(down.len(), steps, "{effect}");
            assert_eq!(down.last(), Some(&effect.off(&all)));
            assert_eq!(effect.copied(&all, &effect.off(&all)), all);
            let values: Vec<&str> = down.iter().map(|effects| effect.value(effects)).collect();
            assert!(!values.contains(&effect.value(&all)), "{effect}: {values:?}");
            // In the words of settings files.
            let in_a_file = serde_json::to_value(all).unwrap()[effect.name()].clone();
            assert_eq!(in_a_file.to_string().trim_matches('"'), effect.value(&all));
        }
        assert_eq!(all.to_string(), "order per-pixel, blend over, sh-degree 3, antialias mip, background solid");
        assert_eq!(Effects::default().to_string(), "blend over");
    }
}
