//! External planners and vehicles in the ring: the examples in Rust and C++ fly as `gfs` does, or at their own speed,
//! also when they are killed.
//!
//! The program is the examples in Rust as well, by links of the names [`PLANNER`] and [`VEHICLE`].

mod header;
mod layouts;

#[path = "../../../examples/ring_planner.rs"]
mod ring_planner;
#[path = "../../../examples/ring_vehicle.rs"]
mod ring_vehicle;

use std::env;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitCode};

use crate::Missing;
use crate::support::flight::RunningFlight;
use crate::support::{Place, signal_and_wait, wait};
use rustix::process::Signal;

const ROOT: &str = env!("CARGO_MANIFEST_DIR");

/// The names by which the program is an example.
const PLANNER: &str = "ring_planner";
const VEHICLE: &str = "ring_vehicle";

/// A scenario long enough to kill a planner in, which begins in transit: from the start no SN is within reach.
const TRANSIT: &str = "\
name = 'transit'
slots = 3000
area.side_m = 900.0
sensors.count = 60
uav = { start_m = [0.0, 0.0], endurance_s = 1e6 }
";

/// The example that the program is, by its name.
pub fn example() -> Option<fn() -> ExitCode> {
    let name = env::args_os().next()?;
    let is = |example: &str| Path::new(&name).ends_with(example);
    [(PLANNER, ring_planner::main as fn() -> ExitCode), (VEHICLE, ring_vehicle::main)]
        .into_iter()
        .find_map(|(example, main)| is(example).then_some(main))
}

/// The program by the name of an example.
fn named(place: &Place, example: &str) -> PathBuf {
    let path = place.path(example);
    std::os::unix::fs::symlink(env::current_exe().unwrap(), &path).unwrap();
    path
}

#[test]
#[ignore = "writes the header and the page anew"]
fn write_the_layouts_of_messages() {
    header::refresh();
    layouts::refresh(&header::generated());
}

#[test]
fn the_cpp_header_is_up_to_date() {
    header::is_what_the_types_generate();
}

#[test]
fn the_documented_layouts_match_the_types() {
    layouts::are_those_of(&header::generated());
}

#[test]
fn a_rust_strategy_flies_the_same_as_a_planner_command() {
    let place = Place::new();
    assert_flies_smoke_as_gfs(&named(&place, PLANNER));
}

#[test]
fn a_killed_rust_strategy_flies_the_same() {
    let place = Place::new();
    assert_survives_being_killed(&named(&place, PLANNER));
}

/// `resume` and the commands that fly the mission again read its run.
#[test]
fn a_rust_vehicle_flies_at_its_own_speed() {
    let place = Place::new();
    let vehicle = named(&place, VEHICLE);
    let vehicle = vehicle.to_str().unwrap();
    place.flight("smoke").without_viewer().vehicle(vehicle).run();
    assert_flies_12_m(&place);
    place.run_ok(&["replay", "run", "--no-viewer"]);
    place.run_ok(&["report", "run", "--sensors"]);
    let two = place.flight("smoke").without_viewer().set("uav.count", "2").vehicle(vehicle).force();
    let ended = two.try_run().assert_code(1);
    assert!(ended.stderr.contains("uav.count = 2: expected 1, the number of vehicles of the program"), "{ended:?}");
    place.assert_clean();
}

/// Fails unless the run has slots that end en route, and none farther than 12 m from where it began.
fn assert_flies_12_m(place: &Place) {
    let trace = place.trace("run");
    let rows: Vec<Vec<&str>> = trace.lines().skip(1).map(|line| line.split(',').collect()).collect();
    let positions: Vec<[f64; 2]> =
        rows.iter().map(|row| [2, 3].map(|column: usize| row[column].parse().unwrap())).collect();
    let legs_m = positions.windows(2).map(|pair| (pair[1][0] - pair[0][0]).hypot(pair[1][1] - pair[0][1]));
    let longest_m = legs_m.fold(0.0, f64::max);
    assert!((11.9..=12.0 + 1e-9).contains(&longest_m), "{longest_m} m");
    assert!(rows.iter().filter(|row| row[9] == "en-route").count() > 5, "{trace}");
}

