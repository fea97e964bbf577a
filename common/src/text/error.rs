//! Reading of input files, and the error of a refused one.

use std::fmt::Display;
use std::fs;
use std::path::{Path, PathBuf};

use crate::terminal::one_line;

/// Most characters of a line or a value that are quoted.
const MAX_QUOTED: usize = 80;

/// Most characters of a path.
pub(crate) const MAX_PATH: usize = 400;

/// Most characters of a message; those of other libraries may hold a value of any length.
const MAX_MESSAGE: usize = 600;

/// Length of a name above which no other is suggested [bytes].
const MOST_COMPARED: usize = 200;

/// Jaro-Winkler similarity, 0 to 1, above which a name is suggested for another.
const MIN_SIMILARITY: f64 = 0.8;

/// A refused file, folder or option. The display is one line with its name, the key or line, the value, and what was
/// expected.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{what} {}: {message}", one_line(&path.to_string_lossy(), MAX_PATH))]
pub struct InputError {
    /// Kind of input, such as `scenario`.
    pub what: &'static str,
    /// The file or folder, or the argument of an option.
    pub path: PathBuf,
    /// The key or line, the value, and what was expected, on one line.
    pub message: String,
}

impl InputError {
    /// Refuses `path`. Control characters in the message are escaped, and the middle of a long message is left out.
    #[must_use]
    pub fn new(what: &'static str, path: &Path, message: impl Display) -> Self {
        Self { what, path: path.to_owned(), message: one_line(&message.to_string(), MAX_MESSAGE) }
    }

    /// Refuses the `argument` of the option `what`.
    #[must_use]
    pub fn of_argument(what: &'static str, argument: &str, message: impl Display) -> Self {
        Self::new(what, Path::new(argument), message)
    }

    /// Refuses line number `line`, from 1, of `path`, and quotes the beginning of its `text`.
    #[must_use]
    pub fn line(what: &'static str, path: &Path, line: usize, text: &str, message: impl Display) -> Self {
        Self::new(what, path, format_args!("line {line}: `{}`: {message}", quoted(text)))
    }

    /// Refuses `path`, whose `text` is not the expected TOML, with the line, its text and the reason.
    #[must_use]
    pub fn toml(what: &'static str, path: &Path, text: &str, error: &toml::de::Error) -> Self {
        let message = match error.message().trim() {
            large if large.contains(" as i128") => "expected a whole number below 2^63".to_owned(),
            message => message.replace('\n', ", ") + &suggestion(message),
        };
        let Some(span) = error.span() else { return Self::new(what, path, message) };
        let number = text[..span.start.min(text.len())].matches('\n').count() + 1;
        Self::line(what, path, number, text.lines().nth(number - 1).unwrap_or_default(), message)
    }
}

/// The candidate most similar to `name`, if one is similar enough; the first of equals.
#[must_use]
pub fn did_you_mean<'a>(name: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    if name.len() > MOST_COMPARED {
        return None; // a comparison takes the square of the length
    }
    let scored = candidates.into_iter().map(|candidate| (strsim::jaro_winkler(name, candidate), candidate));
    let similar = scored.filter(|&(similarity, _)| similarity > MIN_SIMILARITY);
    similar.reduce(|best, next| if next.0 > best.0 { next } else { best }).map(|(_, candidate)| candidate)
}

/// Size of a file of settings, and of data, at most [MB]: what is parsed takes up to ten times as much memory.
const MOST_SETTINGS_MB: u64 = 16;
const MOST_MB: u64 = 500;

/// Reads the file `path`, of the kind `what`.
///
/// # Errors
/// If it cannot be read, is not a regular file (a pipe may never end), or is too large.
pub fn read_bytes(what: &'static str, path: &Path) -> Result<Vec<u8>, InputError> {
    let refuse = |message: &dyn Display| InputError::new(what, path, message);
    let kind = fs::metadata(path).map_err(|error| refuse(&error))?;
    if !kind.is_file() {
        let found = if kind.is_dir() { "it is a folder" } else { "it is a pipe or a device" };
        return Err(refuse(&format_args!("{found}: expected a regular file")));
    }
    let most_mb = if ["scenario", "sweep"].contains(&what) { MOST_SETTINGS_MB } else { MOST_MB };
    if kind.len() > most_mb * 1_000_000 {
        let mb = kind.len() / 1_000_000;
        return Err(refuse(&format_args!("{mb} MB: expected at most {most_mb} MB")));
    }
    fs::read(path).map_err(|error| refuse(&error))
}

