//! The command line: output, files and exit codes.

use expect_test::expect_file;

use crate::support::scenarios::SMOKE;
use crate::support::{Place, assert_balanced, lines, output, pid, until, wait};
use rustix::process::{Signal, kill_process};

#[test]
fn an_output_folder_that_exists_is_refused_without_force() {
    let place = Place::new();
    place.flight("smoke").simulate();
    let before = place.trace("run");
    place.write("run/notes.txt", "mine");
    for command in ["simulate", "run"] {
        let ended = place.run(&[command, SMOKE, "--out", "run", "--seed", "9"]);
        ended.assert_code(2).assert_one_line(&["run", "exists", "--force"]);
    }
    assert_eq!(place.trace("run"), before);
    place.flight("smoke").seed(9).force().simulate();
    assert_ne!(place.trace("run"), before);
    assert_eq!(place.read("run/notes.txt"), "mine", "what is not of a run stays");
}

#[test]
fn default_folders_are_numbered() {
    let place = Place::new();
    for folder in ["runs/smoke-uts-1", "runs/smoke-uts-1-2", "runs/smoke-uts-1-3"] {
        place.run_ok(&["simulate", SMOKE]);
        assert!(place.path(folder).join("summary.json").is_file(), "{folder}");
    }
    place.run_ok(&["simulate", SMOKE, "--strategy", "gfs", "--seed", "7"]);
    assert!(place.path("runs/smoke-gfs-7/slots.csv").is_file());
}

#[test]
fn any_key_can_be_set_from_the_command_line() {
    let place = Place::new();
    place.write("a.toml", "name = \"a\"\nslots = 30\n");
    place.write("b.toml", "name = \"b\"\nslots = 40\n[link]\nbandwidth_hz = 5e3\n[planner]\nstrategy = \"gfs\"\n");
    let set = ["--set", "name=b", "--set", "slots = 40", "--set", "link.bandwidth_hz=5e3"];
    let strategy = ["--set", "planner.strategy=\"gfs\""];
    place.flight("a").options(&[&set[..], &strategy].concat()).out("set").simulate();
    place.flight("b").out("written").simulate();
    for file in ["scenario.toml", "slots.csv"] {
        assert_eq!(place.read(&format!("set/{file}")), place.read(&format!("written/{file}")), "{file}");
    }
}

#[test]
fn a_summary_contains_the_documented_fields() {
    let place = Place::new();
    place.flight("smoke").simulate();
    let summary = place.summary("run");
    for key in [
        "strategy",
        "seed",
        "slots",
        "sensors",
        "loss_rate",
        "eta_letter",
        "sampled_bits",
        "delivered_bits",
        "lost_bits",
        "queued_bits",
        "initial_bits",
        "bits_per_waypoint",
        "mean_served",
        "held_slots",
        "refused",
        "complete",
        "version",
    ] {
        assert!(!summary[key].is_null(), "{key}");
    }
    assert_balanced(&summary);
    assert_eq!(summary["complete"], true);
}

#[test]
fn results_contain_the_commit_compiler_and_target_of_the_build() {
    let place = Place::new();
    place.flight("smoke").simulate();
    let said = place.run_ok(&["--version"]).stdout;
    let prefix = concat!("skysink ", env!("CARGO_PKG_VERSION"), " (");
    let build = said.strip_prefix(prefix).and_then(|said| said.strip_suffix(")\n")).unwrap_or_else(|| panic!("{said}"));
    assert_eq!(place.summary("run")["build"], build);
    assert!(place.read("run/run.toml").contains(&format!("build = \"{build}\"\n")), "{build}");
    assert!(build.contains(", rustc ") && build.contains(std::env::consts::ARCH), "{build}");

    let root = env!("CARGO_MANIFEST_DIR");
    let git = |what: &str| {
        let said = place.command("git", &["-C", root, "rev-parse", what]).output().map(|output| output.stdout);
        String::from_utf8_lossy(&said.unwrap_or_default()).trim().to_owned()
    };
    let is_checkout = std::fs::canonicalize(git("--show-toplevel")).is_ok_and(|folder| folder == *root);
    let commit = if is_checkout { git("HEAD")[..12].to_owned() } else { "no commit,".to_owned() };
    assert!(build.contains(&commit), "{build}: expected {commit}");
}

