//! The reference system that a file `.prj` beside a file of positions names, as GIS programs write it.

use std::fmt;
use std::fs;
use std::path::Path;

use crate::error::quoted;

/// Extensions of the file.
const EXTENSIONS: [&str; 2] = ["prj", "PRJ"];

/// Parts of the words for a system of metres on a plane.
const PROJECTED: [&str; 8] =
    ["PROJCS", "PROJCRS", "PROJECTEDCRS", "UTM", "LOCAL_CS", "ENGCRS", "ENGINEERINGCRS", "LOCALCS"];

/// Beginnings of the parts of a text that are not about places on a plane: heights, and the aim of a transformation.
const OTHERS: [&str; 5] = ["VERT_CS[", "VERTCS[", "VERTCRS[", "VERTICALCRS[", "TARGETCRS["];

/// Parts of the names of the projection of web maps, whose metres are longer than those on the ground.
const WEB: [&str; 6] = [
    "PSEUDO-MERCATOR",
    "AUXILIARY_SPHERE",
    "WEB_MERCATOR",
    "POPULAR VISUALISATION",
    "GOOGLE MAPS GLOBAL",
    "WORLD_MERCATOR",
];

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
    /// Why its coordinates are not metres on the ground, if they are lengths; `None` for metres.
    pub no_metres: Option<String>,
}

impl ReferenceSystem {
    /// The system of the file of positions `path`; `None` if there is no file `.prj` of its name, or nothing in it.
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
        let capitals = text.to_ascii_uppercase();
        let is_projected = PROJECTED.iter().any(|word| capitals.contains(word));
        let is_wgs84 = !is_projected && ["WGS", "84"].iter().all(|word| name.to_uppercase().contains(word));
        let no_metres = is_projected.then(|| no_metres(text, &capitals)).flatten();
        Some(Self { file, name: name.to_owned(), is_projected, is_wgs84, no_metres })
    }
}

/// Why the lengths of a projected system are not metres on the ground; `None` if they are. `capitals` are those of `text`.
fn no_metres(text: &str, capitals: &str) -> Option<String> {
    if WEB.iter().any(|name| capitals.contains(name)) {
        return Some("its metres, those of web maps, are longer than on the ground".to_owned());
    }
    // The last unit is that of lengths: `UNIT["Foot_US",0.3048006]`, also within `LENGTHUNIT`.
    let end = OTHERS.iter().filter_map(|other| capitals.find(other)).min().unwrap_or(capitals.len());
    let unit = &text[capitals[..end].rfind("UNIT[")?..end];
    let name = unit.split('"').nth(1)?;
    let length_m: f64 = unit.split([',', ']']).nth(1)?.trim().parse().ok()?;
    ((length_m - 1.0).abs() > 1e-4).then(|| format!("its unit is `{}`, {length_m} m", quoted(name)))
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
            let (file, name) = ("a.prj".to_owned(), name.to_owned());
            let expected = ReferenceSystem { file, name, is_projected, is_wgs84, no_metres: None };
            assert_eq!(system, expected, "{text}");
        }
        assert_eq!(ReferenceSystem::of("a.prj".to_owned(), " \n"), None);
        let metres =
            "PROJCS[\"WGS_1984_UTM_Zone_32N\",GEOGCS[\"GCS\",UNIT[\"Degree\",0.0174532925199433]],UNIT[\"Meter\",1.0]]";
        let feet = metres.replace("\"Meter\",1.0", "\"Foot_US\",0.3048006096012192");
        let web = "PROJCS[\"WGS_1984_Web_Mercator_Auxiliary_Sphere\",UNIT[\"Meter\",1.0]]";
        let newer = "PROJCRS[\"a\",CS[Cartesian,2],LENGTHUNIT[\"US survey foot\",0.304800609601219]]";
        let no_metres = |text: &str| ReferenceSystem::of("a.prj".to_owned(), text).unwrap().no_metres;
        assert_eq!(no_metres(metres), None);
        assert_eq!(no_metres(&feet).unwrap(), "its unit is `Foot_US`, 0.3048006096012192 m");
        assert_eq!(no_metres(newer).unwrap(), "its unit is `US survey foot`, 0.304800609601219 m");
        let above = |plane: &str, name: &str, unit: &str| {
            format!("COMPD_CS[\"a + b\",{plane},VERT_CS[\"b\",UNIT[\"{name}\",{unit}]]]")
        };
        assert_eq!(no_metres(&above(metres, "US survey foot", "0.3048006")), None, "heights are in feet");
        assert!(no_metres(&above(&feet, "metre", "1")).is_some());
        assert_eq!(no_metres("PROJCS[\"\u{131}\",\u{e9}UNIT[\"m\",1],AUTHORITY[\"\u{250}\",\"1\"]]"), None);
        assert_eq!(no_metres("LOCAL_CS[\"site\",UNIT[\"German legal metre\",1.0000135965]]"), None);
        assert_eq!(no_metres(web).unwrap(), "its metres, those of web maps, are longer than on the ground");
    }
}
