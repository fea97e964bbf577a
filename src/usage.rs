//! Parses the command line of an executable, with help and usage that fit into 80 columns.

use std::ffi::OsString;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use clap::error::{ContextKind, ContextValue};
use clap::{Command, Error, Parser};
use skysink_common::build;
use skysink_common::terminal::one_line;
use skysink_ring::role::Role;

use crate::error::Error as SkysinkError;
use crate::report::TERMINAL_WIDTH;

/// What the executables are built from: commit, compiler and target.
pub const BUILD: &str = env!("SKYSINK_BUILD");

/// The compiler of the executables.
pub const COMPILER: &str = env!("SKYSINK_RUSTC");

/// Version of the executables, with [`BUILD`].
pub const VERSION: &str = concat!(env!("CARGO_PKG_VERSION"), " (", env!("SKYSINK_BUILD"), ")");

/// Maximum width of help and usage [columns].
const COLUMNS: usize = TERMINAL_WIDTH as usize;

/// Most characters of an argument in a refusal.
const MAX_QUOTED: usize = 200;

/// A command line without a command: help is printed.
const MISSING_COMMAND: clap::error::ErrorKind = clap::error::ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand;

/// What clap writes before a usage line.
const HEADING: &str = "Usage: ";

/// Parses a command line, program name first, and notes [`BUILD`] for the results of this process.
///
/// # Errors
/// If an argument is refused, or help is requested.
pub fn parse<C: Parser>(arguments: impl IntoIterator<Item = OsString>) -> Result<C, Error> {
    build::identify(BUILD);
    let arguments: Vec<OsString> = arguments.into_iter().collect();
    let called = arguments.first().map(PathBuf::from);
    let name = called.as_deref().and_then(Path::file_name).unwrap_or_default().to_string_lossy();
    let mut command = with_wrapped_usage(C::command().bin_name(name.into_owned()));
    let matches = command.try_get_matches_from_mut(arguments)?;
    C::from_arg_matches(&matches).map_err(|error| error.format(&mut command))
}

/// Prints the requested help, or what is wrong with the arguments of the program `role`, and returns the exit code.
pub fn print(role: Role, message: Error) -> u8 {
    let code = u8::try_from(message.exit_code()).unwrap_or(2);
    if message.use_stderr() && message.kind() != MISSING_COMMAND {
        role.log(refusal(message));
        return code;
    }
    match message.print() {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => {
            role.log(SkysinkError::Output(error));
            1
        }
        _ => code,
    }
}

/// What is wrong with the arguments, in one line with the usage. They are quoted like other input: they may be long,
/// and hold control characters.
fn refusal(mut message: Error) -> String {
    let quote = |text: &String| one_line(text, MAX_QUOTED);
    let quotes = message.context().filter_map(|(kind, value)| match value {
        ContextValue::String(text) => Some((kind, ContextValue::String(quote(text)))),
        ContextValue::Strings(texts) => Some((kind, ContextValue::Strings(texts.iter().map(quote).collect()))),
        _ => None,
    });
    for (kind, quoted) in quotes.collect::<Vec<_>>() {
        if message.insert(kind, quoted.clone()) != Some(quoted) {
            message.remove(ContextKind::Suggested); // it repeats the argument as it is
        }
    }
    let text = message.render().to_string();
    let text = text.split("\nFor more information").next().unwrap_or_default();
    let (said, usage) = text.split_once(HEADING).unwrap_or((text, ""));
    let mut line = String::new();
    for part in said.lines().map(str::trim) {
        let values = part.strip_prefix("[possible values: ").and_then(|values| values.strip_suffix(']'));
        let part = match values {
            Some(values) => format!("expected one of {values}"),
            None => part.trim_start_matches("error: ").trim_start_matches("tip: ").to_owned(),
        };
        if part.is_empty() || part.starts_with("to pass '") {
            continue; // an argument that looks like an option is seldom meant as a value
        }
        line += match line.chars().last() {
            None => "",
            Some(':') => " ",
            Some(_) if values.is_some() => ": ",
            Some(_) => "; ",
        };
        line += &part;
    }
    if !usage.is_empty() {
        line += "; usage: ";
        line += &usage.split_whitespace().collect::<Vec<_>>().join(" ");
    }
    line
}

/// The command and its subcommands, with usage lines that are wrapped in their help.
fn with_wrapped_usage(command: Command) -> Command {
    let mut command = command.max_term_width(COLUMNS);
    command.build();
    wrap_usage(command.mut_subcommands(wrap_usage))
}

fn wrap_usage(mut command: Command) -> Command {
    let usage = command.render_usage().to_string();
    let usage = wrap(usage.trim().trim_start_matches(HEADING));
    command.override_usage(usage)
}

/// Wraps a usage line. An option stays on one line with its value.
fn wrap(usage: &str) -> String {
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

/// Splits a usage line at spaces, except within brackets and between an option and its value.
fn parts(usage: &str) -> Vec<&str> {
    let is_option = |part: &str| part.starts_with('-') && !part.contains(' '); // without its value
    let mut parts = Vec::new();
    let mut depth = 0usize;
    let mut begin = 0;
    for (at, character) in usage.char_indices() {
        match character {
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
    fn a_refused_argument_is_escaped() {
        let command = || Command::new("fly").arg(clap::arg!(--seed <SEED>).value_parser(clap::value_parser!(u8)));
        let long = "x".repeat(100_000);
        for argument in
            [&format!("--seed={long}"), &format!("--{long}"), &long, "--seed=\x1b[2J\u{202e}", "-\x07", "\n\n"]
        {
            let said = refusal(command().try_get_matches_from(["fly", argument]).unwrap_err());
            assert!(said.len() < 1500 && said.lines().count() == 1, "{said:?}");
        }
    }

    #[test]
    fn a_refusal_is_one_line_with_what_was_expected() {
        let wait = clap::arg!(--wait <HOW>).value_parser(["poll", "event"]);
        let command = || with_wrapped_usage(Command::new("fly").arg(wait.clone()).arg(clap::arg!(<SCENARIO>)));
        let said = |words: &[&str]| refusal(command().try_get_matches_from([&["fly"], words].concat()).unwrap_err());
        assert_eq!(
            said(&["a", "--wait", "spin"]),
            "invalid value 'spin' for '--wait <HOW>': expected one of poll, event"
        );
        let missing = "the following required arguments were not provided: <SCENARIO>; usage: fly [OPTIONS] <SCENARIO>";
        assert_eq!(said(&["--wait", "poll"]), missing);
        let unknown =
            "unexpected argument '--wat' found; a similar argument exists: '--wait'; usage: fly [OPTIONS] <SCENARIO>";
        assert_eq!(said(&["a", "--wat"]), unknown);
    }

    #[test]
    fn a_long_usage_is_wrapped_between_its_parts() {
        let usage = "viewer [OPTIONS] --scenario <FILE> --ring <DIR> <--save <FILE>|--live[=<PORT>]>";
        let expected = ["viewer", "[OPTIONS]", "--scenario <FILE>", "--ring <DIR>", "<--save <FILE>|--live[=<PORT>]>"];
        assert_eq!(parts(usage), expected);
        let wrapped = "viewer [OPTIONS] --scenario <FILE> --ring <DIR>\n       <--save <FILE>|--live[=<PORT>]>";
        assert_eq!(wrap(usage), wrapped);
        assert_eq!(wrap("skysink compare [OPTIONS] <A B | C>..."), "skysink compare [OPTIONS] <A B | C>...");
    }
}
