//! The examples run.

#[path = "../../examples/own_strategy.rs"]
mod own_strategy;

#[test]
fn a_strategy_of_ones_own_flies_a_mission() {
    own_strategy::main();
}
