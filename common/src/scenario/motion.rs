//! How far the UAV flies in a slot, with wind and acceleration (decisions D29 and D31), and its moves on a grid (D17a).

use std::f64::consts::FRAC_1_SQRT_2;

use nalgebra::{Point3, Vector2};

use super::mission::Scenario;
use crate::airspace::{MAX_CELLS, cells_along};
use crate::error::InputError;
use crate::geometry::{Position, within};
use crate::slack::SLOTS_SLACK;

/// Slack of the middle of a cell, in cells.
const MIDDLE_SLACK: f64 = 1e-9;

/// Slack of a slot on a grid, which may end beside the middle of its move.
const GRID_SLACK: f64 = 1e-8;

/// ```
/// use skysink_common::scenario::Scenario;
/// let text = "name = 'windy'\nuav.max_speed_mps = 13.0\nuav.wind_mps = [3.0, -4.0]"; // 5 m/s, slots of 1 s
/// let windy = Scenario::parse(text, "windy.toml".as_ref(), Default::default()).unwrap();
/// assert_eq!((windy.wind_mps().norm(), windy.reach_m(), windy.farthest_m(), windy.move_slots()), (5.0, 8.0, 18.0, 1));
/// let [from, with_the_wind, against_it] = [[50.0, 50.0].into(), [59.0, 38.0].into(), [41.0, 62.0].into()];
/// assert!(windy.reaches(&from, &with_the_wind) && !windy.reaches(&from, &against_it));
/// assert!((windy.end_toward(&from, &against_it) - from).norm() < 9.0);
/// ```
impl Scenario {
    /// Horizontal distance that a slot reaches in every direction, for plans [m]: `V_max τ`, or less with wind and
    /// acceleration.
    pub fn reach_m(&self) -> f64 {
        let hop_m = self.hop_m(self.uav.max_speed_mps - self.wind_mps().norm());
        self.uav.grid_m().map_or(hop_m, |cell_m| cell_m / slots_of_move(cell_m, hop_m))
    }

    /// Slots of a move to a neighbouring cell of the grid (decision D17a); 1 without one.
    pub fn move_slots(&self) -> u64 {
        let hop_m = self.hop_m(self.uav.max_speed_mps - self.wind_mps().norm());
        self.uav.grid_m().map_or(1, |cell_m| slots_of_move(cell_m, hop_m) as u64)
    }

    /// Length of a move [m]: of a cell of the grid, or without one as far as a slot reaches.
    pub fn move_m(&self) -> f64 {
        self.uav.grid_m().unwrap_or_else(|| self.reach_m())
    }

    /// Whether a move takes several slots in which its UAV, between cells, is less than `distance_m` [m] from others
    /// that keep this distance from its end.
    pub fn is_near_between_cells(&self, distance_m: f64) -> bool {
        self.uav.grid_m().is_some_and(|cell_m| distance_m > cell_m * FRAC_1_SQRT_2 && self.move_slots() > 1)
    }

    /// The middle of the area [m], on a grid of a cell there.
    pub(super) fn middle_m(&self) -> [f64; 2] {
        [self.area.width_m(), self.area.height_m()].map(|side_m| match self.uav.grid_m() {
            None => side_m / 2.0,
            Some(cell_m) => (f64::from(cells_along(side_m, cell_m) / 2) + 0.5) * cell_m,
        })
    }

    /// Farthest horizontal flight in a slot in any direction, for bounds [m]: with the wind.
    pub fn farthest_m(&self) -> f64 {
        let hop_m = self.hop_m(self.uav.max_speed_mps + self.wind_mps().norm());
        self.uav.grid_m().map_or(hop_m, |_| self.reach_m())
    }

    /// Whether a slot that begins at `from` can end at `to`, up to the slack of [`within`].
    ///
    /// The limit of speed holds relative to the air. Without acceleration that is the disk of radius `V_max τ` about
    /// `from + wind τ`.
    pub fn reaches(&self, from: &Position, to: &Position) -> bool {
        within(from, to, self.reach_along_m(&(to - from)))
    }

    /// The farthest end of a slot on the way from `from` to `to`: `to`, if it is in reach.
    pub fn end_toward(&self, from: &Position, to: &Position) -> Position {
        let away = to - from;
        let fraction = self.reach_along_m(&away) / away.norm();
        if fraction < 1.0 { from + away * fraction } else { *to }
    }

