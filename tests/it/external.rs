//! External planners: started by hand or by a command, supervised, reported when missing, and listed in the results
//! under their own name.

use std::fs;
use std::os::unix::fs::PermissionsExt;

use crate::Missing;
use crate::support::flight::RunningFlight;
use crate::support::{Place, output, signal_and_wait, until, until_exited};
use rustix::process::{Pid, Signal, kill_process};

#[test]
fn a_planner_command_is_restarted_when_it_dies() {
    let place = Place::new();
    let run =
        place.flight("long").without_viewer().planner(&place.external_planner()).options(&["--label", "mine"]).start();
    run.until_slot(200);
    run.kill("planner");
    let ended = run.wait_for_success();
    assert!(ended.stdout.starts_with("long · mine · seed 1: 3000 slots"), "{ended:?}");
    place.assert_trace_as_simulated("run");
    let summary = place.summary("run");
    assert_eq!((&summary["strategy"], &summary["restarts"]), (&"mine".into(), &1.into()));
    place.assert_clean();
}

/// A command whose process is a shell that waits for the planner, beside another child that holds its output open.
fn forking_command(place: &Place) -> String {
    let path = place.write("fork.sh", &format!("#!/bin/sh\nsleep 1000 &\n{}\n:\n", place.external_planner()));
    fs::set_permissions(&path, fs::Permissions::from_mode(0o755)).unwrap();
    path.display().to_string()
}

#[test]
fn child_processes_of_a_planner_command_end_with_it() {
    let place = Place::new();
    let run = place.flight("long").without_viewer().planner(&forking_command(&place)).start();
    run.until_slot(100);
    let launcher = run.pid().as_raw_nonzero();
    let children = || fs::read_to_string(format!("/proc/{launcher}/task/{launcher}/children")).unwrap_or_default();
    let is_shell =
        |id: &str| fs::read_to_string(format!("/proc/{id}/cmdline")).is_ok_and(|line| line.contains("fork.sh"));
    let shell = until("shell", || children().split_ascii_whitespace().find(|id| is_shell(id)).map(str::to_owned));
    kill_process(Pid::from_raw(shell.parse().unwrap()).unwrap(), Signal::KILL).unwrap();
    run.wait_for_success();
    place.assert_trace_as_simulated("run");
    assert_eq!(place.summary("run")["restarts"], 1);
    place.assert_clean();
}

/// The children of a process that have ended and were not reaped.
fn defunct_children(parent: Pid) -> Vec<Pid> {
    let parent = parent.as_raw_nonzero();
    let children = fs::read_to_string(format!("/proc/{parent}/task/{parent}/children")).unwrap_or_default();
    let is_defunct = |id: &&str| {
        let status = fs::read_to_string(format!("/proc/{id}/stat")).unwrap_or_default();
        status.rsplit_once(") ").is_some_and(|(_, state)| state.starts_with('Z'))
    };
    children.split_ascii_whitespace().filter(is_defunct).map(|id| Pid::from_raw(id.parse().unwrap()).unwrap()).collect()
}

#[test]
fn a_launcher_that_is_process_1_reaps_what_its_planners_leave_behind() -> Result<(), Missing> {
    let place = Place::new();
    let planner = place.write(
        "leave.sh",
        &format!("#!/bin/sh\nsetsid sleep 0.2 &\nsetsid sh -c 'exit 3' &\nexec {}\n", place.external_planner()),
    );
    fs::set_permissions(&planner, fs::Permissions::from_mode(0o755)).unwrap();
    let flight = place.flight("long").without_viewer().planner(planner.to_str().unwrap());
    let namespace = ["-Ucpf", "--mount-proc", "--kill-child"];
    let tried = place.command("unshare", &namespace).arg("true").output();
    let tried = tried.map_err(|error| Missing(format!("needs unshare: {error}: apt install util-linux")))?;
    if !tried.status.success() {
        let said = String::from_utf8_lossy(&tried.stderr).trim().to_owned();
        return Err(Missing(format!(
            "needs namespaces of processes: {said}: sysctl kernel.unprivileged_userns_clone=1"
        )));
    }
    let launcher = flight.launcher();
    let mut command = place.command("unshare", &namespace);
    command.arg(launcher.get_program()).args(launcher.get_args());
    let run = RunningFlight::start(&place, command, "run");
    let outer = run.pid().as_raw_nonzero();
    let first = until("process 1", || {
        let children = fs::read_to_string(format!("/proc/{outer}/task/{outer}/children")).ok()?;
        Pid::from_raw(children.split_ascii_whitespace().next()?.parse().ok()?)
    });
    run.until_slot(100);
    for _ in 0..2 {
        run.kill_and_await("planner");
        run.until_slots_later(50);
    }
    until("an end without defunct children", || defunct_children(first).is_empty().then_some(()));
    run.wait_for_success();
    place.assert_trace_as_simulated("run");
    let summary = place.summary("run");
    assert_eq!(summary["restarts"], 2, "its own processes keep their exit statuses");
    Ok(())
}

