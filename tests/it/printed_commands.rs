//! Commands that programs print to be copied: a shell reads from them the very paths that they mean, whatever their
//! names.

use std::os::unix::ffi::OsStrExt;
use std::path::Path;

use crate::support::{Place, output, path_with};
use rustix::process::Signal;

/// Names of folders as people give them, and as they do not.
const NAMES: [&str; 14] = [
    "s'w $x",
    "two words",
    "semi;colon & more",
    "glob*[a-c]?{x,y}",
    "#hash",
    "~home",
    "-dash",
    "(in brackets)",
    "back\\slash\\",
    "quo\"te\"d'",
    "`id`$(id)",
    "!history^",
    "Größe 30 µs",
    "two\nlines\x1b[31m",
];

/// The words that a shell makes of a command.
fn words(place: &Place, command: &str) -> Vec<String> {
    let shell = place.command("bash", &["-c", &format!("printf '%s\\0' {command}")]).output().unwrap();
    assert!(shell.status.success(), "{command}: {shell:?}");
    shell.stdout.split(|byte| *byte == 0).map(|word| String::from_utf8(word.to_vec()).unwrap()).collect()
}

/// The command behind `label` on a line of its own.
fn printed<'a>(text: &'a str, label: &str) -> &'a str {
    let line = text.lines().find_map(|line| line.trim_start().strip_prefix(label));
    line.unwrap_or_else(|| panic!("{label:?} is missing in {text}")).trim()
}

/// The command between the first and the last `` ` `` of a message, from `begin` on.
fn quoted<'a>(text: &'a str, begin: &str) -> &'a str {
    let at = text.find(begin).unwrap_or_else(|| panic!("{begin:?} is missing in {text}"));
    &text[at..text.rfind('`').unwrap_or(text.len())]
}

/// How a path is given to a program: one that begins like an option follows `./`.
fn given(name: &str) -> String {
    if name.starts_with('-') { format!("./{name}") } else { name.to_owned() }
}

#[test]
fn a_copied_command_opens_the_run_whatever_its_folder_is_called() {
    let place = Place::new();
    for name in NAMES {
        let out = given(name);
        let mut flight = place.flight("smoke").out(&out);
        if cfg!(feature = "viewer") {
            flight = flight.options(&["--record"]);
        }
        let said = flight.simulate().stdout;
        if cfg!(feature = "viewer") {
            let viewed = words(&place, printed(&said, "Open recording:  "));
            assert_eq!(viewed[..2], ["skysink", "view"]);
            assert_eq!(Path::new(&viewed[2]), Path::new(&out), "{said}");
            let opened = words(&place, printed(&said, "or:  rerun "));
            assert!(place.path(&opened[0]).is_file(), "{opened:?}");
        }
        let again = place.run(&["simulate", "smoke.toml", "--out", &out]).assert_code(2).stderr;
        assert_eq!(again.lines().count(), 1, "{again}");
    }
}

#[test]
fn the_next_step_of_a_new_scenario_can_be_copied() {
    let place = Place::new();
    let programs = Path::new(env!("CARGO_BIN_EXE_skysink")).parent().unwrap();
    for name in NAMES {
        let said = place.run_ok(&["new", "city", "--out", &given(name)]).stdout;
        let next = printed(&said, "Next:  ");
        let path = path_with([programs]);
        let checked = output(place.command("bash", &["-c", next]).env("PATH", path)).assert_success();
        assert!(checked.stdout.contains("name = \"city\""), "{next}: {checked:?}");
    }
}

#[cfg(feature = "lab")]
#[test]
fn sweeps_and_comparisons_print_commands_that_can_be_copied() {
    let place = Place::new();
    let file = place.scenario("smoke");
    place.write("sweep.toml", &format!("scenario = '{file}'\nstrategies = ['gfs']\nseeds = 2\n"));
    for name in [NAMES[0], NAMES[3], NAMES[6], NAMES[13]] {
        let out = given(name) + "/sweep";
        let said = place.run_ok(&["sweep", "sweep.toml", "--out", &out]).stdout;
        let plot = words(&place, printed(&said, "Draw them: "));
        assert_eq!(plot[..2], ["skysink", "plot"]);
        assert!(place.path(&plot[2]).join("results.csv").is_file(), "{plot:?}");
        let edited = place.read(&format!("{out}/sweep.toml")) + "# another\n";
        place.write(&format!("{out}/sweep.toml"), &edited);
        let refused = place.run(&["sweep", &out]).assert_code(2).stderr;
        let swept = words(&place, refused.split_once("fly another one: ").expect("a remedy").1.trim());
        assert!(place.path(&swept[2]).is_file(), "{swept:?}");
        if cfg!(feature = "viewer") {
            let out = given(name) + "/comparison";
            let said = place.run_ok(&["compare", "smoke.toml", "gfs", "uts", "--seeds", "2", "--out", &out]).stdout;
            let viewed = words(&place, printed(&said, "Open recording:  "));
            assert!(place.path(&viewed[2]).is_file(), "{viewed:?}");
        }
    }
}

