//! KML: imports the points and polygons of placemarks, at any depth of folders.

use ::kml::types::{AltitudeMode, Geometry, LinearRing, Placemark, Point};
use ::kml::{Kml, KmlReader};

use super::{FoundPoint, FoundPoints, FoundPolygon, NAME, with_causes, xml};

/// Finds the points and polygons of the text of a file.
///
/// # Errors
/// If it is not KML.
pub fn find(text: &str) -> Result<FoundPoints, String> {
    let refuse = |error: ::kml::Error| format!("{}: expected a KML file", with_causes(&error));
    let ignored = xml::check(text, "KML")?;
    let file: Kml<f64> = KmlReader::from_string(text).read().map_err(refuse)?;
    let mut found = FoundPoints { ignored, ..FoundPoints::default() };
    found.add_element(&file);
    Ok(found)
}

/// Name, description and extended data of a placemark.
fn properties(placemark: &Placemark<f64>) -> Vec<(String, String)> {
    let texts = [(NAME, &placemark.name), ("description", &placemark.description)];
    let mut properties: Vec<(String, String)> =
        texts.into_iter().filter_map(|(name, text)| Some((name.to_owned(), text.clone()?))).collect();
    let extended = placemark.children.iter().filter(|child| child.name == "ExtendedData");
    for data in extended.flat_map(|extended| &extended.children) {
        let fields = if data.name == "SchemaData" { &data.children[..] } else { std::slice::from_ref(data) };
        for field in fields {
            let value = field.children.iter().find(|child| child.name == "value").unwrap_or(field);
            let name = field.attrs.get("name").filter(|name| *name != NAME || placemark.name.is_none());
            properties.extend(name.zip(value.content.as_ref()).map(|(name, value)| (name.clone(), value.clone())));
        }
    }
    properties
}

impl FoundPoints {
    fn add_element(&mut self, element: &Kml<f64>) {
        match element {
            Kml::KmlDocument(document) => document.elements.iter().for_each(|inner| self.add_element(inner)),
            Kml::Document { elements, .. } => elements.iter().for_each(|inner| self.add_element(inner)),
            Kml::Folder(folder) => folder.elements.iter().for_each(|inner| self.add_element(inner)),
            Kml::Placemark(placemark) => {
                let properties = properties(placemark);
                placemark.geometry.iter().for_each(|geometry| self.add_kml(geometry, &properties));
            }
            _ => {} // styles, schemas and the like have no position
        }
    }

    fn add_kml(&mut self, geometry: &Geometry<f64>, properties: &[(String, String)]) {
        match geometry {
            Geometry::Point(Point { coord, altitude_mode, .. }) => self.points.push(FoundPoint {
                position: [coord.y, coord.x],
                altitude_m: coord.z.filter(|_| *altitude_mode != AltitudeMode::RelativeToGround),
                properties: properties.to_vec(),
            }),
            Geometry::MultiGeometry(several) => {
                several.geometries.iter().for_each(|inner| self.add_kml(inner, properties));
            }
            Geometry::Polygon(polygon) => {
                let ring = |ring: &LinearRing<f64>| ring.coords.iter().map(|corner| [corner.y, corner.x]).collect();
                let altitudes_m = polygon.outer.coords.iter().filter_map(|corner| corner.z);
                let extruded_m = altitudes_m.reduce(f64::max).filter(|_| polygon.extrude);
                let rings = std::iter::once(&polygon.outer).chain(&polygon.inner).map(ring).collect();
                self.polygons.push(FoundPolygon { rings, extruded_m, properties: properties.to_vec() });
            }
            _ => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FILE: &str = "<kml xmlns=\"http://www.opengis.net/kml/2.2\"><Document><Folder><Placemark><name>a</name><Point>\
                        <coordinates>13.4,52.5,30</coordinates></Point></Placemark></Folder><Placemark><LineString>\
                        <coordinates>1,2 3,4</coordinates></LineString></Placemark></Document></kml>";

    #[test]
    fn placemarks_are_points() {
        let found = find(FILE).unwrap();
        let [point] = &found.points[..] else { panic!("one point") };
        assert_eq!((point.position, point.altitude_m, found.ignored), ([52.5, 13.4], Some(30.0), 1));
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
        assert_eq!((found.points.len(), found.ignored), (1, 7));
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
        assert!(find("<gpx></gpx></gpx>").is_err());
        for empty in ["<coordinates></coordinates>", "<coordinates/>", ""] {
            let file = format!("<kml><Placemark><Point>{empty}</Point></Placemark></kml>");
            assert!(find(&file).unwrap_err().contains("Point without coordinates"), "{empty}");
        }
        let deep = format!("<kml>{}{}</kml>", "<Folder>".repeat(100_000), "</Folder>".repeat(100_000));
        assert!(find(&deep).unwrap_err().contains("nested"));
        assert!(find(&FILE.replace("13.4", "east")).unwrap_err().ends_with("expected a KML file"));
    }
}
