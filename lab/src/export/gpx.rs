//! GPX 1.1: the sensor nodes as waypoints, the flight as a track.
//!
//! A mission has no date: its time counts from 1970-01-01T00:00:00Z.

use gpx::{Gpx, GpxVersion, Metadata, Track, TrackSegment, Waypoint};
use skysink_common::geodata::projection::GeodeticPosition;
use time::{Duration, OffsetDateTime};

use super::format::{ExportFormat, WriteFormat};
use super::track::{GeodeticTrack, TrackPoint};

/// The track.
pub static FORMAT: ExportFormat = ExportFormat {
    name: "gpx",
    about: "GPX, for GIS and map programs: flight with time, sensor nodes",
    extension: "gpx",
    write: WriteFormat::Flight(write),
};

fn write(track: &GeodeticTrack<'_>) -> Vec<u8> {
    let sensor = |(id, place): (usize, &GeodeticPosition)| {
        let mut sensor = at(place);
        sensor.name = Some(track.run.list.label(id));
        sensor
    };
    let segment = TrackSegment { points: track.points.iter().map(|point| waypoint(track, point)).collect() };
    let gpx = Gpx {
        version: GpxVersion::Gpx11,
        creator: Some(format!("skysink {}", env!("CARGO_PKG_VERSION"))),
        metadata: Some(Metadata { name: Some(track.name()), ..Metadata::default() }),
        waypoints: track.sensors.iter().enumerate().map(sensor).collect(),
        tracks: vec![Track { name: Some("flight".to_owned()), segments: vec![segment], ..Track::default() }],
        ..Gpx::default()
    };
    let mut text = Vec::new();
    gpx::write(&gpx, &mut text).expect("a vector takes everything");
    text
}

fn waypoint(track: &GeodeticTrack<'_>, point: &TrackPoint<'_>) -> Waypoint {
    let mut waypoint = at(&point.place);
    waypoint.elevation = Some(point.position.z);
    // GPX has no dates after the year 9999.
    let since = Duration::checked_seconds_f64(point.time_s);
    waypoint.time = since.and_then(|since| OffsetDateTime::UNIX_EPOCH.checked_add(since)).map(Into::into);
    waypoint.comment = Some(track.served_labels(point)).filter(|text| !text.is_empty());
    waypoint
}

fn at(place: &GeodeticPosition) -> Waypoint {
    Waypoint::new(geo_types::Point::new(place.lon_deg, place.lat_deg))
}
