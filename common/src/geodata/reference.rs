//! The reference system of positions: an EPSG code, as options and GeoJSON name it, or the text of a file `.prj` beside
//! a table, as GIS programs write it; and from its coordinates to latitude and longitude.

use std::fmt;
use std::fs;
use std::path::Path;

use proj4rs::Proj;
use proj4rs::transform::transform;

use super::check_geodetic;
use crate::error::quoted;

/// Extensions of the file.
const EXTENSIONS: [&str; 2] = ["prj", "PRJ"];

/// Words of a system of metres on a plane that no place on Earth is known of.
const LOCAL: [&str; 4] = ["LOCAL_CS[", "ENGCRS[", "ENGINEERINGCRS[", "LOCALCS["];

/// Words of a system of places, projected ones first.
const HORIZONTAL: [&str; 6] = ["PROJCS[", "PROJCRS[", "PROJECTEDCRS[", "GEOGCS[", "GEOGCRS[", "GEODCRS["];

/// What the programs of geographic information call latitude and longitude of WGS84.
const WGS84: &str = "+proj=longlat +datum=WGS84 +no_defs";

/// Parts of a definition whose datum is that of WGS84 within two metres.
const GLOBAL: [&str; 7] = [
    "+datum=WGS84",
    "+datum=NAD83",
    "+ellps=GRS80",
    "+ellps=WGS84",
    "+rf=298.257223563",
    "+rf=298.257222101",
    "+nadgrids=@null",
];

/// What is to be done with positions of a system that is not read.
const REMEDY: &str = "expected one whose shift to WGS84 is known, such as EPSG:25832 (--crs of `skysink new`), or \
                      latitudes and longitudes (ogr2ogr -t_srs EPSG:4326, or QGIS)";

/// Longest distance between a position and the one that its latitude and longitude lead back to [m or °].
const MOST_ERROR: f64 = 0.01;

/// Projections for a strip beside a central meridian.
const NARROW: [&str; 2] = ["+proj=tmerc", "+proj=somerc"];

/// Farthest from the central meridian of such a strip that positions are believed [°]: some three zones of UTM.
const MOST_ASIDE_DEG: f64 = 15.0;

/// Largest number of a position in degrees.
const MOST_DEG: f64 = 360.0;

/// A reference system.
#[derive(Clone)]
pub struct ReferenceSystem {
    /// What messages call it.
    name: String,
    /// What its coordinates are.
    pub coordinates: Coordinates,
}

/// What the coordinates of a reference system are.
#[derive(Clone)]
pub enum Coordinates {
    /// Those of a place on Earth.
    OnEarth(Box<EarthSystem>),
    /// Metres on a plane without a place on Earth, or why they are not metres.
    Local(Result<(), String>),
    /// Not known; with the reason.
    Unknown(String),
}

/// A system whose coordinates have a latitude and a longitude on WGS84.
#[derive(Clone)]
pub struct EarthSystem {
    definition: Proj,
    wgs84: Proj,
    /// Whether its datum is shifted to that of WGS84 by a few parameters, which are exact to some metres.
    is_shifted: bool,
    /// The central meridian of a projection for a narrow strip beside it [°].
    meridian_deg: Option<f64>,
}

impl PartialEq for ReferenceSystem {
    fn eq(&self, other: &Self) -> bool {
        self.name == other.name
    }
}

impl fmt::Debug for ReferenceSystem {
    fn fmt(&self, to: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(to, "{self}")
    }
}

/// Such as "EPSG:25832", or "nodes.prj says `WGS 84 / UTM zone 32N`".
impl fmt::Display for ReferenceSystem {
    fn fmt(&self, to: &mut fmt::Formatter<'_>) -> fmt::Result {
        to.write_str(&self.name)
    }
}

impl ReferenceSystem {
    /// The system of a name such as `EPSG:25832`, `urn:ogc:def:crs:EPSG::25832` or `urn:ogc:def:crs:OGC:1.3:CRS84`.
    ///
    /// # Errors
    /// If it is no such name, or one of a system without a known place on Earth; with the remedy.
    pub fn of_name(name: &str) -> Result<Self, String> {
        let refuse = |reason: &str| format!("`{}`: {reason}{REMEDY}", quoted(name));
        let capitals = name.trim().to_ascii_uppercase();
        let last = capitals.rsplit([':', '/']).next().unwrap_or_default();
        let code: Option<u16> = last.parse().ok().filter(|_| capitals.contains("EPSG") || capitals == last);
        let (code, definition) = match (last, code) {
            ("CRS84", _) => (4326, WGS84),
            (_, Some(code)) => {
                let found = crs_definitions::from_code(code).ok_or_else(|| refuse("no known code: "))?;
                (code, found.proj4)
            }
            _ => return Err(refuse("")),
        };
        let on_earth = EarthSystem::of(definition).map_err(|reason| refuse(&format!("{reason}: ")))?;
        Ok(Self { name: format!("EPSG:{code}"), coordinates: Coordinates::OnEarth(Box::new(on_earth)) })
    }