#[test]
fn every_slot_of_a_trace_balances() {
    let place = Place::new();
    for strategy in ["uts", "gfs", "rfs"] {
        place.flight("smoke").strategy(strategy).out(strategy).simulate();
        let summary = place.summary(strategy);
        let trace = place.trace(strategy);
        let mut queued_bits = summary["initial_bits"].as_u64().unwrap();
        let sampled_bits = summary["sampled_bits"].as_u64().unwrap() / summary["slots"].as_u64().unwrap();
        for line in trace.lines().skip(1) {
            let bits = |column: usize| line.split(',').nth(column).unwrap().parse::<u64>().unwrap();
            assert_eq!(queued_bits + sampled_bits, bits(6) + bits(7) + bits(8), "{strategy}: {line}");
            queued_bits = bits(8);
        }
    }
}

#[test]
fn invalid_options_are_refused_before_anything_is_written() {
    let place = Place::new();
    place.scenario("smoke");
    place.assert_transcript(&expect_file!["transcripts/run-options.txt"]);
}

#[test]
fn a_command_ends_quietly_if_its_reader_closes_the_pipe() {
    let place = Place::new();
    place.scenario("short");
    let commands = [&["check", "short.toml"][..], &["simulate", SMOKE, "--out", "run"], &["--help"]];
    for arguments in commands {
        let mut child = place.skysink(arguments).spawn().unwrap();
        drop(child.stdout.take());
        let ended = wait(child);
        assert_eq!((ended.code, ended.stderr.as_str()), (Some(0), ""), "{arguments:?}: {ended:?}");
    }
    assert_eq!(place.summary("run")["complete"], true);
}

#[test]
fn help_lists_the_strategies_of_the_registry() {
    let place = Place::new();
    let help = place.run_ok(&["simulate", "--help"]).stdout;
    for strategy in skysink_planner::strategies::STRATEGIES {
        assert!(help.contains(&format!("- {}:", strategy.name)), "{}: {help}", strategy.name);
    }
}

#[test]
fn completions_and_man_pages_name_every_command() {
    let place = Place::new();
    let help = place.run_ok(&["--help"]).stdout;
    let listed = help.lines().skip_while(|line| *line != "Commands:").skip(1).take_while(|line| !line.is_empty());
    let commands: Vec<&str> = listed.filter_map(|line| line.strip_prefix("  ")?.split(' ').next()).collect();
    assert!(commands.contains(&"simulate") && commands.len() >= 6, "{commands:?}");
    for shell in ["bash", "zsh", "fish"] {
        let completions = place.run_ok(&["completions", shell]).stdout;
        for command in &commands {
            assert!(completions.contains(command), "{shell}: {command}");
        }
        assert!(completions.contains("drift-plus-penalty"), "{shell}: strategies");
    }
    place.run_ok(&["man", "pages"]);
    for command in commands.iter().filter(|command| **command != "help" && !command.is_empty()) {
        let page = place.read(&format!("pages/skysink-{command}.1"));
        assert!(page.contains(".SH OPTIONS"), "{command}");
    }
}

#[test]
fn help_shows_examples_and_no_colour_when_piped() {
    let place = Place::new();
    for arguments in [&["--help"][..], &["run", "--help"], &["simulate", "--help"]] {
        let help = place.run_ok(arguments).stdout;
        assert!(help.contains("Examples:"), "{help}");
        assert!(!help.contains('\u{1b}'), "{help:?}");
    }
    let run = place.flight("smoke").without_viewer().run();
    assert!(!run.stderr.contains('\u{1b}') && !run.stdout.contains('\u{1b}'), "{run:?}");
}

