//! The three-dimensional waypoint against a global search that knows nothing of slopes, cones or projections.

use std::path::Path;

use nalgebra::{Point3, Vector2};
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};
use skysink_common::channel::{Channel, ChannelModel, LineOfSight, Uplink};
use skysink_common::geometry::{Position, above, within};
use skysink_common::message::{Plan, SensorNode, SolverOutcome};
use skysink_common::scenario::{Overrides, Scenario};
use skysink_planner::Planner;
use skysink_planner::settings::WaypointSolver;

/// Side of the area [m]; everything happens about its middle.
const SIDE_M: f64 = 400.0;

/// Largest share of the best rate that a plan may fall short of it, in every surrounding and in every case.
const TOLERANCE: f64 = 1e-5;

/// The same for the search, which narrows down a lattice.
const SEARCH_TOLERANCE: f64 = 5e-3;

/// A slot to plan: four SNs that one disk of radius `d_c` covers, and the UAV in reach of its centre.
struct Case {
    scenario: Scenario,
    /// The centre of that disk, a feasible waypoint.
    centre: Position,
    sensors: Vec<Position>,
    position: Position,
    altitude_m: f64,
}

/// A channel, a range and a solver to draw cases for.
#[derive(Clone, Copy)]
struct Setting {
    environment: &'static str,
    comm_radius_m: f64,
    solver: WaypointSolver,
}

impl Setting {
    fn name(self) -> String {
        format!("{}, d_c = {} m, {:?}", self.environment, self.comm_radius_m, self.solver)
    }

    /// Random case `number`. Half of the climbs cross the whole range of 20 to 120 m, a quarter up to 20 m of it, and a
    /// quarter stays at its altitude.
    fn case(self, number: u64) -> Case {
        let mut random = StdRng::seed_from_u64(number);
        let centre = Position::new(SIDE_M / 2.0, SIDE_M / 2.0);
        let mut scatter = |radius_m: f64| {
            let angle = random.random_range(0.0..std::f64::consts::TAU);
            let away_m = radius_m * random.random::<f64>().sqrt();
            centre + Vector2::new(angle.cos(), angle.sin()) * away_m
        };
        let sensors = (0..4).map(|_| scatter(self.comm_radius_m)).collect();
        let reach_m = [10.0, 30.0, 80.0][number as usize % 3];
        let position = scatter(reach_m);
        let climb_mps = [100.0, 100.0, random.random_range(1.0..10.0), 0.0][number as usize % 4];
        let altitude_m = random.random_range(20.0..120.0);
        let scenario = self.scenario(reach_m, &format!("'free'\nmax_climb_mps = {climb_mps}"), altitude_m);
        Case { scenario, centre, sensors, position, altitude_m }
    }

    /// Slots of 1 s; `altitude` is the value of its key, and more lines of the same table.
    fn scenario(self, reach_m: f64, altitude: &str, altitude_m: f64) -> Scenario {
        let environment = self.environment;
        let solver = match self.solver {
            WaypointSolver::Geometric => "geometric",
            WaypointSolver::Clarabel => "clarabel",
        };
        let text = format!(
            "name = 'case'\n[area]\nside_m = {SIDE_M}\n[uav]\nmax_speed_mps = {reach_m}\naltitude = {altitude}\n\
             altitude_m = {altitude_m:?}\n[link]\nmodel = 'probabilistic-los'\nenvironment = '{environment}'\n\
             tx_power_w = 0.1\nnoise_dbm = -109.0\ncomm_radius_m = {}\n[planner]\nwaypoint_solver = '{solver}'\n",
            self.comm_radius_m
        );
        let overrides = Overrides { strategy: Some("exact"), ..Overrides::default() };
        Scenario::parse(&text, Path::new("case.toml"), overrides).unwrap()
    }
}

impl Case {
    fn link(&self) -> LineOfSight {
        Channel::of(&self.scenario.link).line_of_sight().unwrap().clone()
    }

