//! Disks and memory that are full, read-only or too small: clear errors, and nothing half-written that looks whole.
//!
//! They need a mount namespace of their own; where the system refuses one, the tests say so in one line and pass.

use crate::support::{Output, Place, wait};

/// Runs a shell script with the place's `medium` as a file system of these options; none where that is not allowed.
fn on_medium(place: &Place, options: &str, script: &str) -> Option<Output> {
    std::fs::create_dir_all(place.path("medium")).unwrap();
    let mount = format!("mount -t tmpfs -o {options} none medium || exit 77\n{script}");
    let ended = wait(place.command("unshare", &["-rm", "sh", "-c", &mount]).spawn().ok()?);
    if ended.code == Some(77) || ended.stderr.contains("unshare failed") {
        eprintln!("skipped: this system refuses a mount namespace: {}", ended.stderr.trim());
        return None;
    }
    Some(ended)
}

/// Fails unless the run has ended with exit code 1 and one last line with the error and its file.
fn assert_said(ended: &Output, what: &[&str]) {
    assert_eq!(ended.code, Some(1), "{ended:?}");
    let line = ended.stderr.lines().rev().find(|line| line.starts_with("skysink: ")).unwrap_or_default();
    assert!(what.iter().all(|word| line.contains(word)), "expected {what:?}: {ended:?}");
}

const SKYSINK: &str = env!("CARGO_BIN_EXE_skysink");

#[test]
fn a_full_disk_ends_a_run_with_whole_lines() {
    let place = Place::new();
    place.scenario("long");
    for command in ["run long.toml --no-viewer --set slots=200000", "simulate long.toml --set slots=200000"] {
        let script = format!("{SKYSINK} {command} --out medium/run; code=$?; cp medium/run/* .; exit $code");
        let Some(ended) = on_medium(&place, "size=200k", &script) else { return };
        assert_said(&ended, &["slots.csv", "No space left"]);
        let trace = place.read("slots.csv");
        assert!(trace.ends_with('\n') && trace.lines().count() > 100, "{command}: {} bytes", trace.len());
        assert!(trace.lines().all(|line| line.split(',').count() == 11), "{command}");
        let summary = std::fs::read_to_string(place.path("summary.json")).unwrap_or_default();
        assert!(summary.is_empty() || summary.contains("\"complete\": false"), "{command}: {summary}");
        place.assert_clean();
    }
}

#[cfg(feature = "viewer")]
#[test]
fn a_full_disk_ends_a_run_with_a_viewer_too() {
    let place = Place::new();
    place.scenario("long");
    for command in ["run long.toml --set slots=200000", "simulate long.toml --record --set slots=200000"] {
        for size in ["200k", "600k"] {
            let script = format!("{SKYSINK} {command} --out medium/run");
            let Some(ended) = on_medium(&place, &format!("size={size}"), &script) else { return };
            assert_eq!(ended.code, Some(1), "{command}, {size}: {ended:?}");
            assert!(ended.stderr.contains("No space left") || ended.stderr.contains("viewer"), "{ended:?}");
            assert!(!ended.stderr.contains('\u{1b}'), "{command}, {size}: {ended:?}");
            place.assert_clean();
        }
    }
}

#[test]
fn a_folder_that_cannot_be_written_is_named() {
    let place = Place::new();
    place.scenario("smoke");
    for command in ["run smoke.toml --no-viewer", "simulate smoke.toml", "new field"] {
        let script = format!("{SKYSINK} {command} --out medium/run");
        let Some(ended) = on_medium(&place, "ro", &script) else { return };
        assert_said(&ended, &["medium/run", "Read-only file system"]);
        assert!(ended.stdout.is_empty(), "{ended:?}");
    }
    let script = format!("TMPDIR=$PWD/medium {SKYSINK} run smoke.toml --no-viewer --out run");
    let Some(ended) = on_medium(&place, "ro", &script) else { return };
    assert!(matches!(ended.code, Some(1 | 2)), "{ended:?}");
    assert!(ended.stderr.contains("/medium: ") && ended.stderr.contains("Read-only file system"), "{ended:?}");
    place.assert_clean();
}

#[test]
fn a_folder_for_rings_that_belongs_to_another_user_is_refused() {
    let place = Place::new();
    place.scenario("smoke");
    std::fs::create_dir_all(place.rings_folder()).unwrap();
    if std::os::unix::fs::chown(place.rings_folder(), Some(1), None).is_err() {
        eprintln!("skipped: only root may give a folder away");
        return;
    }
    let ended = place.run(&["run", "smoke.toml", "--no-viewer", "--out", "run"]);
    assert_ne!(ended.code, Some(0), "{ended:?}");
    assert!(ended.stderr.contains("belongs to user 1: remove it"), "{ended:?}");
}

#[test]
fn a_shared_memory_that_is_too_small_is_refused_before_anything_is_written() {
    let place = Place::new();
    place.scenario("smoke");
    let script = format!("mount -t tmpfs -o size=4m none /dev/shm && {SKYSINK} run smoke.toml --no-viewer --out run");
    let Some(ended) = on_medium(&place, "size=1m", &script) else { return };
    assert_said(&ended, &["/dev/shm", "MiB free", "--shm-size"]);
    assert!(!ended.stderr.contains("--no-viewer"), "{ended:?}");
    assert!(!place.path("run").exists());
    place.assert_clean();
}