#[cfg(feature = "viewer")]
#[test]
fn equal_simulations_leave_equal_recordings() {
    let place = Place::new();
    for folder in ["one", "two"] {
        place.flight("smoke").options(&["--record"]).out(folder).simulate();
    }
    let sizes = ["one", "two"].map(|folder| std::fs::metadata(place.path(folder).join("mission.rrd")).unwrap().len());
    assert!(sizes[0] > 10_000, "{sizes:?}");
}

#[test]
fn reports_a_full_stdout_but_not_a_closed_pipe() {
    let place = Place::new();
    for arguments in
        [&["check", SMOKE][..], &["--help"], &["run", "--help"], &["simulate", SMOKE, "--out", "run", "--force"]]
    {
        let full = std::fs::File::options().write(true).open("/dev/full").unwrap();
        let ended = output(place.skysink(arguments).stdout(full));
        assert_eq!(ended.code, Some(1), "{arguments:?}: {ended:?}");
        ended.assert_one_line(&["standard output", "No space left"]);
        let (reader, writer) = std::io::pipe().unwrap();
        drop(reader);
        let ended = output(place.skysink(arguments).stdout(writer));
        assert_eq!((ended.code, &ended.stderr[..]), (Some(0), ""), "{arguments:?}");
        let full = std::fs::File::options().write(true).open("/dev/full").unwrap();
        let ended = output(place.skysink(&[arguments, &["no-such-file"]].concat()).stderr(full));
        assert!(ended.code == Some(2) || ended.code == Some(0), "{arguments:?}: {ended:?}");
    }
}

#[test]
fn a_second_signal_ends_a_command_at_once() {
    let place = Place::new();
    place.write("slow.toml", "name = \"slow\"\n[planner]\nstrategy = \"horizon\"\nhorizon.iterations = 1000000000\n[area]\nside_m = 1000.0\n");
    let child = place.skysink(&["simulate", "slow.toml", "--out", "run"]).spawn().unwrap();
    until("folder", || place.path("run/run.toml").exists().then_some(()));
    for _ in 0..2 {
        std::thread::sleep(std::time::Duration::from_millis(300)); // two signals, not one
        let _ = kill_process(pid(&child), Signal::INT);
    }
    wait(child).assert_code(130);
}

#[test]
fn low_resource_limits_are_reported_and_quotes_in_paths_accepted() {
    let place = Place::new();
    let limited = format!("ulimit -n 64; exec {} run {SMOKE} --no-viewer --out run", env!("CARGO_BIN_EXE_skysink"));
    let ended = output(place.command("sh", &["-c", &limited]));
    ended.assert_code(1).assert_one_line(&["open files: at most 64: expected 256: raise ulimit -n"]);
    assert!(!place.path("run").exists());
    for name in ["a'b", "a\"b", "a\\b"] {
        let folder = place.path(name);
        std::fs::create_dir(&folder).unwrap();
        let mut launcher = place.flight("smoke").without_viewer().force().launcher();
        output(launcher.env("TMPDIR", &folder)).assert_success();
    }
}

#[test]
fn an_interrupted_simulation_names_the_command_that_continues_it() {
    let place = Place::new();
    let long = place.scenario("long");
    let child = place.skysink(&["simulate", &long, "--set", "slots=2000000", "--out", "run"]).spawn().unwrap();
    until("flight", || (lines(&place.path("run/slots.csv")) > 100).then_some(()));
    for _ in 0..2 {
        let _ = kill_process(pid(&child), Signal::INT); // two at once, as `timeout` sends them
    }
    let ended = wait(child);
    ended.assert_code(130).assert_one_line(&[
        "stopped by signal 2",
        "recorded up to slot",
        "`skysink run --resume run` continues it",
    ]);
}
