//! The examples run.

#[path = "../../examples/own_strategy.rs"]
mod own_strategy;

#[test]
fn a_user_defined_strategy_flies_a_mission() {
    own_strategy::main();
}