/// Reads the text file `path`, of the kind `what`.
///
/// # Errors
/// If it cannot be read, is not a regular file (a pipe may never end), or is not UTF-8.
pub fn read_text(what: &'static str, path: &Path) -> Result<String, InputError> {
    let refuse = |message: &dyn Display| InputError::new(what, path, message);
    String::from_utf8(read_bytes(what, path)?).map_err(|error| {
        let valid = &error.as_bytes()[..error.utf8_error().valid_up_to()];
        let line = valid.iter().filter(|&&byte| byte == b'\n').count() + 1;
        refuse(&format_args!("line {line}: expected UTF-8 text"))
    })
}

/// The beginning of a refused text, short enough for one line of a terminal, control characters escaped.
#[must_use]
pub fn quoted(text: &str) -> String {
    let text = text.trim();
    let end = text.char_indices().nth(MAX_QUOTED).map_or(text.len(), |(end, _)| end);
    let dots = if end < text.len() { "..." } else { "" };
    one_line(&text[..end], usize::MAX) + dots
}

/// A hint for a message of serde about an unknown name: the expected name most similar to it, and where the way around
/// is described if it is of something that is not modelled. Empty without either.
#[must_use]
pub fn suggestion(message: &str) -> String {
    let mut names = message.split('`').skip(1).step_by(2);
    let Some(name) = names.next().filter(|_| message.starts_with("unknown")) else { return String::new() };
    let meant = did_you_mean(name, names).map(|meant| format!("; did you mean `{meant}`?"));
    let page = not_modelled(name).map(|NotModelled { heading, instead, .. }| {
        let joint = if meant.is_some() { " If not," } else { ";" };
        let page = format!("\"{heading}\" in \"What Skysink does not model\" of the documentation");
        format!("{joint} it is not modelled: {instead}; see {page}")
    });
    [meant, page].into_iter().flatten().collect()
}

/// The line of a record in `text`, from 1. The position of [`csv`] is that of the first empty line before the record.
#[must_use]
pub fn line_of(text: &str, position: Option<&csv::Position>) -> u64 {
    let Some(position) = position else { return 0 };
    let rest = text.as_bytes().get(position.byte() as usize..).unwrap_or_default();
    let empty = rest.iter().take_while(|byte| b"\r\n".contains(byte)).filter(|&&byte| byte == b'\n').count();
    position.line() + empty as u64
}

/// What is not modelled, by the headings of `docs/src/not-modelled.md`.
struct NotModelled {
    heading: &'static str,
    /// What to do instead.
    instead: &'static str,
    /// Words of keys that are for it.
    words: &'static [&'static str],
}

const NOT_MODELLED: [NotModelled; 10] = [
    NotModelled {
        heading: "Events",
        instead: "describe events by a trace of arrivals, sensors.arrivals.model = \"trace\"",
        words: &["event", "events", "burst", "bursts", "diurnal"],
    },
    NotModelled {
        heading: "Energy",
        instead: "choose smaller uav.battery.capacity_j by what landing, radio, computer and age take",
        words: &["landing", "takeoff", "computer", "avionics", "hotel", "aging", "ageing", "sag"],
    },
    NotModelled {
        heading: "Terrain",
        instead: "make zones and a map of links by `python -m skysink.terrain NAME --sensors FILE --terrain FILE`",
        words: &["terrain", "elevation", "dem", "relief", "reflection", "diffraction"],
    },
    NotModelled {
        heading: "Gusts",
        instead: "move where a slot ends by uav.position_error_m, with a constant uav.wind_mps",
        words: &["gust", "gusts", "weather", "turbulence"],
    },
    NotModelled {
        heading: "Motion",
        instead: "set uav.acceleration_mps2, or fly an autopilot by `skysink run --vehicle`",
        words: &["turn", "bank", "yaw", "jerk", "curvature"],
    },
    NotModelled {
        heading: "Several UAVs",
        instead: "set uav.count, or plan for all UAVs in a ring by `skysink run --planner`",
        words: &["uavs", "fleet", "drones", "swarm", "latency"],
    },
    NotModelled {
        heading: "Sensor nodes",
        instead: "choose a smaller link.comm_radius_m for sensor nodes that move; a cluster head has the rate of its \
            cluster",
        words: &["mobility", "relay", "hops", "sleep", "failure", "cluster"],
    },
    NotModelled {
        heading: "Base station",
        instead: "add the time of the route home to the ages of the data",
        words: &["memory", "backhaul", "gateway"],
    },
    NotModelled {
        heading: "What will not be added",
        instead: "use another simulator, such as ns-3, OMNeT++, or PX4 with Gazebo",
        words: &["packet", "packets", "routing", "mac", "wing", "stall"],
    },
    NotModelled {
        heading: "Radio",
        instead: "set link.preset, a smaller link.bandwidth_hz, or a table of rates, link.model = \"table\"",
        words: &["lora", "wifi", "ble", "zigbee", "collisions", "interference", "beacon"],
    },
];

