//! KML: imports the points and polygons of placemarks, at any depth of folders.

use super::xml::{self, XmlElement};
use super::{
    CLOSED_LINE, Extrusion, FoundPoint, FoundPoints, FoundPolygon, IgnoredItem, KIND, NAME, SourceText, check_geodetic,
    is_closed, kind_of_line,
};
use crate::error::quoted;

/// The outermost elements of files and of parts of them.
const ROOTS: [&str; 4] = ["kml", "Document", "Folder", "Placemark"];

/// The item that another file is shown by.
const LINK: &str = "NetworkLink";

/// Items without a placemark that have a position, and what they are called.
const ITEMS: [(&str, &str); 5] = [
    (LINK, "link"),
    ("GroundOverlay", "overlay"),
    ("PhotoOverlay", "overlay"),
    ("ScreenOverlay", "overlay"),
    ("Tour", "tour"),
];

/// Geometries that are neither points nor polygons, and what they are called.
const OTHERS: [(&str, &str); 4] =
    [("LinearRing", CLOSED_LINE), ("Model", "model"), ("Track", "track"), ("MultiTrack", "track")];

/// The folders that `skysink export` writes, with the kind of their points.
const FOLDERS: [(&str, &str); 2] = [("sensor nodes", "sensor node"), ("service points", "service")];

/// Finds the points and polygons of the text of a file, which are in degrees of WGS84. The further documents of an
/// archive are ignored.
///
/// # Errors
/// If it is not KML, or a position is invalid.
pub fn find(source: &SourceText<'_>) -> Result<FoundPoints, String> {
    let root = xml::parse(source.text, "KML", &ROOTS)?;
    let mut found = FoundPoints::default();
    found.add_items(&[root], None)?;
    found.ignored.extend(source.others.iter().map(|name| IgnoredItem { kind: "document", name: Some(name.clone()) }));
    Ok(found)
}

/// The name of an item: its own, and the file that it links to.
fn name_of(item: &XmlElement) -> Option<String> {
    let own = item.text_of(NAME);
    let link = item.named("Link").chain(item.named("Url")).find_map(|link| link.text_of("href"));
    match (own, link.filter(|_| item.name == LINK)) {
        (Some(own), Some(link)) => Some(format!("{own}: {link}")),
        (own, link) => own.or(link).map(str::to_owned),
    }
}

/// Name, description and extended data of a placemark.
fn properties(placemark: &XmlElement) -> Vec<(String, String)> {
    let texts = [NAME, "description"].map(|name| Some((name.to_owned(), placemark.text_of(name)?.to_owned())));
    let mut properties: Vec<(String, String)> = texts.into_iter().flatten().collect();
    let has_name = placemark.text_of(NAME).is_some();
    for data in placemark.named("ExtendedData").flat_map(|extended| &extended.children) {
        let fields = if data.name == "SchemaData" { &data.children[..] } else { std::slice::from_ref(data) };
        for field in fields {
            let value = field.text_of("value").or_else(|| field.text());
            let name = field.attribute("name").filter(|name| *name != NAME || !has_name);
            properties.extend(name.zip(value).map(|(name, value)| (name.to_owned(), value.to_owned())));
        }
    }
    properties
}

/// The points of an element `coordinates`, tuples that blanks divide.
fn tuples(geometry: &XmlElement) -> Result<Vec<FoundPoint>, String> {
    let text = geometry.text_of("coordinates").unwrap_or_default();
    // Blanks after commas, which people type, divide nothing.
    let text = text.split(',').map(str::trim).collect::<Vec<_>>().join(",");
    let tuple = |tuple: &str| {
        let numbers = tuple.split(',').map(|number| number.parse().ok().filter(|number: &f64| number.is_finite()));
        let numbers: Option<Vec<f64>> = numbers.collect();
        match numbers.as_deref() {
            Some(&[lon_deg, lat_deg, ref altitude_m @ ..]) if altitude_m.len() < 2 => {
                check_geodetic([lat_deg, lon_deg])?;
                let altitude_m = altitude_m.first().copied();
                Ok(FoundPoint { position: [lat_deg, lon_deg], altitude_m, properties: Vec::new() })
            }
            other => {
                let count = other.map_or(0, <[f64]>::len);
                let what = if count > 3 { format!("{count} numbers: ") } else { String::new() };
                let expected = "longitude, latitude and altitude with commas, and a blank between positions";
                Err(format!("coordinates `{}`: {what}expected {expected}", quoted(tuple)))
            }
        }
    };
    text.split_whitespace().map(tuple).collect()
}

