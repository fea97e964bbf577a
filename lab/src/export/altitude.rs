//! What the altitudes of a mission are above, and how high it flies over hills.

use clap::ValueEnum;
use nalgebra::Point3;
use skysink_common::error::InputError;
use skysink_common::geometry::Position;

use super::autopilot::Autopilot;
use super::ground::Ground;
use super::track::{GeodeticTrack, GeodeticZone};

/// What altitudes are above, by its `MAV_FRAME`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum AltitudeReference {
    /// Home; over hills high enough for the highest ground of each leg.
    Relative = 3,
    /// The ground below, by the terrain data of the autopilot.
    Terrain = 10,
    /// Sea level, or what the altitudes of the sensor list are above; high enough for the highest ground of each leg.
    Msl = 0,
}

impl AltitudeReference {
    /// QGroundControl's code.
    pub fn altitude_mode(self) -> u32 {
        match self {
            Self::Relative => 1,
            Self::Msl => 2,
            Self::Terrain => 4,
        }
    }
}

/// The altitudes of a mission over the ground that the sensor list tells.
#[derive(Debug)]
pub struct Altitudes {
    /// What they are above.
    pub reference: AltitudeReference,
    /// The ground at home [m], as it was given or as low as it can be; `None` if nothing tells it.
    pub home_ground_m: Option<f64>,
    /// The ground; `None` if the list does not tell it.
    ground: Option<Ground>,
}

impl Altitudes {
    /// The altitudes above `reference`, by default the ground below if the list has hills and the `autopilot` accepts
    /// that frame, and otherwise home. The ground at home is `home_ground_m` [m] if it is given.
    ///
    /// # Errors
    /// If they are to be above sea level or the ground at home is given, and the list has no altitudes.
    pub fn of(
        track: &GeodeticTrack<'_>,
        reference: Option<AltitudeReference>,
        home_ground_m: Option<f64>,
        autopilot: Option<Autopilot>,
    ) -> Result<Self, InputError> {
        let mut ground = Ground::of(&track.run.list);
        let home = track.points[0].position.xy();
        match (home_ground_m, &mut ground) {
            (Some(ground_m), Some(ground)) => ground.add(&home, ground_m),
            (Some(ground_m), None) => {
                let message = format_args!("--home-ground {ground_m}: expected a sensor list with the column ground_m");
                return Err(InputError::new("scenario", &track.run.scenario.path, message));
            }
            (None, _) => {}
        }
        if reference == Some(AltitudeReference::Msl) && ground.is_none() {
            let scenario = &track.run.scenario.path;
            let message = "--altitude msl: expected a sensor list with the column ground_m, or another --altitude";
            return Err(InputError::new("scenario", scenario, message));
        }
        let is_hilly = ground.as_ref().is_some_and(Ground::is_hilly);
        let default = match autopilot {
            Some(Autopilot::Ardupilot) if is_hilly => AltitudeReference::Terrain,
            _ => AltitudeReference::Relative, // PX4 refuses missions in the frame of the terrain
        };
        let home_ground_m = home_ground_m.or_else(|| ground.as_ref().map(|ground| ground.lowest_m(&home)));
        Ok(Self { reference: reference.unwrap_or(default), home_ground_m, ground })
    }

    /// The ground at home [m], or the level that home is taken to be on.
    fn home_m(&self) -> f64 {
        self.home_ground_m.unwrap_or(0.0)
    }

    /// The ground that the altitudes have to clear; `None` if they are above the ground, or the list does not tell it.
    fn ground_to_clear(&self) -> Option<&Ground> {
        self.ground.as_ref().filter(|_| self.reference != AltitudeReference::Terrain)
    }

    /// An altitude of the mission [m] above home; one above the ground below as it is.
    pub fn above_home_m(&self, altitude_m: f64) -> f64 {
        if self.reference == AltitudeReference::Msl { altitude_m - self.home_m() } else { altitude_m }
    }

    /// How high above the ground at a place an altitude of the mission can be [m]; `None` if it is above the ground
    /// below, or the list does not tell the ground.
    pub fn above_ground_m(&self, at: &Position, altitude_m: f64) -> Option<f64> {
        Some(self.above_home_m(altitude_m) + self.home_m() - self.ground_to_clear()?.lowest_m(at))
    }

    /// The altitude of a take-off at `home`, above it, and of each of the `waypoints` after it [m]: both ends of a leg
    /// are as far above its highest ground as the model flies above the ground.
    pub fn along(&self, home: &Point3<f64>, waypoints: &[Point3<f64>]) -> Vec<f64> {
        let nodes = || std::iter::once(home).chain(waypoints);
        let Some(ground) = self.ground_to_clear() else { return nodes().map(|node| node.z).collect() };
        let legs = nodes().zip(waypoints);
        let mut tops_m = vec![ground.highest_m(&home.xy())];
        tops_m.extend(legs.map(|(from, to)| ground.highest_between_m(&from.xy(), &to.xy())));
        tops_m.push(f64::NEG_INFINITY); // no leg after the last waypoint
        let level_m = if self.reference == AltitudeReference::Relative { self.home_m() } else { 0.0 };
        let levels_m = std::iter::once(self.home_m()).chain(std::iter::repeat(level_m)); // the take-off is above home
        let nodes = nodes().zip(tops_m.windows(2)).zip(levels_m);
        nodes.map(|((node, tops_m), level_m)| node.z + tops_m[0].max(tops_m[1]) - level_m).collect()
    }

    /// The altitude above home at which a straight way home from any of the `places` is as far above the ground as the
    /// model flies [m]; `None` if the list does not tell the ground.
    pub fn return_m(&self, home: &Point3<f64>, places: impl Iterator<Item = Position>) -> Option<f64> {
        let ground = self.ground.as_ref()?;
        let tops_m = places.map(|at| ground.highest_between_m(&at, &home.xy()));
        Some(home.z + tops_m.fold(ground.highest_m(&home.xy()), f64::max) - self.home_m())
    }

    /// The altitude above home that clears the roofs of all buildings by `margin_m` [m]; `None` if the model flies
    /// above it, or there are none.
    pub fn over_roofs_m(&self, home: &Point3<f64>, zones: &[GeodeticZone], margin_m: f64) -> Option<f64> {
        let base_m = |zone: &GeodeticZone| {
            let Some(ground) = &self.ground else { return 0.0 };
            let corners = zone.outline.corners();
            let edges = corners.iter().zip(corners.iter().cycle().skip(1));
            edges.map(|(from, to)| ground.highest_between_m(from, to)).fold(f64::NEG_INFINITY, f64::max) - self.home_m()
        };
        let roofs_m = zones.iter().filter_map(|zone| Some(base_m(zone) + zone.height_m? + margin_m));
        roofs_m.reduce(f64::max).filter(|roof_m| *roof_m > home.z)
    }
}
