//! The ground below a flight, as far as the sensor nodes tell it.

use rstar::primitives::GeomWithData;
use rstar::{PointDistance, RTree};
use skysink_common::geometry::Position;
use skysink_common::sensors::SensorList;

/// Sensor nodes nearer to each other than this [m] say nothing about the slope of the ground: the higher one counts, or the lower.
const LEAST_DISTANCE_M: f64 = 5.0;

/// Neighbours of a place that tell its altitude. Fewer than all leave a bound that is as safe, and wider.
const NEIGHBOURS: usize = 8;

/// Sensor nodes of which every pair tells a slope, evenly taken from the list; others tell those to their neighbours.
const MOST_PAIRED: usize = 2000;

/// How much steeper the ground may be than the steepest slope between two neighbours: they tell only the mean of a slope.
const STEEPER: f64 = 1.25;

/// Distance between the places of a leg whose ground is looked at [m].
const STEP_M: f64 = 5.0;

/// The altitude of the ground at the sensor nodes, and between them as high or as low as a slope allows that is a quarter steeper
/// than the steepest between two neighbouring sensor nodes: `min_i (g_i + s d_i)` and `max_i (g_i − s d_i)` at distances `d_i`.
#[derive(Debug)]
pub struct Ground {
    /// The sensor nodes with the altitude of the ground [m].
    sensors: RTree<GeomWithData<[f64; 2], f64>>,
    /// The slope, rise over run.
    slope: f64,
    /// Lowest and highest altitude at a sensor node [m].
    range_m: [f64; 2],
}

impl Ground {
    /// The ground of a list; `None` if the list does not tell it.
    #[must_use]
    pub fn of(list: &SensorList) -> Option<Self> {
        let altitudes_m = list.ground_m();
        let sensors = list.sensors().iter().zip(altitudes_m);
        let sensors = sensors.map(|(sensor, &ground_m)| GeomWithData::new(sensor.position.into(), ground_m)).collect();
        let fold = |start: f64, pick: fn(f64, f64) -> f64| altitudes_m.iter().copied().fold(start, pick);
        let range_m = [fold(f64::INFINITY, f64::min), fold(f64::NEG_INFINITY, f64::max)];
        let mut ground = Self { sensors: RTree::bulk_load(sensors), slope: 0.0, range_m };
        ground.slope = ground.steepest();
        (!altitudes_m.is_empty()).then_some(ground)
    }

    fn steepest(&self) -> f64 {
        let slope = |distance_m: f64, rise_m: f64| {
            if distance_m < LEAST_DISTANCE_M { 0.0 } else { rise_m.abs() / distance_m }
        };
        let near = self.sensors.iter().flat_map(|sensor| {
            let at = Position::from(*sensor.geom());
            let neighbours = self.neighbours(&at);
            neighbours.map(|(distance_m, ground_m)| slope(distance_m, ground_m - sensor.data)).collect::<Vec<_>>()
        });
        let paired: Vec<_> = self.sensors.iter().step_by(self.sensors.size().div_ceil(MOST_PAIRED).max(1)).collect();
        let far = paired.iter().enumerate().flat_map(|(index, first)| {
            let others = paired[..index].iter();
            others.map(move |second| slope(first.distance_2(second.geom()).sqrt(), first.data - second.data))
        });
        STEEPER * near.chain(far).fold(0.0, f64::max)
    }

    /// Distance [m] and altitude [m] of the sensor nodes that are nearest to `at` [m], one there included.
    fn neighbours(&self, at: &Position) -> impl Iterator<Item = (f64, f64)> {
        let nearest = self.sensors.nearest_neighbor_iter_with_distance_2(&[at.x, at.y]);
        nearest.take(NEIGHBOURS + 1).map(|(sensor, squared_m2)| (squared_m2.sqrt(), sensor.data))
    }

    /// Whether the altitudes differ.
    #[must_use]
    pub fn is_hilly(&self) -> bool {
        let [lowest_m, highest_m] = self.range_m;
        highest_m > lowest_m
    }

    /// Lowest and highest altitude at a sensor node [m].
    #[must_use]
    pub fn range_m(&self) -> [f64; 2] {
        self.range_m
    }

    /// The highest that the ground can be at a place [m].
    #[must_use]
    pub fn highest_m(&self, at: &Position) -> f64 {
        let bound_m = self.neighbours(at).map(|(distance_m, ground_m)| ground_m + self.slope * distance_m);
        self.here_m(at).chain([bound_m.fold(f64::INFINITY, f64::min)]).fold(f64::NEG_INFINITY, f64::max)
    }

    /// The lowest that the ground can be at a place [m].
    #[must_use]
    pub fn lowest_m(&self, at: &Position) -> f64 {
        let bound_m = self.neighbours(at).map(|(distance_m, ground_m)| ground_m - self.slope * distance_m);
        self.here_m(at).chain([bound_m.fold(f64::NEG_INFINITY, f64::max)]).fold(f64::INFINITY, f64::min)
    }

    /// The altitudes of the sensor nodes that are too near to tell a slope [m].
    fn here_m(&self, at: &Position) -> impl Iterator<Item = f64> {
        self.sensors.locate_within_distance([at.x, at.y], LEAST_DISTANCE_M * LEAST_DISTANCE_M).map(|sensor| sensor.data)
    }

    /// The altitude in the middle between the lowest and the highest that the ground can be at a place [m].
    #[must_use]
    pub fn midway_m(&self, at: &Position) -> f64 {
        f64::midpoint(self.lowest_m(at), self.highest_m(at))
    }

    /// The highest that the ground can be on the straight way between two places [m].
    #[must_use]
    pub fn highest_between_m(&self, from: &Position, to: &Position) -> f64 {
        let steps = ((to - from).norm() / STEP_M).ceil().max(1.0);
        let step_m = (to - from).norm() / steps;
        let highest = (0..=steps as u64).map(|step| self.highest_m(&(from + (to - from) * (step as f64 / steps))));
        highest.fold(f64::NEG_INFINITY, f64::max) + self.slope * step_m / 2.0
    }
}