/// Whether the boolean of XML Schema in an element of this name is true; false without the element.
fn is_true(geometry: &XmlElement, name: &str) -> Result<bool, String> {
    match geometry.text_of(name) {
        Some("1" | "true") => Ok(true),
        None | Some("0" | "false") => Ok(false),
        Some(other) => Err(format!("{name} `{}`: expected 0, 1, false or true", quoted(other))),
    }
}

/// What the altitudes of a geometry are measured from; without a mode the standard clamps it to the ground.
fn altitude_mode(geometry: &XmlElement) -> &str {
    geometry.text_of("altitudeMode").unwrap_or("clampToGround")
}

impl FoundPoints {
    fn add_items(&mut self, items: &[XmlElement], kind: Option<&str>) -> Result<(), String> {
        for child in items {
            match child.name.as_str() {
                "kml" | "Document" | "Folder" => {
                    let folder = FOLDERS.iter().find(|(name, _)| child.text_of(NAME) == Some(*name));
                    self.add_items(&child.children, folder.map(|(_, kind)| *kind).or(kind))?;
                }
                "Placemark" => self.add_placemark(child, kind)?,
                name => {
                    let item = ITEMS.iter().find(|(item, _)| *item == name);
                    self.ignored.extend(item.map(|(_, kind)| IgnoredItem { kind, name: name_of(child) }));
                }
            }
        }
        Ok(())
    }

    fn add_placemark(&mut self, placemark: &XmlElement, kind: Option<&str>) -> Result<(), String> {
        let mut properties = properties(placemark);
        properties.extend(kind.map(|kind| (KIND.to_owned(), kind.to_owned())));
        if !self.add_geometries(placemark, &properties)? {
            self.ignored.push(IgnoredItem::of("placemark without a position", &properties));
        }
        Ok(())
    }

    /// Adds the geometries in an element; returns whether there are some.
    fn add_geometries(&mut self, element: &XmlElement, properties: &[(String, String)]) -> Result<bool, String> {
        let mut has_some = false;
        for child in &element.children {
            has_some |= match child.name.as_str() {
                "Point" => {
                    let point =
                        point(child).map_err(|message| format!("{}: {message}", self.next_point(properties)))?;
                    self.points.push(FoundPoint { properties: properties.to_vec(), ..point });
                    true
                }
                "Polygon" => {
                    let polygon = polygon(child);
                    let (polygon, has_vain_altitude) =
                        polygon.map_err(|message| format!("{}: {message}", self.next_polygon(properties)))?;
                    if has_vain_altitude {
                        self.ignored.push(IgnoredItem::of("altitude of a polygon clamped to the ground", properties));
                    }
                    self.polygons.push(FoundPolygon { properties: properties.to_vec(), ..polygon });
                    true
                }
                "LineString" => {
                    let positions = tuples(child).unwrap_or_default();
                    let positions: Vec<[f64; 2]> = positions.iter().map(|point| point.position).collect();
                    self.ignored.push(IgnoredItem::of(kind_of_line(is_closed(&positions)), properties));
                    true
                }
                "MultiGeometry" => self.add_geometries(child, properties)?,
                name => {
                    let other = OTHERS.iter().find(|(other, _)| *other == name);
                    self.ignored.extend(other.map(|(_, kind)| IgnoredItem::of(kind, properties)));
                    other.is_some()
                }
            };
        }
        Ok(has_some)
    }
}

fn point(point: &XmlElement) -> Result<FoundPoint, String> {
    match &tuples(point)?[..] {
        [found] => Ok(found.clone()),
        [] => Err("no coordinates: expected a position".to_owned()),
        several => Err(format!("{} positions: expected one", several.len())),
    }
}

