//! A flown mission in latitude and longitude: what every format writes.

use nalgebra::Point3;
use skysink_common::error::InputError;
use skysink_common::geometry::Position;
use skysink_common::scenario::{Area, Origin};
use skysink_common::sensors::projection::{GeodeticPosition, Projection};
use skysink_mission::recorded::RecordedRun;
use skysink_mission::trace::RecordedSlot;

/// Longest side of the fence [m]: between its ends a straight line of the plane leaves the line of constant direction
/// on a map by about `L² tan φ/8R`, half a metre at mid-latitudes.
const FENCE_SIDE_M: f64 = 5000.0;

/// Most sides of the fence along one side of the area: vehicles take some 60 corners.
const MAX_FENCE_SIDES: f64 = 15.0;

/// Degrees are rounded to this fraction, 0.1 mm, so that no last digit of a sine is in a file.
const PER_DEGREE: f64 = 1e9;

/// The UAV at one time.
#[derive(Debug, Clone, Copy)]
pub struct TrackPoint<'a> {
    /// Since the start [s].
    pub time_s: f64,
    /// On the ground below it.
    pub place: GeodeticPosition,
    /// In the frame of the area [m]; z is the altitude above the ground.
    pub position: Point3<f64>,
    /// The slot that ends here; none at the start.
    pub slot: Option<&'a RecordedSlot>,
}

impl TrackPoint<'_> {
    /// The sensor nodes served from here.
    #[must_use]
    pub fn served(&self) -> &[u32] {
        self.slot.map_or(&[], |slot| &slot.scheduled)
    }

    /// The same, joined by spaces.
    #[must_use]
    pub fn served_text(&self) -> String {
        self.served().iter().map(u32::to_string).collect::<Vec<_>>().join(" ")
    }
}

/// A flown mission with its places on the Earth.
#[derive(Debug)]
pub struct GeodeticTrack<'a> {
    /// The mission.
    pub run: &'a RecordedRun,
    /// The start, then the UAV after each slot.
    pub points: Vec<TrackPoint<'a>>,
    /// The sensor nodes, by id.
    pub sensors: Vec<GeodeticPosition>,
    /// The rim of the area from its south-west corner, counter-clockwise, without the first place again at the end.
    pub rim: Vec<GeodeticPosition>,
}

impl<'a> GeodeticTrack<'a> {
    /// The mission on the plane that touches the Earth at the origin.
    ///
    /// # Errors
    /// If the area reaches beyond the Earth's rim.
    pub fn new(run: &'a RecordedRun, origin: Origin) -> Result<Self, InputError> {
        let scenario = &run.scenario;
        let projection = Projection::at(origin);
        let place = |position: &Position| {
            projection.unproject(position).map(rounded).ok_or_else(|| {
                let sides_m = format!("{} m × {} m", scenario.area.width_m(), scenario.area.height_m());
                let expected = "expected one on this side of the Earth";
                InputError::new("scenario", &scenario.path, format_args!("an area of {sides_m}: {expected}"))
            })
        };
        let start = (scenario.start(), None);
        let slots = run.slots.iter().map(|slot| (slot.position, Some(slot)));
        let point = |(position, slot): (Point3<f64>, Option<&'a RecordedSlot>)| {
            let time_s = slot.map_or(0.0, |slot| slot.slot as f64 * scenario.slot_s);
            Ok(TrackPoint { time_s, place: place(&position.xy())?, position, slot })
        };
        Ok(Self {
            run,
            points: std::iter::once(start).chain(slots).map(point).collect::<Result<_, InputError>>()?,
            sensors: run.list.sensors().iter().map(|sensor| place(&sensor.position)).collect::<Result<_, _>>()?,
            rim: rim(&scenario.area).iter().map(place).collect::<Result<_, _>>()?,
        })
    }

    /// Scenario, strategy and seed.
    #[must_use]
    pub fn name(&self) -> String {
        let RecordedRun { scenario, strategy, .. } = self.run;
        format!("{} {strategy} seed {}", scenario.name, scenario.seed)
    }

    /// The points from which sensor nodes are served, with the slot of each.
    pub fn services(&self) -> impl Iterator<Item = (&TrackPoint<'a>, u64)> {
        let service = |point: &'_ TrackPoint<'a>| point.slot.filter(|slot| !slot.scheduled.is_empty());
        self.points.iter().filter_map(move |point| service(point).map(|slot| (point, slot.slot)))
    }
}

/// Points along the rim of the area, counter-clockwise from the south-west.
fn rim(area: &Area) -> Vec<Position> {
    let [width_m, height_m] = [area.width_m(), area.height_m()];
    let corners = [[0.0, 0.0], [width_m, 0.0], [width_m, height_m], [0.0, height_m]].map(Position::from);
    let side = |index: usize| {
        let (from, to) = (corners[index], corners[(index + 1) % 4]);
        let parts = ((to - from).norm() / FENCE_SIDE_M).ceil().clamp(1.0, MAX_FENCE_SIDES) as u32;
        (0..parts).map(move |part| from + (to - from) * (f64::from(part) / f64::from(parts)))
    };
    (0..4).flat_map(side).collect()
}

fn rounded(place: GeodeticPosition) -> GeodeticPosition {
    let [lat_deg, lon_deg] = [place.lat_deg, place.lon_deg].map(|degrees| (degrees * PER_DEGREE).round() / PER_DEGREE);
    GeodeticPosition { lat_deg, lon_deg }
}
