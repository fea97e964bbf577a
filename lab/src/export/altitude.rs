//! What the altitudes of a mission are above, and how high it flies over hills.

use clap::ValueEnum;
use nalgebra::Point3;
use skysink_common::error::InputError;

use super::ground::Ground;
use super::track::GeodeticTrack;

/// What altitudes are above.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum AltitudeReference {
    /// Home; over hills high enough for the highest ground of each leg.
    Relative,
    /// The ground below, by the terrain data of the autopilot.
    Terrain,
    /// Sea level, or what the altitudes of the sensor list are above; high enough for the highest ground of each leg.
    Msl,
}

impl AltitudeReference {
    /// Its `MAV_FRAME`.
    #[must_use]
    pub fn frame(self) -> u8 {
        match self {
            Self::Relative => 3,
            Self::Terrain => 10,
            Self::Msl => 0,
        }
    }

    /// QGroundControl's code.
    #[must_use]
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
    /// The ground; `None` if the list does not tell it.
    ground: Option<Ground>,
    /// The ground at home, as low as it can be [m]; 0 if it is not known.
    home_m: f64,
}

impl Altitudes {
    /// The altitudes above `reference`, by default the ground below if the list has hills, and otherwise home.
    ///
    /// # Errors
    /// If they are to be above sea level, and the list has no altitudes.
    pub fn of(track: &GeodeticTrack<'_>, reference: Option<AltitudeReference>) -> Result<Self, InputError> {
        let ground = Ground::of(&track.run.list);
        if reference == Some(AltitudeReference::Msl) && ground.is_none() {
            let scenario = &track.run.scenario.path;
            let message = "--altitude msl: expected a sensor list with the column ground_m, or another --altitude";
            return Err(InputError::new("scenario", scenario, message));
        }
        let is_hilly = ground.as_ref().is_some_and(Ground::is_hilly);
        let default = if is_hilly { AltitudeReference::Terrain } else { AltitudeReference::Relative };
        let home_m = ground.as_ref().map_or(0.0, |ground| ground.lowest_m(&track.points[0].position.xy()));
        Ok(Self { reference: reference.unwrap_or(default), ground, home_m })
    }

    /// The ground at home, as low as it can be [m]; `None` if the list does not tell it.
    #[must_use]
    pub fn home_ground_m(&self) -> Option<f64> {
        self.ground.as_ref().map(|_| self.home_m)
    }

    /// An altitude of the mission [m] above home; one above the ground below as it is.
    #[must_use]
    pub fn above_home_m(&self, altitude_m: f64) -> f64 {
        if self.reference == AltitudeReference::Msl { altitude_m - self.home_m } else { altitude_m }
    }

    /// How high above the ground at a place an altitude of the mission can be [m]; `None` if it is above the ground below, or the
    /// list does not tell the ground.
    #[must_use]
    pub fn above_ground_m(&self, at: &Point3<f64>, altitude_m: f64) -> Option<f64> {
        let ground = self.ground.as_ref().filter(|_| self.reference != AltitudeReference::Terrain)?;
        Some(self.above_home_m(altitude_m) + self.home_m - ground.lowest_m(&at.xy()))
    }

    /// The altitude of a take-off at `home`, above it, and of each of the waypoints `nodes` after it [m]: so high that every leg
    /// between them is as far above the ground as the model flies.
    #[must_use]
    pub fn along(&self, home: Point3<f64>, nodes: &[Point3<f64>]) -> Vec<f64> {
        let ground = self.ground.as_ref().filter(|_| self.reference != AltitudeReference::Terrain);
        let all = || std::iter::once(&home).chain(nodes);
        let Some(ground) = ground else { return all().map(|node| node.z).collect() };
        let mut tops_m: Vec<f64> =
            all().zip(nodes).map(|(from, to)| ground.highest_between_m(&from.xy(), &to.xy())).collect();
        tops_m.push(f64::NEG_INFINITY);
        let above_m = if self.reference == AltitudeReference::Relative { self.home_m } else { 0.0 };
        let mut before_m = ground.highest_m(&home.xy());
        let mut altitudes_m = Vec::with_capacity(tops_m.len());
        for (node, &after_m) in all().zip(&tops_m) {
            // The take-off is above home.
            let from_m = if altitudes_m.is_empty() { self.home_m } else { above_m };
            altitudes_m.push(node.z + before_m.max(after_m) - from_m);
            before_m = after_m;
        }
        altitudes_m
    }
}
