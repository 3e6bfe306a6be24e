//! Names, settings files and ranges of all policies.

use super::*;

/// The names that are kinds in settings files: all but those of a [`Grow`] with other settings.
fn kinds() -> impl Iterator<Item = &'static str> {
    let of_grow = ["absolute", "percentile", "paper"];
    of_grow.into_iter().chain(OTHERS.iter().map(|named| named.name))
}

#[test]
fn names_come_back_from_settings_files_and_the_error_lists_them() {
    let message = Policy::from_name("absolut").unwrap_err().to_string();
    assert!(message.contains("`absolut`"), "{message}");
    for name in Policy::NAMES {
        let policy = Policy::from_name(name).unwrap();
        assert_eq!(policy.name(), name);
        assert_eq!(toml::from_str::<Policy>(&toml::to_string(&policy).unwrap()).unwrap(), policy);
        policy.validate().unwrap();
        assert!(message.contains(name), "{message}");
    }
    for kind in kinds() {
        let read = toml::from_str::<Policy>(&format!("kind = '{kind}'")).unwrap();
        assert_eq!(read, Policy::from_name(kind).unwrap());
    }
}

#[test]
fn a_threshold_that_is_not_given_is_that_of_the_signal() {
    for (signal, name, threshold) in [
        ("mean-gradient", "absolute", 2e-4),
        ("absolute-gradient", "abs-gs", 4e-4),
        ("pixel-gradient", "pixel-gs", 2e-4),
        ("pixel-error", "absolute-error", 0.1),
    ] {
        let read = |kind| toml::from_str::<Policy>(&format!("kind = '{kind}'\nsignal = '{signal}'")).unwrap();
        let Policy::Grow(absolute) = read("absolute") else { panic!("another kind") };
        assert_eq!(absolute.threshold, threshold);
        assert_eq!(read("absolute").name(), name);
        assert!(read("percentile").name().starts_with("percentile"));
    }
    let given = "kind = 'absolute'\nsignal = 'pixel-error'\nthreshold = 0.3";
    assert!(matches!(toml::from_str(given).unwrap(), Policy::Grow(Grow { threshold: 0.3, .. })));
    let both: Policy = toml::from_str("kind = 'percentile'\nthreshold = 2e-6").unwrap();
    assert!(both.aims_at_budget() && !Policy::from_name("percentile").unwrap().aims_at_budget());
    assert_eq!(toml::from_str::<Policy>(&toml::to_string(&both).unwrap()).unwrap(), both);
}

#[test]
fn abs_gs_splits_what_3dgs_would_clone() {
    let split_above = |name| match Policy::from_name(name).unwrap() {
        Policy::Grow(policy) => policy.actions.densify.split_above.bound(768.0),
        other => panic!("{other:?}"),
    };
    assert!((split_above("absolute") - 7.68).abs() < 1e-4 && (split_above("abs-gs") - 0.768).abs() < 1e-5);
}

#[test]
fn settings_files_are_held_to_their_fields_and_ranges() {
    let read = |text: &str| toml::from_str::<Policy>(text);
    assert!(read("kind = 'percentile'\npercentage = 5").is_err());
    assert!(read("kind = 'paper'\nactions.densify.split-above = { pixels = 3.0 }").is_ok());
    assert!(read("kind = 'paper'\nactions.densify.split-above = { furlongs = 3.0 }").is_err());
    assert!(read("kind = 'everything'").is_err());
    assert!(read("kind = 'absolute'\nsignal = 'smoke'").is_err());
    assert!(read("kind = 'absolute'\nthresh = 1.0").is_err());
    assert!(read("kind = 'none'\npercent = 1.0").is_err());
    for out_of_range in [
        "kind = 'absolute'\nthreshold = -1.0",
        "kind = 'percentile'\npercent = 101.0",
        "kind = 'percentile'\nthreshold = nan",
        "kind = 'paper'\nactions.densify.shrink = 0.5",
        "kind = 'paper'\nactions.densify.split-above = { pixels = 0.0 }",
        "kind = 'paper'\nactions.prune.opacity = 1.5",
        "kind = 'paper'\nactions.prune.larger-than = { extent-fraction = -0.5 }",
        "kind = 'paper'\nactions.reset.to = 0.0",
        "kind = 'percentile'\nactions.densify.split-placement = { long-axis-split = { width = 0.0 } }",
        "kind = 'mcmc'\npercent = -1.0",
        "kind = 'mcmc'\ndead-opacity = 1.0",
        "kind = 'mcmc'\nnoise.every = 0",
        "kind = 'fastgs'\nhigh-error = nan",
        "kind = 'fastgs'\nfinal-every = 0",
        "kind = 'fastgs'\nopacity-ceiling = 0.0",
        "kind = 'taming'\nweights.depth = -1.0",
        "kind = 'steep-gs'\neigenvalue = -1.0",
        "kind = 'steep-gs'\nstep = inf",
        "kind = 'mrnf'\npower = 1.5",
        "kind = 'mrnf'\npercent = nan",
        "kind = 'absolute'\nfull-depth = -1.0",
        "kind = 'improved-gs'\nrecovery-percent = 101.0",
        "kind = 'absolute'\nactions.growth-fraction = 1.5",
        "kind = 'image-gs'\nadditions = 0",
        "kind = 'image-gs'\nstart-fraction = 1.5",
        "kind = 'image-gs'\nopacity = 1.0",
        "kind = 'image-gs'\nexponent = 0.0",
    ] {
        let policy = read(out_of_range).unwrap();
        assert!(matches!(policy.validate(), Err(Error::Setting { .. })), "{out_of_range}");
    }
}

