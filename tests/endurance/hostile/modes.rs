//! Access permissions of the files of a running ring.

use std::fs;
use std::os::unix::fs::{FileTypeExt, PermissionsExt};
use std::path::{Path, PathBuf};

use super::rogue::{LONG_S, Rogue};
use crate::support::Place;
use crate::support::flight::RunningFlight;

/// The permissions of others than the owner.
const OTHERS: u32 = 0o077;

fn mode(path: &Path) -> Option<u32> {
    fs::symlink_metadata(path).ok().map(|file| file.permissions().mode() & 0o7777)
}

/// Everything below a folder.
fn below(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for path in fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path()) {
        if path.is_dir() {
            found.extend(below(&path));
        }
        found.push(path);
    }
    found
}

/// Fails if anybody but its owner can open something of the ring.
fn assert_private(rogue: &Rogue) {
    let folder = rogue.folder.path();
    for path in [folder, folder.parent().unwrap()] {
        assert_eq!(mode(path), Some(0o700), "{}", path.display());
    }
    assert_eq!(mode(&folder.with_extension("lock")), Some(0o600));
    let inside = below(folder);
    // In a folder that is closed, these would not need to be.
    let private = |path: &&PathBuf| {
        let kind = path.extension().unwrap_or_default().to_string_lossy().into_owned();
        ["seat", "journal", "event", "service", "details", "toml"].contains(&kind.as_str())
    };
    for path in inside.iter().filter(private) {
        assert_eq!(mode(path).unwrap() & OTHERS, 0, "{}", path.display());
    }
    let sockets =
        inside.iter().filter(|path| fs::symlink_metadata(path).is_ok_and(|file| file.file_type().is_socket()));
    let named = |name: &str| inside.iter().any(|path| path.ends_with(name));
    assert!(sockets.count() > 0 && named("planner.seat") && named("flights.journal"), "{inside:?}");

    let ours = |path: &PathBuf| path.file_name().unwrap().to_string_lossy().starts_with(&rogue.folder.prefix());
    let shared: Vec<_> = below(Path::new("/dev/shm")).into_iter().filter(ours).collect();
    assert!(shared.len() > 20, "{shared:?}");
    for path in &shared {
        assert_eq!(mode(path).unwrap_or(0) & OTHERS, 0, "{}", path.display());
    }
}

#[test]
fn the_files_of_a_running_ring_are_private_to_its_owner_with_any_umask() {
    for umask in ["022", "000"] {
        let place = Place::new();
        let flight = place.flight("smoke").without_viewer().external("planner").timeout(LONG_S);
        let mut command = place.command("sh", &["-c", &format!("umask {umask}; exec \"$0\" \"$@\"")]);
        command.arg(flight.launcher().get_program()).args(flight.launcher().get_args());
        let run = RunningFlight::start(&place, command, "run");
        let mut rogue = Rogue::join(&run);
        rogue.fly_to_end(|rogue, turn| {
            if turn.slot % 30 == 3 {
                assert_private(rogue);
            }
        });
        let ended = run.wait();
        assert_eq!(ended.code, Some(0), "{ended:?}");
        place.assert_clean();
    }
}