/// What is not modelled that the key `name` is for.
fn not_modelled(name: &str) -> Option<&'static NotModelled> {
    let is_of = |words: &[&str]| name.split(['_', '-']).any(|word| words.contains(&word));
    NOT_MODELLED.iter().find(|one| is_of(one.words))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_refused_text_is_shortened_and_its_control_characters_are_escaped() {
        let error =
            InputError::line("scenario", Path::new("a\nb"), 1, &format!("\x1b[31m{}", "x".repeat(1 << 20)), "no");
        assert_eq!(error.to_string(), format!("scenario a\\nb: line 1: `\\u001b[31m{}...`: no", "x".repeat(75)));
        let error =
            InputError::new("scenario", Path::new("a"), "x".repeat(1 << 20) + ": expected a number").to_string();
        assert!(error.len() < 700 && error.ends_with("x: expected a number"), "{error}");
    }

    #[test]
    fn a_key_of_an_unmodelled_feature_names_the_documentation() {
        let page = include_str!("../../../docs/src/not-modelled.md");
        let unknown = |name: &str| suggestion(&format!("unknown field `{name}`, expected `slots` or `width_m`"));
        for NotModelled { heading, instead, words } in &NOT_MODELLED {
            let see = format!("see \"{heading}\" in \"What Skysink does not model\" of the documentation");
            for word in *words {
                assert_eq!(unknown(&format!("{word}_quantity")), format!("; it is not modelled: {instead}; {see}"));
            }
        }
        let headings: Vec<&str> = page.lines().filter_map(|line| line.strip_prefix("## ")).collect();
        let mut named = NOT_MODELLED.map(|one| one.heading);
        named.sort_by_key(|heading| headings.iter().position(|one| one == heading));
        assert_eq!(headings, named);
        assert!(page.starts_with("# What Skysink does not model\n"));
        assert_eq!(unknown("energy"), "");
        let both = suggestion("unknown field `terrain`, expected `terrains`");
        assert!(both.starts_with("; did you mean `terrains`? If not, it is not modelled: make zones"), "{both}");
        assert_eq!(unknown("window"), "");
        assert_eq!(unknown("slot"), "; did you mean `slots`?");
        assert_eq!(suggestion("missing field `wind`"), "");
    }

    #[test]
    fn an_irregular_or_binary_file_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        let refused = |path: &Path| read_text("scenario", path).unwrap_err().message;
        assert!(refused(&path).contains("No such file"));
        assert_eq!(refused(folder.path()), "it is a folder: expected a regular file");
        assert_eq!(refused(Path::new("/dev/zero")), "it is a pipe or a device: expected a regular file");
        fs::write(&path, b"a\nb\n\xff").unwrap();
        assert_eq!(refused(&path), "line 3: expected UTF-8 text");
        fs::File::create(&path).unwrap().set_len(17_000_000).unwrap();
        assert_eq!(refused(&path), "17 MB: expected at most 16 MB");
        assert!(read_bytes("sensor list", &path).is_ok());
        fs::File::create(&path).unwrap().set_len(501_000_000).unwrap();
        let large = read_bytes("sensor list", &path).unwrap_err().message;
        assert_eq!(large, "501 MB: expected at most 500 MB");
    }

    #[test]
    fn a_misspelt_name_gets_the_closest_suggestion() {
        let names = ["uts", "uts-wide", "round-robin", "max-age-first", "horizon"];
        for (name, meant) in [
            ("uts_wide", Some("uts-wide")),
            ("horizn", Some("horizon")),
            ("roundrobin", Some("round-robin")),
            ("UTS", None),
            ("best", None),
            ("", None),
        ] {
            assert_eq!(did_you_mean(name, names), meant, "{name}");
        }
        assert_eq!(did_you_mean("slot", ["slots", "slot_s"]), Some("slots"));
        assert_eq!(did_you_mean("uts", []), None);
        assert_eq!(did_you_mean(&"slots".repeat(1_000_000), ["slots"]), None); // at once
    }
}
