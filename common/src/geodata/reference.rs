//! The reference system that a file `.prj` beside a file of positions names, as GIS programs write it.

use std::fmt;
use std::fs;
use std::path::Path;

use crate::error::quoted;

/// Extensions of the file.
const EXTENSIONS: [&str; 2] = ["prj", "PRJ"];

/// Parts of the words for a system of metres on a plane.
const PROJECTED: [&str; 4] = ["PROJCS", "PROJCRS", "PROJECTEDCRS", "UTM"];

/// A reference system, as a file `.prj` names it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ReferenceSystem {
    /// The name of the file.
    file: String,
    /// Its own name.
    name: String,
    /// Whether its coordinates are metres on a plane, or degrees.
    pub is_projected: bool,
    /// Whether they are the degrees of WGS84.
    pub is_wgs84: bool,
}

impl ReferenceSystem {
    /// That of the file of positions `path`; `None` if there is no file `.prj` of its name, or nothing in it.
    #[must_use]
    pub fn beside(path: &Path) -> Option<Self> {
        let path = EXTENSIONS.iter().map(|extension| path.with_extension(extension)).find(|path| path.is_file())?;
        let file = path.file_name()?.to_string_lossy().into_owned();
        Self::of(file, &String::from_utf8_lossy(&fs::read(&path).ok()?))
    }

    /// The one of this text: the first name in quotes, or the first line.
    fn of(file: String, text: &str) -> Option<Self> {
        let text = text.trim_start_matches('\u{feff}').trim();
        let name = text.split('"').nth(1).or_else(|| text.lines().next())?.trim();
        let capitals = text.to_uppercase();
        let is_projected = PROJECTED.iter().any(|word| capitals.contains(word));
        let is_wgs84 = !is_projected && ["WGS", "84"].iter().all(|word| name.to_uppercase().contains(word));
        Some(Self { file, name: name.to_owned(), is_projected, is_wgs84 })
    }
}

/// Such as "nodes.prj says `WGS 84 / UTM zone 32N`".
impl fmt::Display for ReferenceSystem {
    fn fmt(&self, to: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(to, "{} says `{}`", quoted(&self.file), quoted(&self.name))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_reference_system_is_named_and_told_apart_from_wgs84() {
        let geographic =
            "GEOGCS[\"GCS_WGS_1984\",DATUM[\"D_WGS_1984\",SPHEROID[\"WGS_1984\",6378137.0,298.257223563]]]";
        let projected = format!("PROJCS[\"WGS_1984_UTM_Zone_32N\",{geographic},PROJECTION[\"Transverse_Mercator\"]]");
        for (text, name, is_projected, is_wgs84) in [
            (geographic, "GCS_WGS_1984", false, true),
            (&projected, "WGS_1984_UTM_Zone_32N", true, false),
            ("PROJCRS[\"CH1903+ / LV95\",BASEGEOGCRS[\"CH1903+\"]]", "CH1903+ / LV95", true, false),
            ("\u{feff}GEOGCRS[\"WGS 84\",DATUM[\"World Geodetic System 1984\"]]\r\n", "WGS 84", false, true),
            ("GEOGCS[\"NAD27\",DATUM[\"North_American_Datum_1927\"]]", "NAD27", false, false),
            ("Projection    UTM\nZone          32\n", "Projection    UTM", true, false),
        ] {
            let system = ReferenceSystem::of("a.prj".to_owned(), text).unwrap();
            let expected = ReferenceSystem { file: "a.prj".to_owned(), name: name.to_owned(), is_projected, is_wgs84 };
            assert_eq!(system, expected, "{text}");
        }
        assert_eq!(ReferenceSystem::of("a.prj".to_owned(), " \n"), None);
    }
}
