//! The schedule of effects as settings of earlier versions name it.
//!
//! Effects follow the clock: antialiasing is there from the first step, and SH grow by a degree every
//! [`sh_degree_every`](crate::TrainSettings::sh_degree_every) steps. Earlier versions could also switch effects on when the scene
//! required them, and wrote which of the two they did as `joining`.

use serde::{Deserialize, Deserializer, de::Error};

/// Reads `joining`: the clock is what there is, anything else is refused.
pub(crate) fn by_the_clock<'de, D: Deserializer<'de>>(deserializer: D) -> Result<(), D::Error> {
    #[derive(Deserialize)]
    #[serde(rename_all = "kebab-case")]
    enum Written {
        Scheduled,
        WhenCalledFor(serde::de::IgnoredAny),
    }
    match Written::deserialize(deserializer)? {
        Written::Scheduled => Ok(()),
        Written::WhenCalledFor(_) => Err(D::Error::custom(
            "`joining = when-called-for` is no longer possible: effects that wait until the scene requires them were measured to gain \
             nothing. Effects follow the clock (`sh-degree-every`); remove `joining`",
        )),
    }
}

#[cfg(test)]
mod tests {
    use crate::{FitSettings, TrainSettings};

    #[test]
    fn the_schedule_of_earlier_versions_is_read_and_effects_on_demand_are_refused() {
        let clock = "joining = \"scheduled\"\n";
        assert_eq!(toml::from_str::<FitSettings>(clock).unwrap(), FitSettings::default());
        assert_eq!(toml::from_str::<TrainSettings>(clock).unwrap(), TrainSettings::default());
        assert!(!toml::to_string(&FitSettings::default()).unwrap().contains("joining"));
        let demand = "[joining.when-called-for]\nevery = 100\nnarrow = 0.01\nview-dependence = 0.25\n";
        let messages = [
            toml::from_str::<FitSettings>(demand).unwrap_err().to_string(),
            toml::from_str::<TrainSettings>(demand).unwrap_err().to_string(),
        ];
        for message in messages {
            assert!(message.contains("no longer possible") && message.contains("sh-degree-every"), "{message}");
        }
    }
}
