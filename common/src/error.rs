//! Input that is refused.

use std::fmt::Display;
use std::path::{Path, PathBuf};

/// Most characters of a line that are quoted.
const MAX_QUOTED: usize = 200;

/// Likeness (Jaro and Winkler, 0 to 1) above which a word may be meant by another.
const LEAST_LIKENESS: f64 = 0.8;

/// A file or folder that is refused; the display is one line that names it, the key or line, the value, and what was
/// expected.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{what} {}: {message}", shown(path))]
pub struct InputError {
    /// What it is, such as `scenario`.
    pub what: &'static str,
    /// The file or folder.
    pub path: PathBuf,
    /// What is wrong where, and what was expected; on one line.
    pub message: String,
}

impl InputError {
    /// Refuses `path`. Control characters in the message, which a file's text may bring in, become spaces.
    #[must_use]
    pub fn new(what: &'static str, path: &Path, message: impl Display) -> Self {
        let message = message.to_string().replace(char::is_control, " ");
        Self { what, path: path.to_owned(), message }
    }

    /// Refuses `line`, from 1, of `path`, and quotes its `text`, as far as a terminal shows it in a line or two.
    #[must_use]
    pub fn line(what: &'static str, path: &Path, line: usize, text: &str, message: impl Display) -> Self {
        let quoted: String = text.trim().chars().take(MAX_QUOTED).collect();
        Self::new(what, path, format_args!("line {line}: `{quoted}`: {message}"))
    }

    /// Refuses `path`, whose `text` is not the TOML that was expected: says the line, the text there, and why.
    #[must_use]
    pub fn toml(what: &'static str, path: &Path, text: &str, error: &toml::de::Error) -> Self {
        let message = error.message().trim().replace('\n', ", ");
        let Some(span) = error.span() else { return Self::new(what, path, message) };
        let number = text[..span.start.min(text.len())].matches('\n').count() + 1;
        Self::line(what, path, number, text.lines().nth(number - 1).unwrap_or_default(), message)
    }
}

/// The candidate that `name` was probably meant to be, if one is alike enough; the first of equals.
#[must_use]
pub fn did_you_mean<'a>(name: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let alike = candidates.into_iter().map(|candidate| (strsim::jaro_winkler(name, candidate), candidate));
    let alike = alike.filter(|&(likeness, _)| likeness > LEAST_LIKENESS);
    alike.reduce(|best, next| if next.0 > best.0 { next } else { best }).map(|(_, candidate)| candidate)
}

/// A path on one line, whatever is in it.
fn shown(path: &Path) -> String {
    path.display().to_string().replace(char::is_control, " ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_misspelt_name_is_taken_for_the_candidate_most_like_it() {
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
    }
}
