//! Sizes of drawn objects, relative to the area, the altitude and the communication radius.

use skysink_common::geometry::Position;
use skysink_common::scenario::{Scenario, UavKeys};

/// Maximum number of sensor nodes that are drawn as bars. With more, a recording would take hundreds of megabytes.
pub(crate) const MAX_BARS: usize = 2_000;

/// Longest side of an area in the unit of its 3D view. rerun's near plane is fixed: from 1.5 km away, WebGL does not
/// distinguish heights that differ by less than 10 m.
const LONGEST_UNITS: f32 = 100.0;

/// Sizes of drawn objects [m].
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Sizes {
    /// Extent of the area in x.
    pub(crate) width_m: f32,
    /// Extent of the area in y.
    pub(crate) depth_m: f32,
    /// Altitude of the UAV, or the middle of its range.
    pub(crate) altitude_m: f32,
    /// Highest altitude of the UAV.
    pub(crate) highest_m: f32,
    /// Communication radius on the ground, `d_c`.
    pub(crate) radius_m: f32,
    /// Unit of the 3D view of the whole area: 1, 10, 100 m and so on.
    pub(crate) unit_m: f32,
    /// Depth of the ground below the feet of the sensor nodes. What is drawn on it lies at fractions of this depth.
    pub(crate) layer_m: f32,
    /// Distance of grid lines.
    pub(crate) grid_m: f32,
    /// Distance of grid lines with a number: a multiple of `grid_m`.
    pub(crate) number_m: f32,
    /// Where the arrow to the north begins, in x and y.
    pub(crate) north_foot_m: [f32; 2],
    /// Its length.
    pub(crate) north_m: f32,
    /// Height of the bar of a full queue: half the lowest altitude, so that no bar hides the UAV, or more in a wide
    /// field, where bars would be invisible.
    pub(crate) bar_m: f32,
    /// Whether a bar beside the UAV would hide it.
    pub(crate) has_tall_bars: bool,
    /// Half the side of a bar.
    pub(crate) bar_half_m: f32,
    /// Arm of the UAV, from its centre to a rotor.
    pub(crate) arm_m: f32,
    /// Radius of a sensor node's point, in points of the screen.
    pub(crate) point_ui: f32,
}

impl Sizes {
    /// The sizes for `count` sensor nodes in a scenario.
    pub(crate) fn of(scenario: &Scenario, count: usize) -> Self {
        let width_m = scenario.area.width_m() as f32;
        let depth_m = scenario.area.height_m() as f32;
        let radius_m = scenario.link.comm_radius_m as f32;
        let of_kind = |uav: &UavKeys| {
            uav.climb().map_or([uav.altitude_m; 2], |climb| [climb.min_altitude_m, climb.max_altitude_m])
        };
        let wider_m =
            |[low_m, high_m]: [f64; 2], [lowest_m, highest_m]: [f64; 2]| [low_m.min(lowest_m), high_m.max(highest_m)];
        let range_m = scenario.uav_kinds().map(of_kind).reduce(wider_m).unwrap_or_default();
        let [lowest_m, highest_m] = range_m.map(|altitude_m| altitude_m as f32);
        let altitude_m = 0.5 * (lowest_m + highest_m);
        let longer_m = width_m.max(depth_m);
        let grid_m = round_step(longer_m / 8.0);
        let bar_m = (0.5 * lowest_m).max(0.045 * longer_m);
        let near_m = radius_m.min(altitude_m);
        let spacing_m = (width_m * depth_m / count.max(1) as f32).sqrt();
        Self {
            width_m,
            depth_m,
            altitude_m,
            highest_m,
            radius_m,
            unit_m: [1.0, 10.0, 100.0, 1e3]
                .into_iter()
                .find(|unit_m| longer_m <= LONGEST_UNITS * unit_m)
                .unwrap_or(1e4),
            layer_m: (0.001 * longer_m).max(0.01 * radius_m),
            grid_m,
            number_m: number_step(grid_m, longer_m),
            north_foot_m: [width_m + 0.06 * longer_m, 0.06 * longer_m],
            north_m: 0.1 * longer_m,
            bar_m,
            has_tall_bars: bar_m > 0.8 * altitude_m,
            bar_half_m: 0.11 * spacing_m.min(0.08 * longer_m),
            arm_m: (0.008 * longer_m).clamp(0.18 * near_m, 0.25 * near_m),
            point_ui: if count <= MAX_BARS {
                3.0
            } else if count <= 50_000 {
                2.5
            } else {
                1.5
            },
        }
    }

