//! Why a text is no GeoJSON: the point or polygon whose position is none, which the parser tells only by its column.

use ::geojson::Position;
use serde_json::Value;

use crate::error::quoted;
use crate::geodata::{place, with_causes};

/// Words that programs write for a number that is none, and that JSON does not have.
const NO_NUMBERS: [&str; 3] = ["NaN", "Infinity", "-Infinity"];

/// What geometries are called, which are counted by these names.
const NAMES: [&str; 3] = ["point", "polygon", "line"];

/// Why a position has too few or too many numbers.
pub fn of_length(coordinates: &Position) -> String {
    format!("a position of {} numbers: expected longitude, latitude, altitude", coordinates.as_slice().len())
}

/// The refusal of a text that is not parsed: by the first position that is none, or by the `error` of the parser.
pub fn refusal(text: &str, error: &dyn std::error::Error) -> String {
    let found = serde_json::from_str(&with_quoted_words(text)).ok().and_then(|file: Value| {
        let mut counts = Counts::default();
        counts.first_refusal(&file, None)
    });
    found.unwrap_or_else(|| format!("{}: expected GeoJSON", with_causes(error)))
}

/// The text with quotes around the words for numbers that are none, so that it can be parsed as JSON.
fn with_quoted_words(text: &str) -> String {
    let mut parts = String::with_capacity(text.len());
    let mut is_string = false;
    let mut rest = text;
    while let Some(first) = rest.chars().next() {
        let word = NO_NUMBERS.iter().find(|word| !is_string && rest.starts_with(**word));
        let length = match word {
            Some(word) => word.len(),
            None if is_string && first == '\\' => 1 + rest[1..].chars().next().map_or(0, char::len_utf8),
            None => first.len_utf8(),
        };
        is_string ^= first == '"';
        let (part, after) = rest.split_at(length);
        parts += &word.map_or_else(|| part.to_owned(), |word| format!("\"{word}\""));
        rest = after;
    }
    parts
}

/// How many features, and geometries by their [`NAMES`], were read so far.
#[derive(Default)]
struct Counts {
    features: usize,
    geometries: [usize; NAMES.len()],
}

impl Counts {
    /// The refusal of the first geometry in `value` with a position that is none, or of the first property that is no
    /// number; `properties` are those of the feature around it.
    fn first_refusal(&mut self, value: &Value, properties: Option<&Value>) -> Option<String> {
        let parts = ["features", "geometries"].into_iter().find_map(|name| value.get(name)?.as_array());
        if let Some(parts) = parts {
            return parts.iter().find_map(|part| self.first_refusal(part, properties));
        }
        if let Some(geometry) = value.get("geometry") {
            self.features += 1;
            let properties = value.get("properties");
            return self.first_refusal(geometry, properties).or_else(|| self.of_property(properties?));
        }
        let kind = value.get("type")?.as_str()?;
        let coordinates = value.get("coordinates")?;
        let (name, depth) = name_and_depth(kind)?;
        if let Some(found) = none_of(coordinates, depth) {
            let place = place(NAMES[name], self.geometries[name] + 1, &texts(properties));
            let shown = quoted(&shown(found));
            return Some(format!("{place}: coordinates {shown}: expected longitude and latitude"));
        }
        let is_several = kind.starts_with("Multi");
        self.geometries[name] += coordinates.as_array().filter(|_| is_several).map_or(1, Vec::len);
        None
    }

    /// The refusal of a word among the properties of the last feature.
    fn of_property(&self, properties: &Value) -> Option<String> {
        let is_word = |value: &&Value| value.as_str().is_some_and(|text| NO_NUMBERS.contains(&text));
        let (name, value) = properties.as_object()?.iter().find(|(_, value)| is_word(value))?;
        let place = place("feature", self.features, &texts(Some(properties)));
        Some(format!("{place}: {} = {}: expected a number, or null", quoted(name), shown(value)))
    }
}

