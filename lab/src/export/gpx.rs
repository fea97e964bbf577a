//! GPX 1.1: the sensor nodes as waypoints, the flight as a track.
//!
//! A mission has no date: its time counts from 1970-01-01T00:00:00Z.

use std::io;

use quick_xml::Writer;
use quick_xml::escape::partial_escape;
use quick_xml::events::{BytesDecl, BytesText, Event};
use skysink_common::geodata::projection::GeodeticPosition;
use time::format_description::well_known::Iso8601;
use time::{Duration, OffsetDateTime};

use super::format::{ExportFormat, WriteFormat};
use super::track::{GeodeticTrack, TrackPoint};

/// The track.
pub static FORMAT: ExportFormat = ExportFormat {
    name: "gpx",
    about: "GPX, for GIS and map programs: flight with time, sensor nodes",
    extension: "gpx",
    write: WriteFormat::Flight(|track| write(track).expect("a vector takes everything")),
};

type XmlWriter = Writer<Vec<u8>>;

fn write(track: &GeodeticTrack<'_>) -> io::Result<Vec<u8>> {
    let mut writer = Writer::new_with_indent(Vec::new(), b' ', 2);
    writer.write_event(Event::Decl(BytesDecl::new("1.0", Some("UTF-8"), None)))?;
    let creator = format!("skysink {}", env!("CARGO_PKG_VERSION"));
    let attributes = [("version", "1.1"), ("xmlns", "http://www.topografix.com/GPX/1/1"), ("creator", &creator)];
    writer.create_element("gpx").with_attributes(attributes).write_inner_content(|gpx| {
        gpx.create_element("metadata").write_inner_content(|metadata| text(metadata, "name", &track.name()))?;
        for (id, place) in track.sensors.iter().enumerate() {
            let label = track.run.list.label(id);
            point(gpx, "wpt", place, |waypoint| text(waypoint, "name", &label))?;
        }
        gpx.create_element("trk").write_inner_content(|flight| {
            text(flight, "name", "flight")?;
            flight.create_element("trkseg").write_inner_content(|segment| {
                track.points.iter().try_for_each(|point| track_point(segment, track, point))
            })?;
            Ok(())
        })?;
        Ok(())
    })?;
    Ok(writer.into_inner())
}

fn track_point(segment: &mut XmlWriter, track: &GeodeticTrack<'_>, at: &TrackPoint<'_>) -> io::Result<()> {
    point(segment, "trkpt", &at.place, |point| {
        text(point, "ele", &at.position.z.to_string())?;
        // GPX has no dates after the year 9999.
        let since = Duration::checked_seconds_f64(at.time_s);
        let time = since.and_then(|since| OffsetDateTime::UNIX_EPOCH.checked_add(since));
        if let Some(time) = time.and_then(|time| time.format(&Iso8601::DEFAULT).ok()) {
            text(point, "time", &time)?;
        }
        let served = track.served_labels(at);
        if served.is_empty() { Ok(()) } else { text(point, "cmt", &served) }
    })
}

fn point(
    around: &mut XmlWriter,
    name: &str,
    place: &GeodeticPosition,
    inner: impl FnOnce(&mut XmlWriter) -> io::Result<()>,
) -> io::Result<()> {
    // GPX has longitudes below 180.
    let lon_deg = if place.lon_deg == 180.0 { -180.0 } else { place.lon_deg };
    let [lat, lon] = [place.lat_deg, lon_deg].map(|deg| deg.to_string());
    let element = around.create_element(name).with_attributes([("lat", lat.as_str()), ("lon", lon.as_str())]);
    element.write_inner_content(inner)?;
    Ok(())
}

fn text(around: &mut XmlWriter, name: &str, content: &str) -> io::Result<()> {
    around.create_element(name).write_text_content(BytesText::from_escaped(partial_escape(content)))?;
    Ok(())
}
