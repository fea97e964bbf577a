//! The help of every command and executable fits into a terminal of 80 columns, and refusals of options into a line.

use crate::support::{Output, Place, output};

/// Columns of the terminal.
const COLUMNS: usize = 80;

/// Fails if a line is too long; letters beyond ASCII count once.
fn assert_fits(ended: &Output, what: &[&str]) {
    let lines = ended.stdout.lines().chain(ended.stderr.lines());
    for line in lines {
        assert!(line.chars().count() <= COLUMNS, "{what:?}: {line}");
    }
    assert!(!ended.stdout.is_empty() || !ended.stderr.is_empty(), "{what:?}");
}

/// The commands that the help lists.
fn commands(place: &Place) -> Vec<String> {
    let help = place.run_ok(&["--help"]).stdout;
    let listed = help.lines().skip_while(|line| *line != "Commands:").skip(1).take_while(|line| !line.is_empty());
    let names = listed.filter(|line| line.starts_with("  ") && !line.starts_with("   "));
    names.map(|line| line.split_whitespace().next().unwrap().to_owned()).collect()
}

#[test]
fn the_help_of_every_command_fits_into_a_terminal_of_80_columns() {
    let place = Place::new();
    let commands = commands(&place);
    assert!(commands.len() > 8, "{commands:?}");
    for command in commands.iter().filter(|command| *command != "help") {
        for help in ["-h", "--help"] {
            let help = [command, help];
            assert_fits(&place.run_ok(&help), &help);
        }
    }
    for help in ["-h", "--help"] {
        assert_fits(&place.run_ok(&[help]), &[help]);
    }
    let mut executables = vec![env!("CARGO_BIN_EXE_field-sim"), env!("CARGO_BIN_EXE_flight-sim")];
    executables.push(env!("CARGO_BIN_EXE_planner"));
    #[cfg(feature = "viewer")]
    executables.push(env!("CARGO_BIN_EXE_viewer"));
    for executable in executables {
        let ended = output(place.command(executable, &["--help"]));
        assert_fits(&ended, &[executable]);
        let name = std::path::Path::new(executable).file_name().unwrap().to_str().unwrap();
        assert!(ended.stdout.contains(&format!("Usage: {name} ")), "{ended:?}");
    }
}

#[test]
fn a_refusal_of_options_is_one_line_with_the_usage() {
    let place = Place::new();
    let refused = [
        "run",
        "a",
        "b",
        "--seed",
        "3",
        "--strategy",
        "uts",
        "--out",
        "x",
        "--pace",
        "max",
        "--wait",
        "poll",
        "--timeout",
        "3",
        "--restart",
        "never",
        "--label",
        "x",
        "--planner",
        "y",
        "--external",
        "planner",
    ];
    let ended = place.run(&refused);
    assert_eq!(ended.code, Some(2), "{ended:?}");
    assert!(ended.stderr.starts_with("skysink: unexpected argument 'b' found; usage: skysink run "), "{ended:?}");
    assert_eq!(ended.stderr.lines().count(), 1, "{ended:?}");
}