    /// The longer side of the area [m].
    pub(crate) fn longer_m(&self) -> f32 {
        self.width_m.max(self.depth_m)
    }

    /// A position of the area on a map, whose y points down from the north-west corner [m].
    pub(crate) fn on_map(&self, position: &Position) -> [f32; 2] {
        [position.x as f32, self.depth_m - position.y as f32]
    }

    /// The numbers at the axes of a map.
    pub(crate) fn numbers_on_map(&self) -> impl Iterator<Item = ([f32; 2], String)> {
        let [longer_m, depth_m] = [self.longer_m(), self.depth_m];
        let at_x =
            self.axis_numbers(self.width_m).map(move |x_m| ([x_m, depth_m + 0.01 * longer_m], format!("{x_m} m")));
        let at_y = self.axis_numbers(depth_m).skip(1);
        at_x.chain(at_y.map(move |y_m| ([-0.05 * longer_m, depth_m - y_m - 0.03 * longer_m], format!("{y_m} m"))))
    }

    /// Positions of the numbers at an axis of this length [m].
    pub(crate) fn axis_numbers(&self, length_m: f32) -> impl Iterator<Item = f32> {
        multiples(self.number_m).take_while(move |&at_m| at_m <= length_m * 1.0001)
    }

    /// Positions of the grid lines at an axis of this length, including its end [m].
    pub(crate) fn grid_lines(&self, length_m: f32) -> impl Iterator<Item = f32> {
        multiples(self.grid_m).take_while(move |&at_m| at_m < length_m).chain([length_m])
    }
}

/// 0, `step_m`, 2 `step_m` and so on, infinitely.
fn multiples(step_m: f32) -> impl Iterator<Item = f32> {
    (0..).map(move |step| step as f32 * step_m)
}

/// The largest of 1, 2, 5, 10, 20, 50, ... (and 0.5, 0.2, ...) that is at most `length_m`.
fn round_step(length_m: f32) -> f32 {
    let decade = 10f32.powf(length_m.log10().floor());
    [5.0, 2.0].into_iter().map(|digit| digit * decade).find(|&step| step <= length_m).unwrap_or(decade)
}