#[test]
fn a_planner_command_with_child_processes_ends_with_the_run() {
    let place = Place::new();
    let run = place.flight("long").without_viewer().planner(&forking_command(&place)).start();
    run.until_slot(100);
    let planner = run.worker("planner");
    run.terminate();
    until_exited(planner);
    place.assert_clean();
}

#[test]
fn a_planner_command_that_keeps_exiting_ends_the_run() {
    let place = Place::new();
    let ended = place.flight("smoke").without_viewer().planner("false").try_run().assert_code(1);
    let last = ended.stderr.lines().last().unwrap();
    assert!(last.contains("planner ended with exit code 1, 8 times in a row in slot 1"), "{ended:?}");
    place.assert_clean();
}

#[test]
fn a_missing_planner_is_reported_at_once_and_may_rejoin() {
    let place = Place::new();
    let run = place.flight("long").without_viewer().external("planner").start();
    run.until_printed("waiting up to 600 s for planner: /");
    let planner = run.worker_command("planner").spawn().unwrap();
    run.until_slot(100);
    run.until_printed("planner joined");
    assert_eq!(signal_and_wait(Signal::KILL, planner).signal, Some(9));
    run.until_printed("planner is missing: the run waits for it to be started again");
    output(run.worker_command("planner")).assert_success();
    let ended = run.wait_for_success();
    place.assert_trace_as_simulated("run");
    let events = place.reproducible_summary("run")["events"].as_array().unwrap().len();
    assert_eq!(events, 3, "joined, missing, joined: {ended:?}");
    place.assert_clean();
}

#[test]
fn a_planner_that_exits_is_named_within_a_second_of_its_last_plan() {
    let place = Place::new();
    let run = place.flight("long").without_viewer().pace("10x").external("planner").start(); // 100 slots a second
    let planner = run.worker_command("planner").spawn().unwrap();
    run.until_printed("planner joined");
    run.until_slots_later(20);
    signal_and_wait(Signal::KILL, planner);
    run.until_printed("planner is missing");
    run.terminate();
    let trace = place.trace("run");
    let (last_plan, _) = (0..).zip(trace.lines()).filter(|(_, line)| !line.contains(",hold,")).last().unwrap();
    let events = place.reproducible_summary("run")["events"].take();
    let named = events[1]["slot"].as_u64().unwrap();
    assert!((last_plan..=last_plan + 100).contains(&named), "last plan for slot {last_plan}: {events}");
}

#[test]
fn a_timeout_names_only_the_process_that_blocks_the_others() {
    for (role, topic) in [("planner", "plan(1)"), ("flight-sim", "flight(0)"), ("field-sim", "queues(0)")] {
        let place = Place::new();
        let ended = place.flight("smoke").without_viewer().external(role).timeout("3").try_run().assert_code(1);
        // On a busy machine other processes may be late with their heartbeats.
        let lines: Vec<_> = ended.stderr.lines().filter(|line| !line.starts_with("slot 1: ")).collect();
        assert_eq!(lines.len(), 2, "{ended:?}");
        assert!(lines[0].starts_with(&format!("waiting up to 3 s for {role}: ")), "{ended:?}");
        assert!(lines[1].starts_with(&format!("skysink: {role} has not sent {topic} for 3 s")), "{ended:?}");
        assert_eq!(place.summary("run")["complete"], false);
        place.assert_clean();
    }
}

#[test]
fn the_run_of_an_external_planner_is_recorded_and_resumed_as_such() {
    let place = Place::new();
    let command = place.external_planner();
    let run = place.flight("long").without_viewer().planner(&command).start();
    run.until_slot(100);
    let ended = run.terminate();
    let hint = format!("`skysink run --resume run --planner {command}` continues it");
    assert!(ended.stderr.contains(&hint), "{ended:?}");
    assert_eq!(place.summary("run")["strategy"], "external");

    let refused = |arguments: &[&str], expected: &str| {
        place.run_refused(&[&["run", "--no-viewer", "--resume"], arguments].concat(), expected);
    };
    refused(&["run"], "flown by an external planner, external: expected --external planner, or --planner");
    refused(&["run", "--planner", &command, "--label", "other"], "its planner is named external");
    let ended = place.run_ok(&["run", "--no-viewer", "--resume", "run", "--planner", &command]);
    assert!(ended.stdout.starts_with("long · external · seed 1"), "{ended:?}");
    place.assert_trace_as_simulated("run");

    place.cut_trace("run-simulated", 0);
    refused(&["run-simulated", "--planner", &command], "flown by the scenario's strategy");
    place.assert_clean();
}
