//! Which of the heights in a file are altitudes of the ground at the sensor nodes.
//!
//! Only columns and properties that are called so: points have the height of whatever was measured or drawn, such as a
//! receiver, a mast or nothing, and a list with altitudes of the ground makes a plan one over hills.

use skysink_common::geodata::{FOOT_M, FoundPoint};

use super::imported::{Imported, is_number, plain};

/// The column of the altitudes of the ground.
pub const GROUND: &str = "ground_m";

/// Its name with values in feet.
pub const GROUND_FT: &str = "ground_ft";

/// What heights are called of which it is not said what they are the heights of, in lower case, with underscores.
const HEIGHTS: [&str; 6] = ["elevation_m", "elevation", "ele", "altitude_m", "altitude", "alt"];

/// Where heights of the ground are expected.
pub const REMEDY: &str = "altitudes of the ground, for flights over hills, belong into ground_m";

/// Whether a column or a property called `name` has heights of something.
pub fn is_height(name: &str) -> bool {
    HEIGHTS.contains(&plain(name).as_str())
}

/// What is said about the heights of points that have some, other than 0.
pub fn ignored_heights(points: &[FoundPoint]) -> Option<String> {
    let has_height = |point: &&FoundPoint| {
        let is_named = |(name, value): &(String, String)| is_height(name) && is_number(value.trim());
        point.altitude_m.is_some_and(|altitude_m| altitude_m != 0.0) || point.properties.iter().any(is_named)
    };
    let count = points.iter().filter(has_height).count();
    (count > 0).then(|| format!("heights of {count} of {} points; {REMEDY}", points.len()))
}

/// An altitude in feet, in metres; what is no number as it is.
pub fn in_metres(text: &str) -> String {
    text.parse::<f64>().map_or_else(|_| text.to_owned(), |feet| (feet * FOOT_M).to_string())
}

/// Whether programs write this where no height was measured.
pub fn is_missing(text: &str) -> bool {
    ["", "nan", "na", "null", "none"].contains(&text.to_lowercase().as_str())
}

impl Imported {
    /// The altitude of the ground at each sensor node [m]; empty if the list has none.
    #[must_use]
    pub fn ground_m(&self) -> Vec<f64> {
        let Some(column) = self.others.iter().position(|name| *name == GROUND) else { return Vec::new() };
        self.sensors.iter().filter_map(|sensor| sensor.others[column].parse().ok()).collect()
    }

    /// Leaves out the altitudes of the ground if some are missing.
    pub(super) fn without_partial_ground(mut self) -> Self {
        let Some(column) = self.others.iter().position(|name| *name == GROUND) else { return self };
        let Some(first) = self.sensors.iter().find(|sensor| is_missing(&sensor.others[column])) else { return self };
        self.ignored.push(format!("{GROUND} of all sensor nodes ({} has no number)", first.place));
        self.others.remove(column);
        self.sensors.iter_mut().for_each(|sensor| drop(sensor.others.remove(column)));
        self
    }
}

#[cfg(test)]
mod tests {
    use skysink_common::geodata::FoundPoints;

    use super::*;

    fn at(altitude_m: Option<f64>, properties: &[(&str, &str)]) -> FoundPoint {
        let properties = properties.iter().map(|(name, value)| [name, value].map(|text| (*text).to_owned()).into());
        FoundPoint { position: [1.0, 2.0], altitude_m, properties: properties.collect() }
    }

    /// The list of points, and what is ignored.
    fn list(points: &[FoundPoint]) -> (String, Vec<String>) {
        let found = FoundPoints { points: points.to_vec(), ..FoundPoints::default() };
        let imported = Imported::geodetic(found).unwrap();
        (imported.to_csv([0.0; 2]), imported.ignored)
    }

    #[test]
    fn only_heights_that_are_called_those_of_the_ground_are_taken() {
        let bare = || "lat_deg,lon_deg\n1,2\n1,2\n".to_owned();
        let note = |count| format!("heights of {count} of 2 points; {REMEDY}");
        assert_eq!(list(&[at(Some(12.5), &[]), at(Some(11.0), &[])]), (bare(), vec![note(2)]));
        assert_eq!(list(&[at(Some(388.0), &[]), at(Some(0.0), &[])]), (bare(), vec![note(1)]));
        assert_eq!(list(&[at(Some(0.0), &[]), at(None, &[])]), (bare(), vec![]), "a height that nobody measured");
        let named = list(&[at(None, &[("Elevation", "3")]), at(None, &[("alt", "4")])]);
        assert_eq!(named, (bare(), vec!["properties Elevation, alt".to_owned(), note(2)]));
        let ground = list(&[at(Some(9.0), &[("ground_m", "3")]), at(None, &[("Ground", "4")])]);
        assert_eq!(ground.0, "lat_deg,lon_deg,ground_m\n1,2,3\n1,2,4\n");
    }

    #[test]
    fn feet_become_metres() {
        let feet = list(&[at(None, &[("ground_ft", "1000")]), at(None, &[("Ground-ft", " 10 ")])]);
        assert_eq!(feet.0, "lat_deg,lon_deg,ground_m\n1,2,304.8\n1,2,3.048\n");
    }

    #[test]
    fn without_all_altitudes_none_is_taken() {
        for missing in ["NaN", "", "null", "NA"] {
            let (text, ignored) = list(&[at(None, &[("ground_m", "3")]), at(None, &[("ground_m", missing)])]);
            assert_eq!(text, "lat_deg,lon_deg\n1,2\n1,2\n", "{missing}");
            let reason = "ground_m of all points (point 2 has no number)".to_owned();
            assert_eq!(ignored, ["properties ground_m".to_owned(), reason], "{missing}");
        }
    }
}
