//! GPX 1.0 and 1.1: imports the waypoints; ignores tracks and routes, and all that it does not need.

use skysink_common::error::quoted;
use skysink_common::geodata::xml::{self, XmlElement};
use skysink_common::geodata::{FoundPoint, FoundPoints, IgnoredItem, NAME, SourceText, check_geodetic};

use super::imported::Imported;

/// Elements of a file that are no waypoints, and what they are called.
const OTHERS: [(&str, &str); 2] = [("trk", "track"), ("rte", "route")];

/// Reads the text of a file, whose positions are in degrees of WGS84.
pub fn read(source: &SourceText<'_>) -> Result<Imported, String> {
    let file = xml::parse(source.text, "GPX", &["gpx"])?;
    let mut found = FoundPoints::default();
    for child in &file.children {
        if child.name == "wpt" {
            let place = format!("point {}", found.points.len() + 1);
            found.points.push(waypoint(child).map_err(|message| format!("{place}: {message}"))?);
        }
        let other = OTHERS.iter().find(|(other, _)| *other == child.name);
        let name = child.text_of(NAME).map(str::to_owned);
        found.ignored.extend(other.map(|(_, kind)| IgnoredItem { kind, name }));
    }
    Imported::geodetic(found)
}

fn waypoint(waypoint: &XmlElement) -> Result<FoundPoint, String> {
    let number = |name: &str, text: &str| {
        let number = text.parse().ok().filter(|number: &f64| number.is_finite());
        number.ok_or_else(|| format!("{name} = {}: expected a number", quoted(text)))
    };
    let degrees = |name: &str| {
        let text = waypoint.attribute(name).ok_or_else(|| format!("no attribute {name}: expected lat and lon"))?;
        number(name, text)
    };
    let position = [degrees("lat")?, degrees("lon")?];
    check_geodetic(position)?;
    let altitude_m = waypoint.text_of("ele").map(|text| number("ele", text)).transpose()?;
    let name = waypoint.text_of(NAME).map(|name| (NAME.to_owned(), name.to_owned()));
    Ok(FoundPoint { position, altitude_m, properties: name.into_iter().collect() })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Imported, String> {
        super::read(&SourceText { text, ..SourceText::default() })
    }

    const FILE: &str = "<?xml version=\"1.0\"?><gpx version=\"1.1\" creator=\"a\" \
                        xmlns=\"http://www.topografix.com/GPX/1/1\"><wpt lat=\"51.5\" lon=\"-0.1\"><name>a</name></wpt>\
                        <wpt lat=\"51.6\" lon=\"0.2\"/><trk><name>t</name></trk></gpx>";

    #[test]
    fn waypoints_are_points() {
        let imported = read(FILE).unwrap();
        let points: Vec<[f64; 2]> = imported.sensors.iter().map(|sensor| sensor.position).collect();
        assert_eq!(points, [[51.5, -0.1], [51.6, 0.2]]);
        assert_eq!(imported.ignored.len(), 1, "a track");
        assert_eq!(imported.to_csv([0.0; 2]), "lat_deg,lon_deg,name\n51.5,-0.1,a\n51.6,0.2,\n");
    }

    #[test]
    fn a_truncated_file_is_refused() {
        for cut in FILE.find("<wpt").unwrap()..FILE.len() - 1 {
            assert!(read(&FILE[..cut]).is_err(), "{}", &FILE[..cut]);
        }
    }

    #[test]
    fn what_loggers_write_besides_is_ignored() {
        let point = "<wpt lat=\"51.5\" lon=\"-0.1\"><name>a</name></wpt>";
        let with = |inner: &str| format!("<gpx>{}</gpx>", point.replace("<name>", &format!("{inner}<name>")));
        for file in [
            with("<magvar>2.5</magvar>"),
            with("<course>90</course><speed>1</speed>"),
            with("<cmt/><sym></sym><ele></ele><desc> </desc>"),
            with("<time>2026-05-01 10:00:00</time>"),
            with("<extensions><gpxx:Depth>1<b/></gpxx:Depth></extensions>"),
            with("<link href=\"x\"><text>y</text></link>"),
            format!("<gpx version=\"0.9\"><metadata><time></time></metadata>{point}</gpx>"),
            format!("<gpx version=\"\" creator=\"\" xmlns=\"http://www.topografix.com/GPX/1/0\">{point}</gpx>"),
            format!("<?xml version=\"1.1\"?><!DOCTYPE gpx><x:gpx xmlns:x=\"y\"><bounds/>{point}</x:gpx>"),
            format!("<gpx><trk><trkseg><trkpt lat=\"x\"><course>1</course></trkpt></trkseg></trk>{point}</gpx>"),
            format!("<gpx>{}</gpx>", point.replace("51.5", " 51.5\n")),
        ] {
            let imported = read(&file).unwrap_or_else(|message| panic!("{file}: {message}"));
            assert_eq!(imported.to_csv([0.0; 2]), "lat_deg,lon_deg,name\n51.5,-0.1,a\n", "{file}");
        }
        let high = read(&with("<ele> 466 </ele>")).unwrap();
        assert_eq!(high.to_csv([0.0; 2]), "lat_deg,lon_deg,name\n51.5,-0.1,a\n");
        assert!(high.ignored[0].starts_with("heights of 1 of 1 points"), "{:?}", high.ignored);
    }

    #[test]
    fn invalid_gpx_is_refused() {
        assert_eq!(read("<kml/>").unwrap_err(), "`kml`: expected a GPX file");
        assert_eq!(read("").unwrap_err(), "no element: expected a GPX file");
        assert_eq!(read(&FILE.replace("51.5", "north")).unwrap_err(), "point 1: lat = north: expected a number");
        assert_eq!(
            read(&FILE.replace("51.5", "95")).unwrap_err(),
            "point 1: latitude 95: expected -90 to 90; are latitude and longitude swapped?"
        );
        let refused = read(&FILE.replace("lon=\"0.2\"", "")).unwrap_err();
        assert_eq!(refused, "point 2: no attribute lon: expected lat and lon");
        let refused = read(&FILE.replace("<name>a", "<ele>high</ele><name>a")).unwrap_err();
        assert_eq!(refused, "point 1: ele = high: expected a number");
    }
}
