//! Files for the targets that need some: a folder and a ring of each thread.

use std::fs::{self, OpenOptions};
use std::io::ErrorKind;
use std::os::unix::fs::FileExt;
use std::path::Path;

use skysink_common::pace::Pace;
use skysink_ring::folder::RingFolder;
use skysink_ring::wait::Waiting;

use crate::cursor::Cursor;

thread_local! {
    static FOLDER: tempfile::TempDir = tempfile::tempdir().expect("a temporary folder can be made");
    static RING: RingFolder = RingFolder::create(Pace::Max, Waiting::Event, 1.0, false, None).expect("a ring's folder can be made");
}

/// Does something in a folder of this thread. What an input before has left there is there.
pub(super) fn in_folder(work: impl FnOnce(&Path)) {
    FOLDER.with(|folder| work(folder.path()));
}

/// Does something in a ring's folder of this thread, in which there are no journals of these names.
pub(super) fn in_ring(journals: &[&str], work: impl FnOnce(&RingFolder)) {
    RING.with(|ring| {
        for name in journals {
            remove(&ring.journal(name));
        }
        work(ring);
    });
}

/// Writes a new file. One that is there is removed, not cut: some file systems wait for the disk then.
pub(super) fn write(path: &Path, bytes: &[u8]) {
    remove(path);
    fs::write(path, bytes).expect("a file can be written");
}

fn remove(path: &Path) {
    match fs::remove_file(path) {
        Err(error) if error.kind() != ErrorKind::NotFound => panic!("{}: {error}", path.display()),
        _ => {}
    }
}

/// What a crash or a disk may do to a file: the input says where bytes change, and where it ends. Says whether it did
/// anything.
pub(super) fn spoil(path: &Path, input: &mut Cursor) -> bool {
    let file = OpenOptions::new().write(true).open(path).expect("the file is there");
    let length = file.metadata().expect("the file is there").len();
    let done = !input.is_empty();
    while !input.is_empty() {
        let (kind, place) = (input.u8(), u64::from(input.u32()) % (length + 64));
        let spoilt = match kind {
            0 => file.set_len(place),
            _ => file.write_all_at(input.bytes(usize::from(kind % 32)), place),
        };
        spoilt.expect("the file can be changed");
    }
    done
}