/// Its links carry other bits than the scenario's channel, so `replay` refuses its run.
#[test]
fn a_cpp_vehicle_flies_the_same_even_after_kills() -> Result<(), Missing> {
    let place = Place::new();
    let vehicle = compiled(&place, "ring_vehicle")?;
    place.flight("smoke").without_viewer().vehicle(vehicle.to_str().unwrap()).run();
    assert_flies_12_m(&place);
    place.run_ok(&["report", "run"]);
    place.run_refused(&["replay", "run", "--no-viewer"], "external");

    place.write("transit.toml", TRANSIT);
    let flight = place.flight("transit").without_viewer();
    flight.vehicle(vehicle.to_str().unwrap()).out("alone").run();
    let run = flight.external("flight-sim").out("killed").start();
    run.until_printed("waiting up to 600 s for flight-sim");
    let first = start_program(&place, &run, &vehicle);
    for (slot, role) in [(100, "planner"), (300, "field-sim")] {
        run.until_slot(slot);
        run.kill_and_await(role);
    }
    run.until_slot(600);
    assert_eq!(signal_and_wait(Signal::KILL, first).signal, Some(9));
    wait(start_program(&place, &run, &vehicle)).assert_success();
    run.wait_for_success();
    place.assert_same_trace("alone", "killed");
    place.assert_clean();
    Ok(())
}

#[test]
fn a_cpp_planner_flies_the_same_even_when_killed() -> Result<(), Missing> {
    let place = Place::new();
    let planner = compiled(&place, "ring_planner")?;
    assert_flies_smoke_as_gfs(&planner);
    assert_survives_being_killed(&planner);
    Ok(())
}

/// What the examples in C++ need, and the command that runs its test.
const NEEDS: &str = "needs CMake, a C++ compiler and iceoryx2-cxx 0.10: \
    CMAKE_PREFIX_PATH=DIR cargo test --workspace --test it ring_planners";

/// An example in C++, compiled; an error that says what is missing, if CMake, a compiler or iceoryx2's C++ bindings
/// are.
fn compiled(place: &Place, program: &str) -> Result<PathBuf, Missing> {
    let missing = |what: String| Missing(format!("{NEEDS}: {what}"));
    let build = place.path("build");
    let source = format!("{ROOT}/examples");
    let configured = Command::new("cmake").arg("-S").arg(source).arg("-B").arg(&build).output();
    match configured {
        Err(error) => Err(missing(format!("cmake: {error}"))),
        Ok(output) if !output.status.success() => {
            let said = String::from_utf8_lossy(&output.stderr).into_owned();
            Err(missing(
                said.lines().map(str::trim).filter(|line| !line.is_empty()).take(3).collect::<Vec<_>>().join(" "),
            ))
        }
        Ok(_) => {
            let built = Command::new("cmake").arg("--build").arg(&build).args(["--target", program]).output().unwrap();
            assert!(built.status.success(), "{}", String::from_utf8_lossy(&built.stdout));
            Ok(build.join(program))
        }
    }
}

/// Fails unless the planner, started and supervised by `skysink run`, leaves the trace of `gfs` in one process.
fn assert_flies_smoke_as_gfs(planner: &Path) {
    let place = Place::new();
    let smoke = place.flight("smoke");
    smoke.strategy("gfs").out("alone").simulate();
    let ended = smoke.without_viewer().planner(planner.to_str().unwrap()).options(&["--label", "mine"]).run();
    assert!(ended.stdout.contains(" · mine · "), "{ended:?}");
    place.assert_same_trace("alone", "run");
    let summary = place.summary("run");
    assert_eq!((&summary["restarts"], &summary["refused_messages"]), (&0.into(), &0.into()), "{summary}");
    place.assert_clean();
}

/// Fails unless the planner, started by hand, killed and restarted, leaves the same trace.
fn assert_survives_being_killed(planner: &Path) {
    let place = Place::new();
    place.write("transit.toml", TRANSIT);
    let flight = place.flight("transit");
    flight.strategy("gfs").out("alone").simulate();
    for mode in ["serve", "transit"] {
        assert!(place.trace("alone").contains(mode), "the scenario shows no {mode}");
    }
    let run = flight.without_viewer().external("planner").start();
    run.until_printed("waiting up to 600 s for planner");
    for killed_after in [100, 1000] {
        let planner = start_program(&place, &run, planner);
        run.until_slot(killed_after);
        assert_eq!(signal_and_wait(Signal::KILL, planner).signal, Some(9));
    }
    wait(start_program(&place, &run, planner)).assert_success();
    run.wait_for_success();
    place.assert_same_trace("alone", "run");
    place.assert_clean();
}

/// An example, started for a ring.
fn start_program(place: &Place, run: &RunningFlight, program: &Path) -> Child {
    let mut command = place.command(program.to_str().unwrap(), &[]);
    command.env("SKYSINK_RING", run.folder()).env("SKYSINK_SCENARIO", run.path("scenario.toml")).spawn().unwrap()
}
