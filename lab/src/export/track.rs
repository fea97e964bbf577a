//! A finished mission in latitude and longitude, the common input of the formats.

use nalgebra::{Point3, UnitQuaternion};
use skysink_common::airspace::Polygon;
use skysink_common::error::InputError;
use skysink_common::geodata::projection::{GeodeticPosition, Projection};
use skysink_common::geometry::Position;
use skysink_common::message::Mode;
use skysink_common::scenario::{Origin, Scenario};
use skysink_mission::replay::RecordedRun;
use skysink_mission::trace::RecordedSlot;

use super::fence;
use super::ground::Ground;

/// Degrees are rounded to 1/PER_DEGREE, about 0.1 mm, so that files do not depend on the last digits of a sine.
const PER_DEGREE: f64 = 1e9;

/// A UAV that moves less than this [m] keeps its attitude.
const LEAST_MOVE_M: f64 = 1e-6;

/// The position of the UAV at one time.
#[derive(Debug, Clone, Copy)]
pub struct TrackPoint<'a> {
    /// Time since the start [s].
    pub time_s: f64,
    /// The position on the ground below it.
    pub place: GeodeticPosition,
    /// The position in the frame of the area [m]; z is the altitude above ground.
    pub position: Point3<f64>,
    /// The slot that ends here; `None` at the start.
    pub slot: Option<&'a RecordedSlot>,
}

impl TrackPoint<'_> {
    /// The sensor nodes that are served from here.
    pub fn served(&self) -> &[u32] {
        self.slot.map_or(&[], |slot| &slot.scheduled)
    }

    /// Whether the UAV stands in the base, to charge or for good.
    pub fn is_on_ground(&self) -> bool {
        self.slot.is_some_and(|slot| slot.mode == Mode::Charge)
    }
}

/// A finished mission in geodetic coordinates.
#[derive(Debug)]
pub struct GeodeticTrack<'a> {
    pub run: &'a RecordedRun,
    pub uav: usize,
    projection: Projection,
    /// The start, then the position after each slot.
    pub points: Vec<TrackPoint<'a>>,
    /// The sensor nodes, by id.
    pub sensors: Vec<GeodeticPosition>,
    /// The border of the area from its south-west corner, counter-clockwise, without the first point again at the end.
    pub border: Vec<GeodeticPosition>,
    /// The no-fly zones and the buildings.
    pub zones: Vec<GeodeticZone>,
}

/// A no-fly zone or a building.
#[derive(Debug)]
pub struct GeodeticZone {
    /// Its outline in the frame of the area.
    pub outline: Polygon,
    /// Its corners, counter-clockwise, without the first one again at the end.
    pub corners: Vec<GeodeticPosition>,
    /// Height of the building [m]; `None` for a no-fly zone.
    pub height_m: Option<f64>,
    /// Whether the UAV flies around it at all altitudes.
    pub is_tall: bool,
}

impl<'a> GeodeticTrack<'a> {
    /// Converts the mission of the UAV number `uav` from the plane that is tangent to the Earth at the origin.
    pub fn new(run: &'a RecordedRun, uav: usize, origin: Origin) -> Result<Self, InputError> {
        let scenario = &run.scenario;
        let projection = Projection::at(origin);
        let place = |position: &Position| place(&projection, scenario, position);
        let start = (scenario.start_of(uav), None);
        let slots = run.slots.iter().map(|slot| (slot[uav].position, Some(&slot[uav])));
        let point = |(position, slot): (Point3<f64>, Option<&'a RecordedSlot>)| {
            let time_s = slot.map_or(0.0, |slot| slot.slot as f64 * scenario.slot_s);
            Ok(TrackPoint { time_s, place: place(&position.xy())?, position, slot })
        };
        Ok(Self {
            run,
            uav,
            projection,
            points: std::iter::once(start).chain(slots).map(point).collect::<Result<_, InputError>>()?,
            sensors: run.list.sensors().iter().map(|sensor| place(&sensor.position)).collect::<Result<_, _>>()?,
            zones: zones(scenario, place)?,
            border: fence::border(&scenario.area, 0.0).iter().map(place).collect::<Result<_, _>>()?,
        })
    }

    /// The points up to the last landing.
    pub fn flown(&self) -> &[TrackPoint<'a>] {
        let is_flown = |point: &TrackPoint<'_>| !point.is_on_ground() || !point.served().is_empty();
        &self.points[..=self.points.iter().rposition(is_flown).unwrap_or(0)]
    }

