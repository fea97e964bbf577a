use skysink_common::geometry::Position;
use skysink_planner::{conic::ConicSolver, geometric::{project, Disk}};
use proptest::test_runner::{TestRunner,Config};
use proptest::prelude::*;
use proptest::strategy::ValueTree;
#[test]
fn experiment() {
    let mut runner = TestRunner::deterministic(); let _ = Config::default();
    let mut conic = ConicSolver::default();
    for (span, w) in [(0.5, 3.0), (5.0, 3.0), (20.0, 3.0), (30.0, 6.5)] {
        let (mut n, mut fb, mut worst) = (0, 0, 0.0f64);
        for _ in 0..10000 {
            let mut v = |lo: f64, hi: f64| (lo..hi).new_tree(&mut runner).unwrap().current();
            let target = Position::new(v(-span, span), v(-span, span));
            let mut disks = vec![Disk { centre: Position::new(v(-20.,20.), v(-20.,20.)), radius_m: 30.0 }];
            let m = (v(1.0, 7.0)) as usize;
            for _ in 0..m { let p = Position::new(v(-w,w), v(-w,w)); disks.push(Disk{centre: p, radius_m: 10.0}); if v(0.,1.)<0.3 {disks.push(Disk{centre: p, radius_m: 10.0});} }
            match (project(&target, &disks), conic.project(&target, &disks)) {
                (None, _) => {}, (Some(_), None) => {n+=1; fb += 1},
                (Some(a), Some(b)) => {n+=1; worst = worst.max((a-b).norm())},
            }
        }
        println!("r span {span} w {w}: n {n} fallback {fb} worst {worst:e}");
    }
}