    /// The system of the file of positions `path`; `None` if there is no file `.prj` of its name, or nothing in it.
    #[must_use]
    pub fn beside(path: &Path) -> Option<Self> {
        let path = EXTENSIONS.iter().map(|extension| path.with_extension(extension)).find(|path| path.is_file())?;
        let file = path.file_name()?.to_string_lossy().into_owned();
        Self::of_text(&file, &String::from_utf8_lossy(&fs::read(&path).ok()?))
    }

    /// The one of the text of a file: its name is the first one in quotes, or the first line.
    fn of_text(file: &str, text: &str) -> Option<Self> {
        let text = text.trim_start_matches('\u{feff}').trim();
        let own_name = text.split('"').nth(1).or_else(|| text.lines().next())?.trim();
        let capitals = text.to_ascii_uppercase();
        let coordinates = if LOCAL.iter().any(|word| capitals.contains(word)) {
            Coordinates::Local(no_metres(text, &capitals).map_or(Ok(()), Err))
        } else {
            let plane = horizontal(text, &capitals);
            let named = || Some(Self::of_name(&format!("EPSG:{}", code_of(plane)?)).ok()?.coordinates);
            let defined = proj4wkt::wkt_to_projstring(plane).map_err(|_| "not read as well-known text".to_owned());
            match defined.and_then(|definition| EarthSystem::of(&definition)) {
                Ok(on_earth) => Coordinates::OnEarth(Box::new(on_earth)),
                Err(reason) => named().unwrap_or(Coordinates::Unknown(reason)),
            }
        };
        Some(Self { name: format!("{} says `{}`", quoted(file), quoted(own_name)), coordinates })
    }

    /// The system on Earth; `None` if it is not known, or a plane without a place.
    #[must_use]
    pub fn on_earth(&self) -> Option<&EarthSystem> {
        match &self.coordinates {
            Coordinates::OnEarth(on_earth) => Some(on_earth),
            Coordinates::Local(_) | Coordinates::Unknown(_) => None,
        }
    }

    /// Whether its coordinates are lengths on a map of a place on Earth.
    #[must_use]
    pub fn is_map(&self) -> bool {
        self.on_earth().is_some_and(|on_earth| !on_earth.definition.is_latlong())
    }

    /// Whether its coordinates are the degrees of WGS84, within two metres.
    #[must_use]
    pub fn is_wgs84(&self) -> bool {
        self.on_earth().is_some_and(|on_earth| on_earth.definition.is_latlong() && !on_earth.is_shifted)
    }

    /// The refusal of positions in the system of a file `.prj`: what it is, and the remedy.
    #[must_use]
    pub fn refusal(&self, reason: &str) -> String {
        format!("{self}: {reason}: {REMEDY}; or this .prj belongs to another file: move it away")
    }

    /// What a note says about positions that were read in it.
    #[must_use]
    pub fn note(&self) -> String {
        let is_shifted = self.on_earth().is_some_and(|on_earth| on_earth.is_shifted);
        let shifted = ", whose shift to WGS84 is exact to some metres";
        format!("{self}: read in this system{}", if is_shifted { shifted } else { "" })
    }
}

impl EarthSystem {
    /// The one of a definition in the notation of PROJ.
    fn of(definition: &str) -> Result<Self, String> {
        let proj = |text| Proj::from_proj_string(text).map_err(|error| error.to_string());
        let has = |part: &str| definition.split_whitespace().any(|word| word == part);
        let zero = |word: &str| word.strip_prefix("+towgs84=").map(|shift| shift.split(',').all(is_zero));
        let given = definition.split_whitespace().find_map(zero);
        let is_global = given.unwrap_or_else(|| GLOBAL.iter().any(|part| has(part)));
        let is_known = is_global || given.is_some() || definition.contains("+datum=") || has("+proj=webmerc");
        // Of NAD27 the shift is a grid, which is not read.
        if !is_known || has("+datum=NAD27") {
            return Err("the shift of its datum to WGS84 is not known".to_owned());
        }
        let number = |key: &str| definition.split_whitespace().find_map(|word| word.strip_prefix(key)?.parse().ok());
        let meridian_deg = match NARROW.iter().any(|part| has(part)) {
            true => number("+lon_0="),
            false => number("+zone=").filter(|_| has("+proj=utm")).map(|zone: f64| 6.0 * zone - 183.0),
        };
        let definition = proj(definition)?;
        if definition.is_geocent() || !definition.has_inverse() {
            return Err("its coordinates are not east and north".to_owned());
        }
        Ok(Self { definition, wgs84: proj(WGS84)?, is_shifted: !is_global, meridian_deg })
    }