/// A key that is given changes nothing but itself, and all others keep the values of the policy.
#[test]
fn actions_that_are_not_given_stay_those_of_the_policy() {
    type Change = fn(&mut Actions);
    let changes: [(&str, Change); 5] = [
        ("densify.shrink = 2.5", |s| s.densify.shrink = 2.5),
        ("densify.split-above = { world-units = 3.0 }", |s| s.densify.split_above = SizeThreshold::WorldUnits(3.0)),
        ("prune.larger-after = 77", |s| s.prune.larger_after = 77),
        ("reset.to = 0.5", |s| s.reset.to = 0.5),
        ("growth-fraction = 1.0", |s| s.growth_fraction = 1.0),
    ];
    let with_actions = |kind: &&str| Policy::from_name(kind).unwrap().actions().is_some();
    assert!(kinds().filter(with_actions).count() >= 8);
    for kind in kinds().filter(with_actions) {
        for (text, change) in changes {
            let mut expected = Policy::from_name(kind).unwrap();
            change(expected.actions_mut().unwrap());
            let read: Policy = toml::from_str(&format!("kind = '{kind}'\nactions.{text}")).unwrap();
            assert_eq!(read, expected, "{text}");
            let written = toml::to_string(&expected).unwrap();
            assert_eq!(toml::from_str::<Policy>(&written).unwrap(), expected, "{written}");
        }
        let unknown = toml::from_str::<Policy>(&format!("kind = '{kind}'\nactions.densify.shrinks = 2.5"));
        assert!(unknown.unwrap_err().to_string().contains("shrinks"));
    }
}

#[test]
fn pixel_gs_fades_gradients_near_the_camera() {
    let full_depth = |name| Policy::from_name(name).unwrap().needs().full_depth;
    assert_eq!(["pixel-gs", "abs-gs", "fastgs"].map(full_depth), [0.37, 0.0, 0.0]);
    let nearer: Policy = toml::from_str("kind = 'absolute'\nsignal = 'pixel-gradient'\nfull-depth = 0.0").unwrap();
    assert_eq!((nearer.name(), nearer.needs().full_depth), ("pixel-gs", 0.0));
    assert_eq!(toml::from_str::<Policy>(&toml::to_string(&nearer).unwrap()).unwrap(), nearer);
}

#[test]
fn policies_for_images_and_for_views_are_refused_by_name_elsewhere() {
    for name in Policy::NAMES {
        let policy = Policy::from_name(name).unwrap();
        let [flat, deep] =
            [policy.validate_2d(), policy.clone().for_3d().validate_3d()].map(|checked| checked.is_err());
        assert_eq!(flat, ["fastgs", "taming", "improved-gs", "steep-gs", "mrnf"].contains(&name), "{name}");
        assert_eq!(deep, ["residual", "image-gs"].contains(&name), "{name}");
        assert!(Policy::summary(name).is_some_and(|summary| !summary.is_empty()));
    }
    let message = Policy::from_name("residual").unwrap().validate_3d().unwrap_err().to_string();
    assert!(message.contains("steep-gs") && !message.contains("image-gs"), "{message}");
    assert!(message.contains("`residual`, which needs the residual of an image"), "{message}");
    assert_eq!(Policy::summary("nothing"), None);
}