    /// The plan that serves all SNs: their queues are as good as endless.
    fn plan(&self) -> Plan {
        let node = |at: &Position| SensorNode { x_m: at.x, y_m: at.y, ..SensorNode::default() };
        let nodes: Vec<SensorNode> = self.sensors.iter().map(node).collect();
        let queues_bits = vec![u32::MAX; nodes.len()];
        Planner::new(&self.scenario, &nodes).unwrap().step(1, above(&self.position, self.altitude_m), &queues_bits)
    }

    fn rate_bps(&self, at: &Point3<f64>) -> f64 {
        let link = self.link();
        self.sensors.iter().map(|sensor| link.expected_rate_bps(&Uplink::new(1.0, sensor, at))).sum()
    }

    /// Panics unless the plan serves everybody within reach, range and climb.
    fn assert_feasible(&self, plan: &Plan, name: &str) {
        let at = Position::new(plan.x_m, plan.y_m);
        assert_eq!(plan.scheduled().len(), self.sensors.len(), "{name}");
        assert!(within(&at, &self.position, self.scenario.reach_m()), "{name}: reach, {at}");
        let in_range = |sensor| within(sensor, &at, self.scenario.link.comm_radius_m);
        assert!(self.sensors.iter().all(in_range), "{name}: range, {at}");
        let [low_m, high_m] = self.scenario.altitudes_m(self.altitude_m);
        assert!((low_m..=high_m).contains(&plan.z_m), "{name}: climb, {} m", plan.z_m);
    }

    /// The best expected rate [bit/s] of a coarse grid, narrowed down from its best cells.
    ///
    /// The grid is one of polar coordinates about the feasible centre: angle, fraction of the distance to the border,
    /// fraction of the climb. The feasible set is convex, so that every point of it, its border and its corners have
    /// coordinates.
    fn best_bps(&self) -> f64 {
        let point = |at: [f64; 3]| self.point(at);
        let levels = if self.climb_m() > 0.0 { 7 } else { 1 };
        let mut grid = Vec::new();
        for angle in 0..36u32 {
            for share in 0..9u32 {
                for level in 0..levels {
                    let at = [f64::from(angle) / 36.0, f64::from(share) / 8.0, f64::from(level) / 6.0];
                    grid.push((self.rate_bps(&point(at)), at));
                }
            }
        }
        grid.sort_by(|a, b| b.0.total_cmp(&a.0));
        let mut begun: Vec<Point3<f64>> = Vec::new();
        let mut best_bps = 0.0f64;
        for (cell_bps, at) in grid {
            let cell = point(at);
            let apart = |other: &Point3<f64>| (other - cell).norm() > 0.25 * self.scenario.link.comm_radius_m;
            if begun.iter().all(apart) {
                begun.push(cell);
                best_bps = best_bps.max(self.narrowed(at, cell_bps));
            }
            if begun.len() == 6 {
                break;
            }
        }
        best_bps
    }

    /// The best rate [bit/s] of ever smaller lattices of 27 points, each about the best of the one before.
    fn narrowed(&self, mut at: [f64; 3], mut best_bps: f64) -> f64 {
        let points = if self.climb_m() > 0.0 { 27 } else { 9 };
        let mut steps = [0.03, 0.12, 0.15];
        for _ in 0..48 {
            let middle = at;
            for number in 0..points {
                let offset = |axis: u32| f64::from(number / 3u32.pow(axis) % 3) - 1.0;
                let tried = [0, 1, 2].map(|axis| middle[axis] + offset(axis as u32) * steps[axis]);
                let tried_bps = self.rate_bps(&self.point(tried));
                if tried_bps > best_bps {
                    best_bps = tried_bps;
                    at = tried;
                }
            }
            if at == middle {
                steps = steps.map(|step| step * 0.55);
            }
        }
        best_bps
    }

