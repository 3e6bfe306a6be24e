//! Negative controls of the suite for 3D scenes: the oracle as a backend passes, and with one fault
//! it fails the case that is meant to find it.

mod faulty;
mod target;

use gs_conformance::conformance::{CaseOutcome, Skipped, cases_3d, conformance_3d};

use self::faulty::{Fault::*, Faulty};

#[test]
fn every_fault_is_caught_by_its_case() {
    let caught_by = [
        (ShiftsImages, "images_match_3d"),
        (ShiftsImages, "sizes_match_3d"),
        (DimsImages, "images_match_3d"),
        (DrawsInTheScenesOrder, "images_match_3d"),
        (DrawsInTheScenesOrder, "gradients_match_3d"),
        (DrawsInTheScenesOrder, "indices_do_not_matter_by_depth"),
        (OrdersByMean, "orders_match"),
        (OrdersByMean, "gradients_match_in_all_orders"),
        (ForgetsAntialiasing, "antialiased_images_match"),
        (ForgetsCompensation, "antialiased_images_match"),
        (ForgetsCompensation, "antialiased_gradients_match"),
        (IgnoresTheDegree, "sh_match"),
        (IgnoresTheDegree, "sh_gradients_match"),
        (ForgetsTheAccuracy, "accuracies_match_3d"),
        (ForgetsTheBackground, "empty_space_shows_the_background"),
        (MistakesCauses, "causes_are_counted"),
        (NegatesQuaternionGradients, "gradients_match_3d"),
        (GradientsInWrongUnits, "gradients_match_3d"),
        (NegatesGivenGradients, "image_vjps_match"),
        (NegatesTurns, "camera_gradients_match"),
        (MovesTheWrongWay, "camera_gradients_match"),
        (GradientsInWrongUnits, "camera_gradients_match"),
        (NegatesGivenGradients, "camera_gradients_match"),
        (HoldsDirectionsFixed, "camera_gradients_match"),
        (IgnoresMasks, "camera_gradients_of_steps_match"),
        (ShowsColoursForDepths, "camera_gradients_match"),
        (ForgetsCompensation, "camera_gradients_match"),
        (AnswersUnasked, "camera_gradients_match"),
        (KeepsCameraGradients, "camera_gradients_of_steps_match"),
        (ShowsColoursForDepths, "inverse_depths_match"),
        (ShowsColoursForDepths, "alphas_match"),
        (KeepsAllGaussians, "dropouts_match"),
        (ForgetsTheGain, "dropouts_match"),
        (LeavesOutTheSame, "dropouts_match"),
        (HoldsDirectionsFixed, "sh_gradients_match"),
        (NormalisesQuaternions, "scenes_3d_come_back"),
        (ForgetsMomentsOnRestore, "restored_splats_continue_bit_for_bit"),
        (StepsUphill, "steps_decrease_the_loss"),
        (OneRateForAllColours, "adam_matches"),
        (ForgetsBiasCorrection, "adam_matches"),
        (MovesAll, "only_participants_move"),
        (MovesOnlyTheVisible, "only_participants_move"),
        (MovesTheFixed, "fixed_gaussians_stay"),
        (FusedStepDoesTooMuch, "fused_steps_match_separate_stages"),
        (UsesListsOfAnotherView, "reused_lists_change_nothing_without_movement"),
        (SwapsLosses, "losses_are_reported_once_and_in_order"),
        (ForgetsLossesOnEdit, "every_call_sees_pending_steps"),
        (DoublesStatistics, "mean_gradients_match"),
        (LetsGradientsCancel, "absolute_gradients_match"),
        (MistakesErrorsForGradients, "pixel_errors_match"),
        (CountsStepsForPixels, "pixel_gradients_match"),
        (ForgetsDepths, "pixel_gradients_match"),
        (SeesEverything, "visible_are_counted"),
        (NoiseIsAStep, "noise_moves_means_and_nothing_else"),
        (IgnoresMasks, "incomplete_targets_are_completed"),
        (IgnoresAlpha, "incomplete_targets_are_completed"),
        (IgnoresWeights, "weights_are_factors_of_the_loss"),
        (ForgetsMomentsOnEdit, "edits_carry_everything_along"),
        (ForgetsMomentsOnEdit, "changes_that_inherit_go_on"),
        (EditsEvenWhenItRefuses, "refused_edits_change_nothing"),
        (AcceptsNan, "scenes_3d_that_are_not_finite_are_refused"),
        (SwallowsBadSettings, "bad_cameras_and_settings_are_errors"),
        (RestoresAnything, "mismatches_are_errors"),
        (DrawsByParity, "order_does_not_matter_under_sum"),
        (DrawsByParity, "indices_do_not_matter_by_depth"),
        (DrawsByPlace, "rigid_motions_change_nothing"),
        (NearIsAbsolute, "scales_of_the_world_change_nothing"),
    ];
    let cases = cases_3d::<Faulty>();
    let outcome = |fault, name: &str| {
        let case = cases.iter().find(|case| case.name == name).unwrap();
        (case.run)(&Faulty(fault))
    };
    let missed: Vec<_> = caught_by.iter().filter(|&&(fault, name)| outcome(fault, name).is_ok()).collect();
    assert!(missed.is_empty(), "not caught: {missed:?}");
    let unguarded: Vec<_> = cases.iter().map(|c| c.name).filter(|n| !caught_by.iter().any(|(_, m)| m == n)).collect();
    assert!(unguarded.is_empty(), "cases without a negative control: {unguarded:?}");
}

#[test]
fn refused_features_are_skipped_not_passed() {
    let cases = cases_3d::<Faulty>();
    let case = cases.iter().find(|case| case.name == "pixel_gradients_match").unwrap();
    let outcome = (case.run)(&Faulty(RefusesPixelGradients));
    assert_eq!(outcome.unwrap(), CaseOutcome::Skipped("PixelGradient".to_owned()));
}

#[test]
#[ignore = "slow: the oracle is dense; `cargo xtask test --slow` runs it"]
fn the_oracle_passes_what_it_does_not_refuse() {
    let skipped = conformance_3d(&Faulty(RefusesPixelGradients)).unwrap();
    let messages: Vec<String> = skipped.iter().map(Skipped::to_string).collect();
    assert_eq!(messages, ["case pixel_gradients_match: skipped, as the backend refuses PixelGradient"]);
}
