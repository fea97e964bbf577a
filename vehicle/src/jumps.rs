//! Whether a vehicle can be where it says it is: nobody jumps.

use nalgebra::Point3;

/// Distance that an estimate of a position may be off [m].
const SLACK_M: f64 = 20.0;

/// The lowest limit of a speed [m/s]: wind, and other limits of the vehicle.
const LEAST_MPS: f64 = 20.0;

/// How long the distance that may have been flown since the last plausible position grows while others come [s].
const GROWS_S: f64 = 3.0;

/// How long a position is in doubt after a jump [s].
const DOUBT_S: f64 = 1.0;

/// Whether a position is plausible.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Plausibility {
    /// It can be there.
    Plausible,
    /// It can be there again after a jump.
    Again,
    /// It cannot: it jumped by this distance [m]; `None` for a place that is not on this side of the Earth.
    Jump {
        /// The distance [m].
        away_m: Option<f64>,
    },
    /// It still cannot.
    StillAway,
}

/// The jumps of a position.
#[derive(Debug, Clone)]
pub struct Jumps {
    limit_mps: f64,
    /// The last plausible position, and when it came [s].
    last: Option<(Point3<f64>, f64)>,
    /// When the last position came, plausible or not [s].
    heard_s: f64,
    /// When the last one came that was not [s].
    jumped_s: Option<f64>,
    is_away: bool,
    /// Since when no position was plausible [s].
    away_s: f64,
}

impl Jumps {
    /// Of a vehicle that flies at most this fast over ground [m/s].
    #[must_use]
    pub fn at_most(speed_mps: f64) -> Self {
        let limit_mps = (2.0 * speed_mps).max(LEAST_MPS);
        Self { limit_mps, last: None, heard_s: 0.0, jumped_s: None, is_away: false, away_s: 0.0 }
    }

    /// Takes in a position [m].
    pub fn admit(&mut self, position: Option<Point3<f64>>, now_s: f64) -> Plausibility {
        let silence_s = now_s - self.heard_s;
        self.heard_s = now_s;
        let away_m = match (position, self.last) {
            (Some(position), Some((last, _))) => Some((position - last).norm()),
            (Some(_), None) => Some(0.0),
            (None, _) => None,
        };
        let since_s = self.last.map_or(0.0, |(_, last_s)| now_s - last_s);
        let allowed_m = SLACK_M + self.limit_mps * since_s.min(GROWS_S.max(silence_s));
        let was_away = std::mem::replace(&mut self.is_away, !away_m.is_some_and(|away_m| away_m <= allowed_m));
        match (position, self.is_away) {
            (Some(position), false) => {
                self.last = Some((position, now_s));
                if was_away { Plausibility::Again } else { Plausibility::Plausible }
            }
            _ => {
                self.jumped_s = Some(now_s);
                if !was_away {
                    self.away_s = now_s;
                }
                if was_away { Plausibility::StillAway } else { Plausibility::Jump { away_m } }
            }
        }
    }

    /// How long no position was plausible [s]; 0 if the last one was.
    pub fn away_for_s(&self, now_s: f64) -> f64 {
        if self.is_away { now_s - self.away_s } else { 0.0 }
    }

    /// Whether a position was not plausible just now.
    pub fn is_doubtful(&self, now_s: f64) -> bool {
        self.jumped_s.is_some_and(|jumped_s| now_s - jumped_s < DOUBT_S)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(jumps: &mut Jumps, x_m: f64, now_s: f64) -> Plausibility {
        jumps.admit(Some(Point3::new(x_m, 0.0, 20.0)), now_s)
    }

    #[test]
    fn a_flight_is_plausible_and_a_jump_is_not() {
        let mut jumps = Jumps::at_most(15.0);
        assert_eq!(at(&mut jumps, 5_000.0, 1.0), Plausibility::Plausible, "the first");
        assert!((1..100).all(|step| at(&mut jumps, 5_000.0 + 3.0 * f64::from(step), 1.0 + 0.1 * f64::from(step))
            == Plausibility::Plausible));
        assert_eq!(at(&mut jumps, 55_297.0, 11.0), Plausibility::Jump { away_m: Some(50_000.0) });
        assert_eq!(at(&mut jumps, 55_297.0, 11.1), Plausibility::StillAway);
        assert!(jumps.is_doubtful(12.0) && !jumps.is_doubtful(12.2));
        assert!((jumps.away_for_s(11.2) - 0.2).abs() < 1e-9, "since the jump");
        assert_eq!(jumps.admit(None, 11.2), Plausibility::StillAway);
        assert_eq!(at(&mut jumps, 5_300.0, 11.3), Plausibility::Again);
        assert_eq!(at(&mut jumps, 5_300.0, 11.4), Plausibility::Plausible);
    }

    #[test]
    fn a_far_place_does_not_become_plausible_by_waiting_and_a_near_one_does() {
        for (away_m, is_believed) in [(60.0, true), (109.0, true), (111.0, false), (50_000.0, false)] {
            let mut jumps = Jumps::at_most(15.0);
            let _ = at(&mut jumps, 0.0, 1_000.0);
            let is_again =
                (1..100_000).any(|step| at(&mut jumps, away_m, 1_000.0 + 0.1 * f64::from(step)) == Plausibility::Again);
            assert_eq!(is_again, is_believed, "{away_m} m");
        }
    }

    #[test]
    fn without_a_link_it_may_have_flown_all_the_time() {
        let mut jumps = Jumps::at_most(15.0);
        let _ = at(&mut jumps, 0.0, 0.0);
        assert_eq!(at(&mut jumps, 1_800.0, 60.0), Plausibility::Plausible);
        assert_eq!(at(&mut jumps, 3_700.0, 120.0), Plausibility::Jump { away_m: Some(1_900.0) });
    }
}