/// The index of the name of a geometry, and how deep its positions lie in arrays.
fn name_and_depth(kind: &str) -> Option<(usize, usize)> {
    match kind {
        "Point" => Some((0, 0)),
        "MultiPoint" => Some((0, 1)),
        "Polygon" => Some((1, 2)),
        "MultiPolygon" => Some((1, 3)),
        "LineString" => Some((2, 1)),
        "MultiLineString" => Some((2, 2)),
        _ => None,
    }
}

/// The first value that is no position, `depth` arrays deep in `coordinates`.
fn none_of(coordinates: &Value, depth: usize) -> Option<&Value> {
    match coordinates.as_array() {
        Some(parts) if depth > 0 => parts.iter().find_map(|part| none_of(part, depth - 1)),
        Some(numbers) if numbers.len() > 1 && numbers.iter().all(Value::is_number) => None,
        _ => Some(coordinates),
    }
}

/// The texts among the properties of a feature, of which one may be its name.
fn texts(properties: Option<&Value>) -> Vec<(String, String)> {
    let properties = properties.and_then(Value::as_object).into_iter().flatten();
    properties.filter_map(|(name, value)| Some((name.clone(), value.as_str()?.to_owned()))).collect()
}

/// A value as it was written.
fn shown(value: &Value) -> String {
    NO_NUMBERS.iter().fold(value.to_string(), |text, word| text.replace(&format!("\"{word}\""), word))
}

#[cfg(test)]
mod tests {
    use crate::geodata::SourceText;
    use crate::geodata::geojson::find;

    /// The refusal of a collection of a point `a` and a feature with this geometry and these properties.
    fn refused(geometry: &str, coordinates: &str, properties: &str) -> String {
        let first = r#"{"type":"Feature","properties":{"name":"a"},"geometry":{"type":"Point","coordinates":[7,50]}}"#;
        let geometry = format!(r#"{{"type":"{geometry}","coordinates":{coordinates}}}"#);
        let second = format!(r#"{{"type":"Feature","properties":{{{properties}}},"geometry":{geometry}}}"#);
        let text = format!(r#"{{"type":"FeatureCollection","features":[{first},{second}]}}"#);
        find(&SourceText { text: &text, ..SourceText::default() }).unwrap_err()
    }

    #[test]
    fn a_position_that_is_none_is_named_by_its_point() {
        let expected = "expected longitude and latitude";
        for (coordinates, shown) in [
            ("[null,null]", "[null,null]"),
            ("[NaN, NaN]", "[NaN,NaN]"),
            ("[7.1,-Infinity]", "[7.1,-Infinity]"),
            ("\"[7.2,50.1]\"", "\"[7.2,50.1]\""),
            ("[\"7.2\",\"50.1\"]", "[\"7.2\",\"50.1\"]"),
            ("[]", "[]"),
            ("[7.2]", "[7.2]"),
            ("null", "null"),
            ("{\"x\":1}", "{\"x\":1}"),
        ] {
            let named = refused("Point", coordinates, "\"name\":\"un\\\"known\"");
            assert_eq!(named, format!("point 2 (`un\"known`): coordinates {shown}: {expected}"));
            let unnamed = refused("Point", coordinates, "");
            assert_eq!(unnamed, format!("point 2: coordinates {shown}: {expected}"));
        }
        let several = refused("MultiPoint", "[[7,50],[7,null]]", "");
        assert_eq!(several, format!("point 2: coordinates [7,null]: {expected}"));
        let ring = refused("Polygon", "[[[7,50],[7.1,50],[NaN,NaN],[7,50]]]", "\"name\":\"pond\"");
        assert_eq!(ring, format!("polygon 1 (`pond`): coordinates [NaN,NaN]: {expected}"));
        let flat = refused("Polygon", "[[7,50],[7.1,50],[7.1,50.1]]", "");
        assert_eq!(flat, format!("polygon 1: coordinates 7: {expected}"));
    }

    #[test]
    fn a_property_that_json_does_not_have_is_named() {
        let message = refused("Point", "[7,50]", "\"name\":\"NaN, a name\",\"rate\":NaN");
        assert_eq!(message, "feature 2 (`NaN, a name`): rate = NaN: expected a number, or null");
        assert!(refused("Point", "[7,50]", "\"rate\":nul").contains("expected GeoJSON"), "the column of other errors");
    }
}
