//! The command line of an executable, with help and usage that fit into a terminal of 80 columns.

use std::ffi::OsString;
use std::path::{Path, PathBuf};

use clap::{Command, Error, Parser};

use crate::report::TERMINAL_WIDTH;

/// Columns that help and usage fit into everywhere.
const COLUMNS: usize = TERMINAL_WIDTH as usize;

/// What clap writes before a usage line.
const HEADING: &str = "Usage: ";

/// Reads a command line, which begins with what the program was called by.
///
/// # Errors
/// If it is refused, or asks for help.
pub fn parse<C: Parser>(arguments: impl IntoIterator<Item = OsString>) -> Result<C, Error> {
    let arguments: Vec<OsString> = arguments.into_iter().collect();
    let called = arguments.first().map(PathBuf::from);
    let name = called.as_deref().and_then(Path::file_name).unwrap_or_default().to_string_lossy();
    let mut command = fitting(C::command().bin_name(name.into_owned()));
    let matches = command.try_get_matches_from_mut(arguments)?;
    C::from_arg_matches(&matches).map_err(|error| error.format(&mut command))
}

/// The command and its subcommands, each with one usage line, in errors, too, which is broken where it is long.
fn fitting(command: Command) -> Command {
    let mut command = command.max_term_width(COLUMNS);
    command.build();
    with_usage(command.mut_subcommands(with_usage))
}

fn with_usage(mut command: Command) -> Command {
    let usage = command.render_usage().to_string();
    let usage = broken(usage.trim().trim_start_matches(HEADING));
    command.override_usage(usage)
}

/// A usage line in as many lines as it takes; an option stays with its value.
fn broken(usage: &str) -> String {
    let mut text = String::new();
    let mut column = HEADING.len();
    for part in parts(usage) {
        let width = part.chars().count();
        if column > HEADING.len() && column + 1 + width > COLUMNS {
            text += &format!("\n{:1$}", "", HEADING.len());
            column = HEADING.len();
        } else if column > HEADING.len() {
            text.push(' ');
            column += 1;
        }
        text += part;
        column += width;
    }
    text
}

/// The words of a usage line: brackets are not broken, nor is an option from its value.
fn parts(usage: &str) -> Vec<&str> {
    let is_option = |part: &str| part.starts_with('-') && !part.contains(' '); // without its value
    let mut parts = Vec::new();
    let mut depth = 0usize;
    let mut begin = 0;
    for (at, letter) in usage.char_indices() {
        match letter {
            '<' | '[' => depth += 1,
            '>' | ']' => depth = depth.saturating_sub(1),
            ' ' if depth == 0 && !(is_option(&usage[begin..at]) && usage[at..].starts_with(" <")) => {
                parts.push(&usage[begin..at]);
                begin = at + 1;
            }
            _ => {}
        }
    }
    parts.push(&usage[begin..]);
    parts
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_usage_is_broken_between_its_parts() {
        let usage = "viewer [OPTIONS] --scenario <FILE> --ring <DIR> <--save <FILE>|--live[=<PORT>]>";
        let expected = ["viewer", "[OPTIONS]", "--scenario <FILE>", "--ring <DIR>", "<--save <FILE>|--live[=<PORT>]>"];
        assert_eq!(parts(usage), expected);
        let broken_usage = "viewer [OPTIONS] --scenario <FILE> --ring <DIR>\n       <--save <FILE>|--live[=<PORT>]>";
        assert_eq!(broken(usage), broken_usage);
        assert_eq!(broken("skysink compare [OPTIONS] <A B | C>..."), "skysink compare [OPTIONS] <A B | C>...");
    }
}