/// A polygon without its properties, and whether its sides are drawn from altitudes that are clamped to the ground.
fn polygon(polygon: &XmlElement) -> Result<(FoundPolygon, bool), String> {
    let rings = |boundary| polygon.named(boundary).flat_map(|boundary| boundary.named("LinearRing"));
    let outer = rings("outerBoundaryIs").map(tuples).collect::<Result<Vec<_>, _>>()?;
    let inner = rings("innerBoundaryIs").map(tuples).collect::<Result<Vec<_>, _>>()?;
    if outer.len() > 1 {
        return Err(format!("{} outer boundaries: expected one", outer.len()));
    }
    let outer = outer.into_iter().next().unwrap_or_default();
    let is_extruded = is_true(polygon, "extrude")?;
    let highest_m = outer.iter().filter_map(|corner| corner.altitude_m).reduce(f64::max);
    let extrusion = match (altitude_mode(polygon), highest_m.filter(|_| is_extruded)) {
        ("relativeToGround" | "relativeToSeaFloor", Some(highest_m)) if highest_m > 0.0 => {
            Extrusion::AboveGround(highest_m)
        }
        ("absolute", Some(highest_m)) => Extrusion::AboveSea(highest_m),
        _ => Extrusion::Flat,
    };
    let corners = |ring: Vec<FoundPoint>| ring.into_iter().map(|corner| corner.position).collect();
    let rings = std::iter::once(outer).chain(inner).map(corners).collect();
    let has_altitude = is_extruded && highest_m.is_some_and(|altitude_m| altitude_m != 0.0);
    let is_clamped = altitude_mode(polygon).starts_with("clamp");
    Ok((FoundPolygon { rings, extrusion, properties: Vec::new() }, is_clamped && has_altitude))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn find(text: &str) -> Result<FoundPoints, String> {
        super::find(&SourceText { text, ..SourceText::default() })
    }

    const FILE: &str = "<kml xmlns=\"http://www.opengis.net/kml/2.2\"><Document><Folder><Placemark><name>a</name><Point>\
                        <coordinates>13.4,52.5,30</coordinates></Point></Placemark></Folder><Placemark><LineString>\
                        <coordinates>1,2 3,4</coordinates></LineString></Placemark></Document></kml>";

    #[test]
    fn placemarks_are_points() {
        let found = find(FILE).unwrap();
        let [point] = &found.points[..] else { panic!("one point") };
        assert_eq!((point.position, point.altitude_m, found.ignored.len()), ([52.5, 13.4], Some(30.0), 1));
        assert_eq!(point.properties, [("name".to_owned(), "a".to_owned())]);
    }

    #[test]
    fn extended_data_of_placemarks_are_found() {
        let data = "<ExtendedData><Data name=\"rate\"><value>250</value></Data><SchemaData schemaUrl=\"#a\">\
                    <SimpleData name=\"owner\">us</SimpleData></SchemaData></ExtendedData>";
        let found = find(&FILE.replace("<name>a</name>", &format!("<name>soil-07</name>{data}"))).unwrap();
        let expected = [("name", "soil-07"), ("rate", "250"), ("owner", "us")];
        let expected = expected.map(|(name, value)| (name.to_owned(), value.to_owned()));
        assert_eq!(found.points[0].properties, expected);
    }

    #[test]
    fn items_without_a_point_are_counted() {
        let inner = "<Placemark><name>a</name></Placemark><Placemark><MultiGeometry/></Placemark><Placemark/>\
                     <GroundOverlay><name>b</name></GroundOverlay><NetworkLink/><Style id=\"c\"/>\
                     <Placemark><gx:Track><when>2020</when></gx:Track></Placemark>";
        let text = FILE.replace("<Folder>", &format!("<Folder>{inner}"));
        let found = find(&text).unwrap();
        assert_eq!((found.points.len(), found.ignored.len()), (1, 7));
    }

    #[test]
    fn a_truncated_file_is_refused() {
        let end = FILE.find("<Document>").unwrap();
        for cut in end..FILE.len() - 1 {
            assert!(find(&FILE[..cut]).is_err(), "{}", &FILE[..cut]);
        }
    }

    #[test]
    fn invalid_kml_is_refused() {
        assert!(find("<gpx>").unwrap_err().contains("ends within an element"));
        assert_eq!(find("<gpx></gpx>").unwrap_err(), "`gpx`: expected a KML file");
        assert!(find("<kml></kml></kml>").is_err());
        for empty in ["<coordinates></coordinates>", "<coordinates/>", ""] {
            let file = format!("<kml><Placemark><Point>{empty}</Point></Placemark></kml>");
            assert_eq!(find(&file).unwrap_err(), "point 1: no coordinates: expected a position", "{empty}");
        }
        let deep = format!("<kml>{}{}</kml>", "<Folder>".repeat(100_000), "</Folder>".repeat(100_000));
        assert!(find(&deep).unwrap_err().contains("nested"));
        for (coordinates, message) in [
            ("east,52.5,30", "`east,52.5,30`: "),
            ("13.4", "`13.4`: "),
            ("13.4,NaN", "`13.4,NaN`: "),
            ("1,2,3,4", "`1,2,3,4`: 4 numbers: "),
        ] {
            let file = FILE.replace("13.4,52.5,30", coordinates);
            let expected = "expected longitude, latitude and altitude with commas, and a blank between positions";
            assert_eq!(find(&file).unwrap_err(), format!("point 1 (`a`): coordinates {message}{expected}"));
        }
        let two = find(&FILE.replace("13.4,52.5,30", "1,2 3,4")).unwrap_err();
        assert_eq!(two, "point 1 (`a`): 2 positions: expected one");
        assert_eq!(find(&FILE.replace("13.4,52.5,30", "\n13.4, 52.5, 30\n")).unwrap().points[0].altitude_m, Some(30.0));
    }

    /// The polygon of a file with these elements before its boundary, and corners of this altitude.
    fn polygon_with(elements: &str, altitude: &str) -> Result<FoundPoints, String> {
        let corners = ["1,2", "1,3", "2,3", "1,2"].map(|corner| format!("{corner}{altitude}")).join(" ");
        find(&format!(
            "<kml><Placemark><Polygon>{elements}<outerBoundaryIs><LinearRing><coordinates>{corners}</coordinates>\
             </LinearRing></outerBoundaryIs></Polygon></Placemark></kml>"
        ))
    }

    #[test]
    fn only_altitudes_that_the_mode_does_not_ignore_become_heights() {
        let mode = |mode: &str| format!("<extrude>1</extrude><altitudeMode>{mode}</altitudeMode>");
        for (elements, altitude, extrusion, ignored) in [
            ("<extrude>1</extrude>".to_owned(), ",471", Extrusion::Flat, 1),
            ("<extrude>1</extrude>".to_owned(), ",0", Extrusion::Flat, 0),
            (mode("clampToGround"), ",471", Extrusion::Flat, 1),
            (mode("clampToSeaFloor").replace("altitudeMode", "gx:altitudeMode"), ",471", Extrusion::Flat, 1),
            (mode("relativeToGround"), ",9", Extrusion::AboveGround(9.0), 0),
            (mode(" relativeToGround\n").replace(">1<", "> 1 <"), ",9", Extrusion::AboveGround(9.0), 0),
            (mode("relativeToGround").replace(">1<", ">true<"), ",9", Extrusion::AboveGround(9.0), 0),
            (mode("relativeToGround").replace(">1<", ">false<"), ",9", Extrusion::Flat, 0),
            (mode("relativeToGround").replace("<extrude>1</extrude>", "<extrude/>"), ",9", Extrusion::Flat, 0),
            (mode("relativeToGround"), ",0", Extrusion::Flat, 0),
            (mode("relativeToGround"), "", Extrusion::Flat, 0),
            (mode("absolute"), ",480", Extrusion::AboveSea(480.0), 0),
        ] {
            let found = polygon_with(&elements, altitude).unwrap();
            assert_eq!(
                (found.polygons[0].extrusion, found.ignored.len()),
                (extrusion, ignored),
                "{elements} {altitude}"
            );
        }
        let inner =
            "<innerBoundaryIs><LinearRing><coordinates>1,2 1,3 2,3</coordinates></LinearRing></innerBoundaryIs>";
        assert_eq!(polygon_with(inner, "").unwrap().polygons[0].rings.len(), 2);
        let twice = polygon_with(&inner.replace("inner", "outer"), "").unwrap_err();
        assert_eq!(twice, "polygon 1: 2 outer boundaries: expected one");
        let refused = polygon_with("<extrude>yes</extrude>", "").unwrap_err();
        assert_eq!(refused, "polygon 1: extrude `yes`: expected 0, 1, false or true");
    }
}