    /// A position of the plane on the ground.
    pub fn place(&self, position: &Position) -> Result<GeodeticPosition, InputError> {
        place(&self.projection, &self.run.scenario, position)
    }

    /// The attitude at each point in the frame of the area: level, the x axis in the direction of the last move, before
    /// the first move in that of the first.
    pub fn attitudes(&self) -> Vec<UnitQuaternion<f64>> {
        let yaws = self.points.windows(2).map(|pair| {
            let step = pair[1].position.xy() - pair[0].position.xy();
            (step.norm() > LEAST_MOVE_M).then(|| step.y.atan2(step.x))
        });
        let yaws: Vec<Option<f64>> = yaws.collect();
        let mut yaw_rad = yaws.iter().flatten().next().copied().unwrap_or(0.0);
        let all = std::iter::once(None).chain(yaws).map(|yaw| {
            yaw_rad = yaw.unwrap_or(yaw_rad);
            UnitQuaternion::from_euler_angles(0.0, 0.0, yaw_rad)
        });
        all.collect()
    }

    /// The altitude of each point [m]: above what `ground_m` of the sensor list is above, with the ground midway
    /// between its bounds, or above the ground below if the list does not tell it.
    pub fn altitudes_m(&self) -> Vec<f64> {
        let ground = Ground::of(&self.run.list);
        let midway_m = |ground: &Ground, at: &Position| f64::midpoint(ground.lowest_m(at), ground.highest_m(at));
        let ground_m =
            |point: &TrackPoint<'_>| ground.as_ref().map_or(0.0, |ground| midway_m(ground, &point.position.xy()));
        self.points.iter().map(|point| point.position.z + ground_m(point)).collect()
    }

    /// Bits that the UAV collects in the slot that ends at the point number `index`.
    pub fn delivered_bits(&self, index: usize) -> u64 {
        let slot = index.checked_sub(1).and_then(|slot| self.run.uploads_bits.get(slot));
        slot.map_or(0, |slot| slot[self.uav].iter().sum())
    }

    /// The points from which sensor nodes are served, with the slot of each.
    pub fn services(&self) -> impl Iterator<Item = (&TrackPoint<'a>, u64)> {
        let service = |point: &'_ TrackPoint<'a>| point.slot.filter(|slot| !slot.scheduled.is_empty());
        self.points.iter().filter_map(move |point| service(point).map(|slot| (point, slot.slot)))
    }
}

fn place(projection: &Projection, scenario: &Scenario, position: &Position) -> Result<GeodeticPosition, InputError> {
    projection.unproject(position).map(rounded).ok_or_else(|| {
        let sides_m = format!("{} m × {} m", scenario.area.width_m(), scenario.area.height_m());
        let expected = "expected one that fits on the Earth";
        InputError::new("scenario", &scenario.path, format_args!("an area of {sides_m}: {expected}"))
    })
}

/// The no-fly zones and the buildings, with their corners in their `place`.
fn zones(
    scenario: &Scenario,
    place: impl Fn(&Position) -> Result<GeodeticPosition, InputError>,
) -> Result<Vec<GeodeticZone>, InputError> {
    let lowest_m = scenario.uav.climb().map_or(scenario.uav.altitude_m, |climb| climb.min_altitude_m);
    let no_fly = scenario.area.no_fly.iter().flatten().map(|zone| (zone.corners(), None));
    let buildings = scenario.area.building.iter().flatten();
    let zones = no_fly.chain(buildings.map(|building| (&building.polygon_m[..], Some(building.height_m))));
    let zone = |(corners, height_m): (&[[f64; 2]], Option<f64>)| {
        let outline = Polygon::of(corners, false).expect("the zones of a run are checked");
        let corners = outline.corners().iter().map(&place).collect::<Result<_, _>>()?;
        Ok(GeodeticZone { outline, corners, height_m, is_tall: height_m.is_none_or(|height_m| height_m > lowest_m) })
    };
    zones.map(zone).collect()
}

fn rounded(place: GeodeticPosition) -> GeodeticPosition {
    let [lat_deg, lon_deg] = [place.lat_deg, place.lon_deg].map(|degrees| (degrees * PER_DEGREE).round() / PER_DEGREE);
    GeodeticPosition { lat_deg, lon_deg }
}