/// Distance of numbers: a multiple of the grid distance with at most seven numbers. Every third line has one only if
/// these lines are 1, 10, 100 m ... apart.
fn number_step(grid_m: f32, longer_m: f32) -> f32 {
    let lines = longer_m / grid_m;
    let is_decade = (grid_m.log10() - grid_m.log10().round()).abs() < 1e-4;
    let steps: &[f32] = if is_decade { &[1.0, 2.0, 3.0, 5.0] } else { &[1.0, 2.0, 5.0] };
    grid_m * steps.iter().find(|&step| lines / step < 6.5).unwrap_or(&10.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use skysink_common::scenario::Overrides;

    #[test]
    fn a_full_bar_of_the_letter_reaches_half_way_to_the_uav() {
        let scenario = Scenario::letter(Overrides::default()).unwrap();
        let sizes = Sizes::of(&scenario, 200);
        assert_eq!((sizes.bar_m, sizes.has_tall_bars), (10.0, false));
        assert!(sizes.bar_half_m < 1.0 && sizes.arm_m < sizes.radius_m);
    }

    #[test]
    fn ground_layers_are_spaced_in_proportion_to_the_area() {
        let sizes = |side_m: f64, radius_m: f64| {
            let text = format!("name = \"s\"\n[area]\nside_m = {side_m:?}\n[link]\ncomm_radius_m = {radius_m:?}\n");
            let scenario = Scenario::parse(&text, std::path::Path::new("s.toml"), Overrides::default()).unwrap();
            Sizes::of(&scenario, 200)
        };
        for (side_m, radius_m, layer_m) in
            [(100.0, 10.0, 0.1), (100.0, 30.0, 0.3), (600.0, 10.0, 0.6), (1_500.0, 80.0, 1.5)]
        {
            let found_m = sizes(side_m, radius_m).layer_m;
            assert!((found_m - layer_m).abs() < 1e-6, "{side_m}: {found_m}");
        }
        // In the unit of the view it is never less than in a field of 100 m.
        let units = [50.0, 100.0, 101.0, 1_000.0, 1_500.0, 2e5].map(|side_m| sizes(side_m, 10.0).unit_m);
        assert_eq!(units, [1.0, 1.0, 10.0, 10.0, 100.0, 1e4]);
        let [paper, farm] = [sizes(100.0, 10.0), sizes(1_500.0, 80.0)].map(|sizes| sizes.arm_m);
        assert!((paper - 1.8).abs() < 1e-6 && farm > 1.8, "{paper} {farm}");
    }

    #[test]
    fn a_bar_is_visible_in_a_wide_field() {
        let text = "name = \"wide\"\n[area]\nside_m = 1000.0\n";
        let scenario = Scenario::parse(text, std::path::Path::new("wide.toml"), Overrides::default()).unwrap();
        let sizes = Sizes::of(&scenario, 200);
        assert_eq!((sizes.bar_m, sizes.has_tall_bars), (45.0, true));
        assert!(sizes.bar_half_m > 7.0, "{}", sizes.bar_half_m);
    }

    #[test]
    fn a_full_bar_stays_below_the_lowest_altitude_where_the_uav_may_climb() {
        let text = "name = \"town\"\n[uav]\naltitude = \"free\"\naltitude_m = 50.0\nmin_altitude_m = 30.0\n\
                    max_altitude_m = 90.0\n[link]\nmodel = \"probabilistic-los\"\n";
        let scenario = Scenario::parse(text, std::path::Path::new("town.toml"), Overrides::default()).unwrap();
        let sizes = Sizes::of(&scenario, 200);
        assert_eq!((sizes.bar_m, sizes.altitude_m, sizes.highest_m), (15.0, 60.0, 90.0));
    }

    #[test]
    fn axis_numbers_are_at_grid_lines_without_overlap() {
        for (longer_m, number_m) in [(100.0, 20.0), (300.0, 100.0), (600.0, 100.0), (1_000.0, 200.0), (1_500.0, 300.0)]
        {
            assert_eq!(number_step(round_step(longer_m / 8.0), longer_m), number_m, "{longer_m}");
        }
    }

    #[test]
    fn an_axis_has_a_number_at_its_end_and_lines_up_to_it() {
        let sizes = Sizes::of(&Scenario::letter(Overrides::default()).unwrap(), 200);
        assert_eq!(sizes.axis_numbers(100.0).collect::<Vec<_>>(), [0.0, 20.0, 40.0, 60.0, 80.0, 100.0]);
        assert_eq!(sizes.axis_numbers(59.0).collect::<Vec<_>>(), [0.0, 20.0, 40.0]);
        assert_eq!(sizes.grid_lines(25.0).collect::<Vec<_>>(), [0.0, 10.0, 20.0, 25.0]);
        assert_eq!(sizes.grid_lines(20.0).collect::<Vec<_>>(), [0.0, 10.0, 20.0]);
    }

    #[test]
    fn grids_have_round_steps() {
        for (length_m, step_m) in [(12.5, 10.0), (37.5, 20.0), (125.0, 100.0), (0.7, 0.5), (60.0, 50.0)] {
            assert!((round_step(length_m) / step_m - 1.0).abs() < 1e-6, "{length_m}: {}", round_step(length_m));
        }
    }
}