    /// Whether its coordinates are longitude and latitude.
    #[must_use]
    pub fn is_in_degrees(&self) -> bool {
        self.definition.is_latlong()
    }

    /// The length of its unit [m]; of one in degrees 1.
    #[must_use]
    pub fn unit_m(&self) -> f64 {
        self.definition.to_meter()
    }

    /// Latitude and longitude [°] on WGS84 of the position `x` to the east and `y` to the north, in its units, rounded
    /// to 0.1 mm.
    ///
    /// # Errors
    /// If the position has none, with what was expected.
    pub fn to_geodetic(&self, [x, y]: [f64; 2]) -> Result<[f64; 2], String> {
        if self.is_in_degrees() {
            check_geodetic([y, x])?;
        } else if x.abs().max(y.abs()) <= MOST_DEG {
            return Err(format!("{x}, {y}: expected lengths of a map, not degrees"));
        }
        let refuse = || format!("{x}, {y}: expected a position of its reference system, east and north");
        let mut at = if self.is_in_degrees() { (x.to_radians(), y.to_radians(), 0.0) } else { (x, y, 0.0) };
        let from = at;
        transform(&self.definition, &self.wgs84, &mut at).map_err(|_| refuse())?;
        let position = [at.1, at.0].map(|radians| (radians.to_degrees() * 1e9).round() / 1e9);
        transform(&self.wgs84, &self.definition, &mut at).map_err(|_| refuse())?;
        let is_there = (at.0 - from.0).abs().max((at.1 - from.1).abs()) < MOST_ERROR;
        let aside_deg = self.meridian_deg.map_or(0.0, |meridian_deg| position[1] - meridian_deg);
        let aside_deg = (aside_deg + 540.0).rem_euclid(360.0) - 180.0;
        if !is_there || check_geodetic(position).is_err() || aside_deg.abs() > MOST_ASIDE_DEG {
            return Err(refuse() + ": is the northing first, or in feet?");
        }
        Ok(position)
    }
}

fn is_zero(number: &str) -> bool {
    number.trim().parse() == Ok(0.0)
}

/// The part of a well-known text that is about places on a plane or in degrees, without that of heights and without the
/// aim of a transformation. `capitals` are those of `text`.
fn horizontal<'a>(text: &'a str, capitals: &str) -> &'a str {
    let start = HORIZONTAL.iter().find_map(|word| capitals.find(word)).unwrap_or(0);
    let mut depth = 0;
    let mut is_string = false;
    for (at, character) in text[start..].char_indices() {
        match character {
            '"' => is_string = !is_string,
            '[' if !is_string => depth += 1,
            ']' if !is_string && depth == 1 => return &text[start..=start + at],
            ']' if !is_string => depth -= 1,
            _ => {}
        }
    }
    &text[start..]
}

/// The EPSG code of a well-known text, which is the last that it says.
fn code_of(text: &str) -> Option<&str> {
    let (_, authority) = text.rsplit_once("\"EPSG\",")?;
    let code = authority.trim_end_matches(']').trim().trim_matches('"');
    (!code.is_empty() && code.bytes().all(|byte| byte.is_ascii_digit())).then_some(code)
}

/// Why the lengths of a plane are not metres; `None` if they are. `capitals` are those of `text`.
fn no_metres(text: &str, capitals: &str) -> Option<String> {
    // The last unit is that of lengths: `UNIT["Foot_US",0.3048006]`, also within `LENGTHUNIT`.
    let unit = &text[capitals.rfind("UNIT[")?..];
    let name = unit.split('"').nth(1)?;
    let length_m: f64 = unit.split([',', ']']).nth(1)?.trim().parse().ok()?;
    ((length_m - 1.0).abs() > 1e-4).then(|| format!("its unit is `{}`, {length_m} m", quoted(name)))
}

#[cfg(test)]
mod tests;