    /// The wind over ground [m/s].
    pub fn wind_mps(&self) -> Vector2<f64> {
        self.uav.wind_mps.map_or_else(Vector2::zeros, Vector2::from)
    }

    /// The reach of a slot in the direction of `along` [m]: at the speed over ground `v` with `|v − wind| = V_max`.
    fn reach_along_m(&self, along: &Vector2<f64>) -> f64 {
        if self.uav.grid_m().is_some() {
            return self.reach_m() * (1.0 + GRID_SLACK);
        }
        let Some(wind_mps) = self.uav.wind_mps.map(Vector2::from) else { return self.reach_m() };
        let Some(direction) = along.try_normalize(0.0) else { return self.reach_m() };
        let across_mps = direction.perp(&wind_mps);
        let through_mps = (self.uav.max_speed_mps.powi(2) - across_mps.powi(2)).sqrt();
        self.hop_m(direction.dot(&wind_mps) + through_mps)
    }

    /// Time of a leg of `leg_m` [m] in still air [s]; with an acceleration from rest to rest. The inverse of the reach
    /// of a slot (decision D31).
    pub fn leg_s(&self, leg_m: f64) -> f64 {
        let speed_mps = self.uav.max_speed_mps;
        match self.uav.acceleration_mps2 {
            None => leg_m / speed_mps,
            Some(a_mps2) if leg_m >= speed_mps * speed_mps / a_mps2 => leg_m / speed_mps + speed_mps / a_mps2,
            Some(a_mps2) => 2.0 * (leg_m / a_mps2).sqrt(),
        }
    }

    /// Distance of a slot at up to `speed_mps` [m/s] [m]; with an acceleration from rest to rest.
    fn hop_m(&self, speed_mps: f64) -> f64 {
        match self.uav.acceleration_mps2 {
            None => speed_mps * self.slot_s,
            Some(a_mps2) if self.slot_s >= 2.0 * speed_mps / a_mps2 => speed_mps * (self.slot_s - speed_mps / a_mps2),
            Some(a_mps2) => a_mps2 * self.slot_s * self.slot_s / 4.0,
        }
    }
}

/// Checks the keys of moves on a grid by `rule`: whether it holds, of which key, and what is expected.
pub(super) fn check_moves(
    scenario: &Scenario,
    rule: &dyn Fn(bool, &str, &str) -> Result<(), InputError>,
) -> Result<(), InputError> {
    let uav = &scenario.uav;
    let area = &scenario.area;
    let Some(cell_m) = uav.grid_m() else { return Ok(()) };
    let [columns, rows] = [area.width_m(), area.height_m()].map(|side_m| u64::from(cells_along(side_m, cell_m)));
    let is_grid = columns >= 1 && rows >= 1 && columns.saturating_mul(rows) <= u64::from(MAX_CELLS);
    let expected = format!("a side of cells of which the area has 1 to {MAX_CELLS}");
    rule(is_grid, "uav.cell_m", &expected)?;
    rule(is_grid, "uav.moves", &format!("\"free\", or {expected} (uav.cell_m)"))?;
    rule(uav.position_error_m.is_none(), "uav.position_error_m", "none with moves = \"grid\"")?;
    rule(uav.climb().is_none(), "uav.altitude", "\"fixed\" with moves = \"grid\"")?;
    let is_middle = |(at_m, count): (f64, u64)| {
        let index = at_m / cell_m - 0.5;
        (index - index.round()).abs() <= MIDDLE_SLACK && (0.0..count as f64).contains(&index.round())
    };
    let is_cell = |start: Point3<f64>| [(start.x, columns), (start.y, rows)].into_iter().all(is_middle);
    let expected = format!("the middle of a cell of {cell_m} m, as (0.5, 1.5, ...) × {cell_m} m");
    rule(uav.starts_m.is_some() || is_cell(scenario.start()), "uav.start_m", &expected)?;
    rule(scenario.starts().all(is_cell), "uav.starts_m", &format!("each {expected}"))?;
    Ok(())
}

