//! Every input that is kept, and some that are made of them.

use skysink_fuzz::campaign::{Campaign, replay, run};
use skysink_fuzz::mutation::LONGEST;
use skysink_fuzz::{TARGETS, Target, corpus};

/// Most inputs that are kept for a target.
const MOST_KEPT: usize = 40;

/// A test for each target, with the number of new inputs.
macro_rules! nothing_is_wrong_with {
    ($($name:ident: $inputs:literal,)*) => {
        $(#[test]
        fn $name() {
            let target = Target::named(stringify!($name)).unwrap();
            let campaign = Campaign { seed: 0, inputs: 0..$inputs };
            replay(target).and_then(|_| run(target, campaign)).unwrap_or_else(|error| panic!("{error}"));
        })*

        #[test]
        fn every_target_has_its_test() {
            assert_eq!(TARGETS.map(|target| target.name), [$(stringify!($name)),*]);
        }
    };
}

nothing_is_wrong_with! {
    scenario: 20_000,
    sensors: 10_000,
    mission: 20_000,
    trace: 10_000,
    sweep_journal: 10_000,
    journal: 20_000,
    field_journal: 3_000,
    flight_journal: 10_000,
    planner_memory: 2_000,
    plan_message: 20_000,
    flight_message: 20_000,
    planner_message: 20_000,
    health_message: 20_000,
    path_message: 20_000,
}

#[test]
fn what_is_kept_is_small() {
    for target in TARGETS {
        let kept = corpus::read(target.name).unwrap();
        assert!((1..=MOST_KEPT).contains(&kept.len()), "{}: {} inputs", target.name, kept.len());
        for (file, bytes) in kept {
            assert!(bytes.len() <= LONGEST, "{}: {} bytes", file.display(), bytes.len());
        }
    }
}