#[cfg(feature = "lab")]
#[test]
fn a_list_in_the_place_of_a_scenario_names_a_command_that_makes_one() {
    let place = Place::new();
    let programs = Path::new(env!("CARGO_BIN_EXE_skysink")).parent().unwrap();
    for (number, name) in NAMES.into_iter().enumerate() {
        let file = format!("{}.csv", given(name));
        place.write(&file, "x_m,y_m\n1,2\n30,40\n");
        let refused = place.run(&["check", &file]).assert_code(2).stderr;
        let command = format!("{} --out made-{number}", quoted(&refused, "skysink new "));
        let path = path_with([programs]);
        output(place.command("bash", &["-c", &command]).env("PATH", path)).assert_success();
        assert!(place.path(&format!("made-{number}")).is_dir(), "{command}");
    }
}

#[test]
fn the_command_that_resumes_a_run_can_be_copied() {
    let place = Place::new();
    let programs = Path::new(env!("CARGO_BIN_EXE_skysink")).parent().unwrap();
    for name in [NAMES[0], NAMES[13]] {
        let out = given(name);
        let planner = format!("env \"A=it's $HOME\" {}", place.external_planner());
        let run = place.flight("long").out(&out).planner(&planner).without_viewer().start();
        run.until_slot(50);
        run.signal_launcher(Signal::INT);
        let ended = run.wait().assert_code(130);
        let last = ended.stderr.lines().last().unwrap();
        let command = quoted(last, "skysink run --resume");
        let resumed = words(&place, command);
        assert_eq!(Path::new(&resumed[3]), Path::new(&out), "{command}");
        assert_eq!(resumed[4..6], ["--planner", &*resumed[5]], "{command}");
        assert_eq!(words(&place, &resumed[5])[..2], ["env", "A=it's $HOME"], "{command}");
        let unfinished = place.run(&["replay", &out, "--out", "replayed", "--no-viewer"]).assert_code(2).stderr;
        let told = unfinished.split_once("resumed by ").expect("a remedy").1.trim().trim_end_matches(')');
        assert_eq!(Path::new(&words(&place, told)[3]), Path::new(&out), "{told}");
        let path = path_with([programs]);
        let command = format!("{command} --no-viewer");
        output(place.command("bash", &["-c", &command]).env("PATH", path)).assert_success();
        assert_eq!(place.summary(&out)["complete"], true);
    }
    place.assert_clean();
}

#[cfg(feature = "viewer")]
#[test]
fn pages_and_folders_without_a_recording_name_commands_that_can_be_copied() {
    let place = Place::new();
    for name in [NAMES[0], NAMES[6], NAMES[13]] {
        let out = given(name);
        place.flight("smoke").out(&out).simulate();
        let refused = place.run(&["view", &out, "--port", "0"]).assert_code(2).stderr;
        let replay = words(&place, quoted(&refused, "skysink replay "));
        assert_eq!(Path::new(&replay[2]), Path::new(&out), "{refused}");
        let replayed = given(&format!("{name} again"));
        let said = place.run_ok(&["replay", &out, "--out", &replayed]).stdout;
        let viewed = words(&place, printed(&said, "Open recording:  "));
        assert_eq!(Path::new(&viewed[2]), Path::new(&replayed), "{said}");
        let page = given(&format!("{name} page"));
        let said = place.run_ok(&["page", &replayed, &page]).stdout;
        let served = words(&place, printed(&said, "Try it:  "));
        assert!(place.path(&served[4]).join("index.html").is_file(), "{served:?}");
    }
}

#[test]
fn a_path_that_is_not_utf_8_is_copied_as_its_bytes() {
    let place = Place::new();
    let name = std::ffi::OsStr::from_bytes(b"caf\xe9 'x");
    let said = output(place.skysink(&["new", "city", "--out"]).arg(name)).assert_success().stdout;
    let command = format!("printf '%s' {}", printed(&said, "Next:  skysink check "));
    let shell = place.command("bash", &["-c", &command]).output().unwrap();
    assert_eq!(shell.stdout, b"caf\xe9 'x/city.toml", "{command}");
}
