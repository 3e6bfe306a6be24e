//! One test for each claim of the paper, in the quick form of its experiment: the number that shows it.

use std::sync::OnceLock;

use gs_cpu::{CpuRasterizer, CpuSettings};
use gs_train::experiments::{
    Claim, Extent, Findings, Laboratory, Verdict,
    cold_start::{self, ColdStartMeasured, Start},
    edges::{self, EdgesMeasured, Zone},
    instability::{self, Guard, InstabilityMeasured},
    lazy_convergence::{self, Criterion, LazyMeasured},
    set_up::{self, SetUpMeasured},
};

/// Makes an experiment once, whichever of its claims is tested first.
macro_rules! once {
    ($name:ident, $module:ident, $measured:ty) => {
        fn $name() -> &'static $measured {
            static MADE: OnceLock<$measured> = OnceLock::new();
            MADE.get_or_init(|| {
                let cpu = CpuRasterizer::new(CpuSettings::default()).unwrap();
                $module::measure(&mut Laboratory::new(&cpu, Extent::Quick, &mut ())).unwrap()
            })
        }
    };
}

once!(set_up, set_up, SetUpMeasured);
once!(cold_start, cold_start, ColdStartMeasured);
once!(lazy_convergence, lazy_convergence, LazyMeasured);
once!(instability, instability, InstabilityMeasured);
once!(edges, edges, EdgesMeasured);

/// The claim of that name, whose words must hold numbers.
#[track_caller]
fn claim(findings: Findings, name: &str) -> Claim {
    let claim = findings.claims.into_iter().find(|claim| claim.name == name).expect("the experiment tests it");
    println!("{}: {}\n  {}\n  {:?}", claim.name, claim.verdict, claim.measured, claim.numbers);
    assert!(claim.measured.contains(|c: char| c.is_ascii_digit()), "{claim:?}");
    assert!(!claim.measured.contains("NaN") && !claim.measured.contains("inf"), "{claim:?}");
    claim
}

#[test]
fn show() {
    for f in [
        set_up().findings(),
        cold_start().findings(),
        lazy_convergence().findings(),
        instability().findings(),
        edges().findings(),
    ] {
        for c in &f.claims {
            println!("* {} [{}]\n    {}", c.name, c.verdict, c.measured);
        }
        for t in &f.tables {
            println!("  # {}\n  {:?}", t.title, t.columns);
            for r in t.rows.iter().take(30) {
                println!("    {}", r.iter().map(|c| c.to_string()).collect::<Vec<_>>().join(" | "));
            }
        }
    }
}
