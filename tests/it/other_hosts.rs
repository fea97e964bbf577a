//! Missions in a ring across three hosts, which are network namespaces.

use std::env;
use std::path::Path;
use std::process::{Command, Stdio};

use crate::Missing;
use crate::support::{Output, Place, output};

const SCRIPT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/examples/hosts/three_hosts.sh");
const LONG: &str = "name = 'long'\nslots = 400\nuav.endurance_s = 1e6\n";

/// What this machine lacks to have the hosts, with the command that brings it, if anything.
fn missing() -> Option<&'static str> {
    let works = |program: &str, arguments: &[&str]| {
        Command::new(program)
            .args(arguments)
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .status()
            .is_ok_and(|status| status.success())
    };
    let name = format!("skytest{}", std::process::id());
    if !rustix::process::getuid().is_root() {
        return Some("needs root: sudo -E cargo test --workspace --test it other_hosts");
    }
    if !["skysink-link", "iox2-link-tunnel-zenoh"].iter().any(|link| works(link, &["--help"])) {
        return Some("needs skysink-link in the PATH: cargo install --locked --path link");
    }
    if !works("ip", &["netns", "add", &name]) {
        return Some("needs network namespaces, by `ip netns add`: apt install iproute2");
    }
    works("ip", &["netns", "del", &name]);
    None
}

/// Flies `scenario` over three hosts with these arguments.
fn fly(scenario: &str, arguments: &[&str]) -> Result<Output, Missing> {
    if let Some(missing) = missing() {
        return Err(Missing(missing.to_owned()));
    }
    let place = Place::new();
    let file = place.write("long.toml", scenario);
    let executables = Path::new(env!("CARGO_BIN_EXE_skysink")).parent().unwrap();
    let arguments = [&[file.to_str().unwrap()], arguments].concat();
    let folders = env::var_os("PATH").unwrap_or_default();
    let folders = [executables.to_owned()].into_iter().chain(env::split_paths(&folders));
    Ok(output(place.command(SCRIPT, &arguments).env("PATH", env::join_paths(folders).unwrap())))
}

#[test]
fn a_disconnected_host_is_reported_and_does_not_change_the_trace() -> Result<(), Missing> {
    for host in ["a", "b", "c"] {
        let ended = fly(LONG, &["--cut", host, "4"])?;
        assert_eq!(ended.code, Some(0), "host {host}: {ended:?}");
        assert!(ended.stdout.contains("the trace is that of one process"), "host {host}: {ended:?}");
        let said = |text: &str| ended.stderr.lines().chain(ended.stdout.lines()).any(|line| line.contains(text));
        let cut = if host == "c" { "flight-sim" } else { "planner" };
        assert!(said(&format!("{cut} has sent no heartbeat for 1.0 s")), "host {host}: {ended:?}");
        assert!(said(&format!("{cut} recovered after ")), "host {host}: {ended:?}");
        assert!(ended.stdout.contains("messages refused"), "{ended:?}");
    }
    Ok(())
}

#[test]
fn a_paced_run_continues_without_the_planners_host_and_counts_missed_slots() -> Result<(), Missing> {
    let ended = fly(LONG, &["--cut", "b", "3", "--pace", "20x"])?;
    assert_eq!(ended.code, Some(3), "a trace with misses is another one: {ended:?}");
    let missed = ended.stdout.lines().find(|line| line.contains("deadlines missed")).unwrap();
    let missed: u64 = missed.split_whitespace().find_map(|word| word.parse().ok()).unwrap();
    assert!(missed >= 40, "{missed} slots of 0.05 s in 3 s: {ended:?}");
    Ok(())
}