    /// The feasible point of these coordinates.
    fn point(&self, [angle, share, climb]: [f64; 3]) -> Point3<f64> {
        let (sine, cosine) = (angle * std::f64::consts::TAU).sin_cos();
        let direction = Vector2::new(cosine, sine);
        let ground = self.centre + direction * (share.clamp(0.0, 1.0) * self.way_to_border_m(&direction));
        let [low_m, _] = self.scenario.altitudes_m(self.altitude_m);
        Point3::new(ground.x, ground.y, low_m + climb.clamp(0.0, 1.0) * self.climb_m())
    }

    /// Extent of the altitudes in reach [m].
    fn climb_m(&self) -> f64 {
        let [low_m, high_m] = self.scenario.altitudes_m(self.altitude_m);
        high_m - low_m
    }

    /// Distance [m] from the centre to the first constraint in this direction.
    fn way_to_border_m(&self, direction: &Vector2<f64>) -> f64 {
        let to_circle_m = |centre: &Position, radius_m: f64| {
            let from = self.centre - centre;
            let along_m = from.dot(direction);
            -along_m + (along_m * along_m - from.norm_squared() + radius_m * radius_m).max(0.0).sqrt()
        };
        let ranges = self.sensors.iter().map(|sensor| to_circle_m(sensor, self.scenario.link.comm_radius_m));
        ranges.fold(to_circle_m(&self.position, self.scenario.reach_m()), f64::min)
    }
}

/// Plans `cases` times [`crate::CASES_FACTOR`] cases of each range and compares with the search. How many fell back is
/// returned.
fn assert_near_the_best(environment: &'static str, solver: WaypointSolver, cases: u32) -> u64 {
    let mut fallen_back = 0;
    for comm_radius_m in [10.0, 60.0] {
        let setting = Setting { environment, comm_radius_m, solver };
        let mut worst = f64::NEG_INFINITY;
        let mut worst_number = 0;
        let mut lead = 0.0f64;
        for number in 0..u64::from(cases * crate::CASES_FACTOR) {
            let case = setting.case(number);
            let plan = case.plan();
            case.assert_feasible(&plan, &format!("{}, case {number}", setting.name()));
            fallen_back += u64::from(plan.solver == SolverOutcome::Fallback as u32);
            let planned_bps = case.rate_bps(&Point3::new(plan.x_m, plan.y_m, plan.z_m));
            let shortfall = 1.0 - planned_bps / case.best_bps();
            lead = lead.max(-shortfall);
            if shortfall > worst {
                worst = shortfall;
                worst_number = number;
            }
        }
        // A search that finds much less than the planner says nothing about it.
        assert!(lead <= SEARCH_TOLERANCE, "{}: the search is {lead} below the planner", setting.name());
        assert!(worst <= TOLERANCE, "{}: {worst} below the best in case {worst_number}", setting.name());
    }
    fallen_back
}

#[test]
fn the_suburban_waypoint_is_as_good_as_the_best() {
    assert_near_the_best("suburban", WaypointSolver::Geometric, 30);
}

#[test]
fn the_urban_waypoint_is_as_good_as_the_best() {
    assert_near_the_best("urban", WaypointSolver::Geometric, 30);
}

#[test]
fn the_dense_urban_waypoint_is_as_good_as_the_best() {
    assert_near_the_best("dense-urban", WaypointSolver::Geometric, 30);
}

#[test]
fn the_high_rise_waypoint_is_as_good_as_the_best() {
    assert_near_the_best("high-rise", WaypointSolver::Geometric, 30);
}

#[test]
fn the_conic_waypoint_is_as_good_as_the_best_with_few_fallbacks() {
    let fallen_back: u64 = ["suburban", "urban", "dense-urban", "high-rise"]
        .map(|area| assert_near_the_best(area, WaypointSolver::Clarabel, 8))
        .iter()
        .sum();
    let cases = u64::from(4 * 2 * 8 * crate::CASES_FACTOR);
    assert!(20 * fallen_back <= cases, "{fallen_back} of {cases} fell back");
}