/// Slots of a move over a cell, with up to `hop_m` [m] in each.
fn slots_of_move(cell_m: f64, hop_m: f64) -> f64 {
    (cell_m / hop_m - SLOTS_SLACK).ceil().max(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::Overrides;
    use std::path::Path;

    fn parsed(slot_s: f64, uav: &str) -> Result<Scenario, String> {
        let text = format!("name = 'a'\nslots = 2\nslot_s = {slot_s:?}\n[uav]\n{uav}");
        Scenario::parse(&text, Path::new("a.toml"), Overrides::default()).map_err(|error| error.to_string())
    }

    fn scenario(slot_s: f64, uav: &str) -> Scenario {
        parsed(slot_s, uav).unwrap()
    }

    #[test]
    fn rest_to_rest_reach_follows_from_the_acceleration() {
        // V = 30 m/s, a = 2.5 m/s²: 12 s to top speed. 24 s: 12 s · 30 m/s up and down, 360 m = 2.5 · 24²/4. 30 s: 6 s
        // at top speed more, 540 m. 6.928 s: 2.5 · 48/4 = 30 m, what the letter flies in 1 s. 4 s: 10 m.
        for (slot_s, reach_m) in [(24.0, 360.0), (30.0, 540.0), (48f64.sqrt(), 30.0), (4.0, 10.0)] {
            let scenario = scenario(slot_s, "acceleration_mps2 = 2.5\n");
            let found_m = scenario.reach_m();
            assert!((found_m - reach_m).abs() < 1e-9, "{slot_s} s: {found_m} m");
            assert!((scenario.leg_s(reach_m) - slot_s).abs() < 1e-9, "{reach_m} m");
        }
        assert_eq!(scenario(1.0, "").leg_s(60.0), 2.0);
        let demanded = "acceleration_mps2 = 120.0\nmax_speed_mps = 60.0\n";
        assert_eq!(scenario(1.0, demanded).reach_m(), 30.0, "what 30 m in 1 s demand");
        assert_eq!(scenario(1.0, "acceleration_mps2 = 120.0\n").reach_m(), 22.5, "0.25 s up and down");
        assert_eq!(scenario(0.5, "").reach_m(), 15.0);
    }

    #[test]
    fn plans_use_the_inscribed_disk_and_bounds_the_farthest_point() {
        let windy = scenario(2.0, "max_speed_mps = 13.0\nwind_mps = [3.0, -4.0]\n"); // 5 m/s
        assert_eq!((windy.reach_m(), windy.farthest_m()), (16.0, 36.0));
        let calm = scenario(2.0, "max_speed_mps = 13.0\nwind_mps = [0.0, 0.0]\n");
        assert_eq!((calm.reach_m(), calm.farthest_m()), (26.0, 26.0));
    }

    #[test]
    fn wind_displaces_the_centre_of_reach() {
        let windy = scenario(2.0, "max_speed_mps = 13.0\nwind_mps = [3.0, -4.0]\n");
        let from = Position::new(50.0, 50.0);
        let drifted = Position::new(56.0, 42.0);
        let along = || (-40..=40).map(f64::from);
        for away in along().flat_map(|x_m| along().map(move |y_m| Vector2::new(x_m + 0.3, y_m + 0.1))) {
            let to = from + away;
            assert_eq!(windy.reaches(&from, &to), within(&drifted, &to, 26.0), "{to}");
            assert!(!windy.reaches(&from, &to) || away.norm() <= windy.farthest_m());
            assert!(windy.reaches(&from, &to) || away.norm() > windy.reach_m());
            let end = windy.end_toward(&from, &to);
            assert!(windy.reaches(&from, &end) && (end == to || ((end - drifted).norm() - 26.0).abs() < 1e-9), "{end}");
        }
        assert!(windy.reaches(&from, &from));
        assert!(!windy.reaches(&from, &Position::new(f64::NAN, 50.0)));
    }

    #[test]
    fn impossible_motion_keys_are_refused() {
        for (uav, expected) in [
            (
                "wind_mps = [18.0, -24.0]\n",
                "uav.wind_mps = [18.0, -24.0]: expected [x, y], a wind slower than uav.max_speed_mps = 30 m/s",
            ),
            ("wind_mps = [nan, 0.0]\n", "uav.wind_mps = [nan, 0.0]: expected [x, y], a wind slower"),
            ("wind_mps = [inf, 0.0]\n", "uav.wind_mps = [inf, 0.0]: expected"),
            ("wind_mps = 3.0\n", "uav.wind_mps"),
            ("acceleration_mps2 = 0.0\n", "uav.acceleration_mps2 = 0.0: expected a finite number above 0"),
            ("position_error_m = -1.0\n", "uav.position_error_m = -1.0: expected a finite number, 0 or above"),
        ] {
            let error = parsed(1.0, uav).unwrap_err();
            assert!(error.contains("a.toml") && error.contains(expected), "{error}");
        }
    }
}
