//! Options of `skysink new` that are commands of the Python package: grids of heights (decision D37) and flight logs (D32).

use expect_test::expect_file;

use crate::support::Place;

#[test]
fn terrain_and_logs_are_refused_with_the_command_of_python() {
    let place = Place::new();
    place.assert_transcript(&expect_file!["transcripts/surveys.txt"]);
    for name in ["hill", "aerial"] {
        assert!(!place.path(name).exists(), "{name}");
    }
}

#[test]
fn the_help_of_new_names_the_commands_and_not_the_options() {
    let place = Place::new();
    let help = place.run_ok(&["new", "--help"]).stdout;
    for (command, option) in [("python -m skysink.terrain", "--terrain <"), ("python -m skysink.measured", "--log <")] {
        assert!(help.contains(command) && !help.contains(option), "{help}");
    }
}
