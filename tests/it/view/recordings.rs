//! Recordings of other versions, cut ones, and what is none.

use std::fs;
use std::io::{BufReader, Cursor};

use re_log_encoding::DecoderApp;
use rustix::process::Signal;

use super::{View, recorded};
use crate::support::{Place, signal_and_wait};

#[test]
fn recordings_that_the_viewer_cannot_show_whole_are_said_by_view_and_page() {
    let place = Place::new();
    recorded(&place, "run");
    let whole = fs::read(place.path("run/mission.rrd")).unwrap();
    let of_version = |version: [u8; 3]| [&whole[..4], &version, &whole[7..]].concat();
    for (name, bytes) in [
        ("newer", of_version([0, 43, 2])),
        ("older", of_version([0, 30, 1])),
        ("ancient", of_version([0, 20, 0])),
        ("cut", whole[..whole.len() / 2].to_vec()),
        ("header", whole[..8].to_vec()),
        ("none", b"RRF2, and no more".to_vec()),
    ] {
        fs::write(place.path(&format!("{name}.rrd")), bytes).unwrap();
    }
    for (name, says) in [
        ("newer", "it is of rerun 0.43.2, newer than the viewer, rerun 0.36.3"),
        ("older", "it is of rerun 0.30.1, older than the viewer, rerun 0.36.3"),
        ("cut", "it has no end: its mission is under way, or it was cut; it is shown up to byte "),
    ] {
        let file = format!("{name}.rrd");
        let written = place.run_ok(&["page", &file, &format!("{name}-page")]);
        assert!(written.stderr.starts_with(&format!("skysink: warning: recording {file}: {says}")), "{written:?}");
        assert_eq!(written.stderr.lines().count(), 1, "{written:?}");
        let view = View::start(&place, &[&file]);
        let said = signal_and_wait(Signal::INT, view.child).stderr;
        assert_eq!(said, written.stderr + "skysink: stopped by signal 2\n");
    }
    for (name, says) in [
        ("ancient", "it is of rerun 0.20.0, and the viewer, rerun 0.36.3, reads recordings since 0.23.0"),
        ("header", "it ends within its header"),
        ("none", "it begins like a recording, and is none"),
    ] {
        let file = format!("{name}.rrd");
        for arguments in [&["view", "--port", "0", &file][..], &["page", &file, "page"]] {
            place.run_refused(arguments, says);
        }
    }
    assert!(!place.path("page").exists());
    // What the decoder of rerun reads of a cut file is what the line says.
    let messages = |bytes: &[u8]| {
        let decoder = DecoderApp::decode_lazy(BufReader::new(Cursor::new(bytes)));
        decoder.map_while(Result::ok).count()
    };
    let stderr = place.run_ok(&["page", "cut.rrd", "again"]).stderr;
    let at: usize = stderr.split("up to byte ").nth(1).unwrap().split(',').next().unwrap().parse().unwrap();
    let cut = &whole[..whole.len() / 2];
    assert!(messages(cut) > 2);
    assert_eq!(messages(&cut[..at]), messages(cut));
    assert!(messages(&cut[..at - 1]) < messages(cut));
}
