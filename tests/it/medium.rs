//! Disks and memory that are full, read-only or too small: clear errors, and nothing half-written that looks whole.
//!
//! They need a mount namespace of their own.

use crate::Missing;
use crate::support::{Output, Place, wait};

/// The command that allows namespaces to all users where AppArmor forbids them.
const ALLOW: &str = "sudo sysctl -w kernel.apparmor_restrict_unprivileged_userns=0";

/// Runs a shell script with the place's `medium` as a file system of these options.
fn on_medium(place: &Place, options: &str, script: &str) -> Result<Output, Missing> {
    std::fs::create_dir_all(place.path("medium")).unwrap();
    let mount = format!("mount -t tmpfs -o {options} none medium || exit 77\n{script}");
    let unshare = place.command("unshare", &["-rm", "sh", "-c", &mount]).spawn();
    let ended = wait(unshare.map_err(|error| Missing(format!("needs unshare: {error}: apt install util-linux")))?);
    if ended.code == Some(77) || ended.stderr.contains("unshare failed") {
        return Err(Missing(format!("needs mount namespaces: {}: {ALLOW}", ended.stderr.trim())));
    }
    Ok(ended)
}

/// Fails unless the run has ended with exit code 1 and one last line with the error and its file.
fn assert_said(ended: &Output, what: &[&str]) {
    assert_eq!(ended.code, Some(1), "{ended:?}");
    let line = ended.stderr.lines().rev().find(|line| line.starts_with("skysink: ")).unwrap_or_default();
    assert!(what.iter().all(|word| line.contains(word)), "expected {what:?}: {ended:?}");
}

const SKYSINK: &str = env!("CARGO_BIN_EXE_skysink");

#[test]
fn a_full_disk_ends_a_run_with_whole_lines() -> Result<(), Missing> {
    let place = Place::new();
    place.scenario("long");
    for command in ["run long.toml --no-viewer --set slots=200000", "simulate long.toml --set slots=200000"] {
        let script = format!("{SKYSINK} {command} --out medium/run; code=$?; cp medium/run/* .; exit $code");
        let ended = on_medium(&place, "size=200k", &script)?;
        assert_said(&ended, &["slots.csv", "No space left"]);
        let trace = place.read("slots.csv");
        assert!(trace.ends_with('\n') && trace.lines().count() > 100, "{command}: {} bytes", trace.len());
        assert!(trace.lines().all(|line| line.split(',').count() == 11), "{command}");
        let summary = std::fs::read_to_string(place.path("summary.json")).unwrap_or_default();
        assert!(summary.is_empty() || summary.contains("\"complete\": false"), "{command}: {summary}");
        place.assert_clean();
    }
    Ok(())
}

#[test]
fn a_full_disk_ends_a_run_with_a_viewer() -> Result<(), Missing> {
    if !cfg!(feature = "viewer") {
        return Err(Missing("needs the feature viewer: cargo test --workspace".to_owned()));
    }
    let place = Place::new();
    place.scenario("long");
    for command in ["run long.toml --set slots=200000", "simulate long.toml --record --set slots=200000"] {
        for size in ["200k", "600k"] {
            let script = format!("{SKYSINK} {command} --out medium/run");
            let ended = on_medium(&place, &format!("size={size}"), &script)?;
            assert_eq!(ended.code, Some(1), "{command}, {size}: {ended:?}");
            assert!(ended.stderr.contains("No space left") || ended.stderr.contains("viewer"), "{ended:?}");
            assert!(!ended.stderr.contains('\u{1b}'), "{command}, {size}: {ended:?}");
            place.assert_clean();
        }
    }
    Ok(())
}

#[test]
fn a_folder_that_cannot_be_written_is_named() -> Result<(), Missing> {
    let place = Place::new();
    place.scenario("smoke");
    for command in ["run smoke.toml --no-viewer", "simulate smoke.toml", "new field"] {
        let script = format!("{SKYSINK} {command} --out medium/run");
        let ended = on_medium(&place, "ro", &script)?;
        assert_said(&ended, &["medium/run", "Read-only file system"]);
        assert!(ended.stdout.is_empty(), "{ended:?}");
    }
    let script = format!("TMPDIR=$PWD/medium {SKYSINK} run smoke.toml --no-viewer --out run");
    let ended = on_medium(&place, "ro", &script)?;
    assert!(matches!(ended.code, Some(1 | 2)), "{ended:?}");
    assert!(ended.stderr.contains("/medium: ") && ended.stderr.contains("Read-only file system"), "{ended:?}");
    place.assert_clean();
    Ok(())
}

#[test]
fn a_ring_folder_of_another_user_is_refused() -> Result<(), Missing> {
    let place = Place::new();
    place.scenario("smoke");
    std::fs::create_dir_all(place.rings_folder()).unwrap();
    if std::os::unix::fs::chown(place.rings_folder(), Some(1), None).is_err() {
        return Err(Missing("needs root, who may give a folder away: sudo -E cargo test --workspace".to_owned()));
    }
    let ended = place.run(&["run", "smoke.toml", "--no-viewer", "--out", "run"]);
    assert_ne!(ended.code, Some(0), "{ended:?}");
    assert!(ended.stderr.contains("belongs to user 1: remove it"), "{ended:?}");
    Ok(())
}

#[test]
fn too_little_shared_memory_is_refused_before_anything_is_written() -> Result<(), Missing> {
    let place = Place::new();
    place.scenario("smoke");
    let script = format!("mount -t tmpfs -o size=4m none /dev/shm && {SKYSINK} run smoke.toml --no-viewer --out run");
    let ended = on_medium(&place, "size=1m", &script)?;
    assert_said(&ended, &["/dev/shm", "MiB free", "--shm-size"]);
    assert!(!ended.stderr.contains("--no-viewer"), "{ended:?}");
    assert!(!place.path("run").exists());
    place.assert_clean();
    Ok(())
}

#[test]
fn a_file_at_its_size_limit_ends_a_run_with_one_line() -> Result<(), Missing> {
    let place = Place::new();
    place.scenario("long");
    let script = format!("ulimit -f 60; exec {SKYSINK} simulate long.toml --set slots=200000 --out run");
    let ended = wait(place.command("sh", &["-c", &script]).spawn().unwrap());
    assert_said(&ended, &["run/slots.csv: File too large"]);
    assert_eq!(ended.stderr.lines().count(), 1, "{ended:?}");
    assert!(place.trace("run").ends_with('\n') && place.trace("run").lines().count() > 100);
    let script = format!("ulimit -f 200; exec {SKYSINK} run long.toml --no-viewer --out ring");
    let ended = wait(place.command("sh", &["-c", &script]).spawn().unwrap()).assert_code(1);
    ended.assert_one_line(&["skysink: size of a file in shared memory: at most ", "raise ulimit -f"]);
    place.assert_clean();
    Ok(())
}
