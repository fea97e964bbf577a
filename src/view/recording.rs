//! Whether a file is a recording that the viewer can show: its header, the version of rerun that has written it, and
//! whether it has an end.
//!
//! The format is that of rerun (`re_log_encoding`): `RRF2`, four bytes of the version, four of the encoding; then
//! messages, each behind its kind and its length, of which the last is the end.

use std::fmt;
use std::fs::{self, File};
use std::io::{self, BufReader, Read, Seek as _, SeekFrom};
use std::path::{Path, PathBuf};

use skysink_common::error::InputError;

use crate::error::RERUN;

/// The first bytes of a recording since rerun 0.2.1.
const MAGIC: [u8; 4] = *b"RRF2";

/// Those of recordings before.
const OLD_MAGICS: [[u8; 4]; 2] = [*b"RRF0", *b"RRF1"];

/// The oldest version that the viewer reads: the encoding was changed in it.
const OLDEST: RerunVersion = RerunVersion([0, 23, 0]);

/// Length of the header of a file [bytes].
const HEADER_BYTES: usize = 12;

/// Length of the kind and the length before each message [bytes].
const MESSAGE_HEADER_BYTES: usize = 16;

/// The kind of the message at the end, and the largest kind.
const END: u64 = 0;
const LAST_KIND: u64 = 3;

/// What the footer of a closed file ends with, before the number of its entries, as 32 bits.
const FOOTER: [u8; 8] = *b"RRF2FOOT";

/// What is expected of a file that is no recording.
const EXPECTED: &str = "expected a recording of rerun (.rrd), or a folder with one";

/// A recording that can be shown.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ShownRecording {
    pub path: PathBuf,
    /// Lines for people: why not all of it may be shown.
    pub notices: Vec<String>,
}

/// A version of rerun: major, minor, patch.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct RerunVersion([u8; 3]);

impl fmt::Display for RerunVersion {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self([major, minor, patch]) = self;
        write!(formatter, "{major}.{minor}.{patch}")
    }
}

impl RerunVersion {
    /// The version of the viewer.
    fn viewer() -> Self {
        let mut numbers = RERUN.split('.').map(|number| number.parse().expect("a version has numbers"));
        Self(std::array::from_fn(|_| numbers.next().expect("a version has three numbers")))
    }

    /// Whether a viewer of this version shows all of a recording of `other`: up to 1.0 the second number says so.
    fn shows_all_of(self, other: Self) -> bool {
        self.0[..2] == other.0[..2]
    }
}

/// How a file ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum RecordingEnd {
    /// With the message that ends a recording.
    Whole,
    /// Without it, behind `whole` messages that end with the byte `at`.
    Open { whole: u64, at: u64 },
    /// With something else than messages, from the byte `at` on, behind `whole` messages.
    Damaged { whole: u64, at: u64 },
}

impl ShownRecording {
    /// Reads the header of a file, and finds its end.
    ///
    /// # Errors
    /// If it cannot be read, or is no recording that the viewer can show.
    pub fn read(path: &Path) -> Result<Self, InputError> {
        let refuse = |message: &dyn fmt::Display| InputError::new("recording", path, message);
        let is_file = fs::metadata(path).map_err(|error| refuse(&error))?.is_file();
        if !is_file {
            return Err(refuse(&EXPECTED)); // opening a pipe would block until it has a writer
        }
        let file = File::open(path).map_err(|error| refuse(&error))?;
        let mut reader = BufReader::new(file);
        let header = read_bytes::<HEADER_BYTES>(&mut reader).map_err(|error| refuse(&error))?;
        let (version, is_encoding_known) = match header {
            Some([b0, b1, b2, b3, major, minor, patch, _, compression, serializer, reserved @ ..]) => {
                let magic = [b0, b1, b2, b3];
                if OLD_MAGICS.contains(&magic) {
                    return Err(refuse(&too_old(RerunVersion([0, 2, 0]))));
                }
                if magic != MAGIC {
                    return Err(refuse(&EXPECTED));
                }
                (RerunVersion([major, minor, patch]), compression <= 1 && serializer == 2 && reserved == [0, 0])
            }
            None => {
                reader.rewind().map_err(|error| refuse(&error))?;
                let begins = read_bytes::<4>(&mut reader).map_err(|error| refuse(&error))? == Some(MAGIC);
                let message =
                    if begins { format!("it ends within its header: {EXPECTED}") } else { EXPECTED.to_owned() };
                return Err(refuse(&message));
            }
        };
        if version < OLDEST {
            return Err(refuse(&too_old(version)));
        }
        if !is_encoding_known {
            return Err(refuse(&format!("it begins like a recording, and is none: {EXPECTED}")));
        }
        let end = end_of(&mut reader).map_err(|error| refuse(&error))?;
        if let RecordingEnd::Open { whole: 0, .. } | RecordingEnd::Damaged { whole: 0, .. } = end {
            return Err(refuse(&format!("it has a header, and no message: {EXPECTED}")));
        }
        let notices = version_notice(version).into_iter().chain(end_notice(end));
        let name = path.display();
        Ok(Self {
            path: path.to_owned(),
            notices: notices.map(|notice| format!("recording {name}: {notice}")).collect(),
        })
    }
}

fn too_old(version: RerunVersion) -> String {
    format!(
        "it is of rerun {version}, and the viewer, rerun {RERUN}, reads recordings since {OLDEST}: open it with \
         `rerun` of rerun-sdk=={version}, or make it again"
    )
}

/// Says that a recording is of another version than the viewer.
fn version_notice(version: RerunVersion) -> Option<String> {
    let viewer = RerunVersion::viewer();
    let differs = if version > viewer { "newer than" } else { "older than" };
    (!viewer.shows_all_of(version)).then(|| {
        format!(
            "it is of rerun {version}, {differs} the viewer, rerun {RERUN}, which may show a part of it or nothing: \
             `rerun` of rerun-sdk=={version} shows all"
        )
    })
}

/// Says that a recording does not end as it should.
fn end_notice(end: RecordingEnd) -> Option<String> {
    match end {
        RecordingEnd::Whole => None,
        RecordingEnd::Open { at, .. } => Some(format!(
            "it has no end: its mission is under way, or it was cut; it is shown up to byte {at}, its last whole \
             message"
        )),
        RecordingEnd::Damaged { at, .. } => Some(format!("it is damaged from byte {at} on: it is shown up to there")),
    }
}

/// Finds the end of a file whose header has been read.
fn end_of(reader: &mut BufReader<File>) -> io::Result<RecordingEnd> {
    let length = reader.get_ref().metadata()?.len();
    let mut at = HEADER_BYTES as u64;
    let mut whole = 0;
    loop {
        let Some(header) = read_bytes::<MESSAGE_HEADER_BYTES>(reader)? else {
            return Ok(RecordingEnd::Open { whole, at });
        };
        let number = |at: usize| u64::from_le_bytes(std::array::from_fn(|index| header[at + index]));
        let [kind, bytes] = [number(0), number(8)];
        if header.starts_with(&MAGIC) && whole > 0 {
            at += HEADER_BYTES as u64; // another recording, appended to the one before
            reader.seek(SeekFrom::Start(at))?;
            continue;
        }
        if kind > LAST_KIND {
            return Ok(RecordingEnd::Damaged { whole, at });
        }
        let next = (at + MESSAGE_HEADER_BYTES as u64).checked_add(bytes).filter(|next| *next <= length);
        let Some(next) = next else { return Ok(RecordingEnd::Open { whole, at }) };
        if kind == END || whole == 0 && has_footer(reader, length)? {
            return Ok(RecordingEnd::Whole);
        }
        whole += 1;
        reader.seek_relative(i64::try_from(bytes).expect("less than the length of a file"))?;
        at = next;
    }
}

/// Whether a file ends with the footer of a closed recording; the reader stays where it is.
fn has_footer(reader: &mut BufReader<File>, length: u64) -> io::Result<bool> {
    let before = reader.stream_position()?;
    let begin = length.saturating_sub(FOOTER.len() as u64 + 4);
    reader.seek(SeekFrom::Start(begin))?;
    let is_closed = read_bytes::<8>(reader)? == Some(FOOTER);
    reader.seek(SeekFrom::Start(before))?;
    Ok(is_closed)
}

/// The next bytes; `None` if there are not so many.
fn read_bytes<const N: usize>(reader: &mut impl Read) -> io::Result<Option<[u8; N]>> {
    let mut bytes = [0; N];
    match reader.read_exact(&mut bytes) {
        Ok(()) => Ok(Some(bytes)),
        Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => Ok(None),
        Err(error) => Err(error),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A recording of these messages, kind and length, with an end if it is closed.
    fn recording(version: [u8; 3], messages: &[(u64, usize)], is_closed: bool) -> Vec<u8> {
        let mut bytes = [&MAGIC[..], &version, &[0, 1, 2, 0, 0]].concat();
        for (kind, length) in messages.iter().copied().chain(is_closed.then_some((END, 0))) {
            bytes.extend([&kind.to_le_bytes()[..], &(length as u64).to_le_bytes(), &vec![7; length]].concat());
        }
        bytes
    }

    fn read(bytes: &[u8]) -> Result<Vec<String>, String> {
        let place = tempfile::tempdir().unwrap();
        let path = place.path().join("a.rrd");
        fs::write(&path, bytes).unwrap();
        let said = |text: String| text.replace(&format!("{}", path.display()), "a.rrd");
        match ShownRecording::read(&path) {
            Ok(ShownRecording { notices, .. }) => Ok(notices.into_iter().map(said).collect()),
            Err(error) => Err(said(error.to_string())),
        }
    }

    const MESSAGES: [(u64, usize); 3] = [(1, 40), (2, 5000), (2, 300)];

    #[test]
    fn recordings_of_other_versions_are_shown_with_a_line_or_refused() {
        let own = RerunVersion::viewer().0;
        assert_eq!(RerunVersion::viewer().to_string(), RERUN);
        let of = |version: [u8; 3]| read(&recording(version, &MESSAGES, true));
        assert_eq!(of(own), Ok(vec![]));
        assert_eq!(of([own[0], own[1], own[2] + 1]), Ok(vec![]), "a patch keeps the format");
        for (version, says) in [
            ([0, 43, 2], "it is of rerun 0.43.2, newer than the viewer, rerun 0.36.3,"),
            ([1, 0, 0], "it is of rerun 1.0.0, newer than the viewer, rerun 0.36.3,"),
            ([0, 23, 0], "it is of rerun 0.23.0, older than the viewer, rerun 0.36.3,"),
            ([0, 35, 9], "it is of rerun 0.35.9, older than the viewer, rerun 0.36.3,"),
        ] {
            let notices = of(version).unwrap();
            assert!(notices.len() == 1 && notices[0].contains(says), "{notices:?}");
        }
        for (version, says) in [
            ([0, 20, 0], "recording a.rrd: it is of rerun 0.20.0, and the viewer, rerun 0.36.3,"),
            ([0, 22, 1], "recording a.rrd: it is of rerun 0.22.1, and the viewer, rerun 0.36.3,"),
        ] {
            let refused = of(version).unwrap_err();
            assert!(refused.starts_with(says) && refused.contains("since 0.23.0"), "{refused}");
        }
        let mut msgpack = recording([0, 20, 0], &MESSAGES, true);
        msgpack[9] = 1;
        assert!(read(&msgpack).unwrap_err().contains("rerun 0.20.0"), "an encoding of that version");
        assert!(read(b"RRF1, and what was written then").unwrap_err().contains("rerun 0.2.0"));
    }

    #[test]
    fn a_recording_that_was_cut_is_shown_up_to_its_last_whole_message() {
        let whole = recording(RerunVersion::viewer().0, &MESSAGES, true);
        assert_eq!(read(&whole), Ok(vec![]));
        let ends = [68, 68 + 5016, 68 + 5016 + 316]; // of the messages: 12 + 16 + 40 and so on
        let mut shown = 0;
        let mut refused = 0;
        for length in (0..whole.len()).filter(|length| length % 7 == 0 || *length < 100 || ends.contains(length)) {
            match read(&whole[..length]) {
                Err(error) => {
                    assert!(length < ends[0] && error.contains("expected a recording"), "{length}: {error}");
                    refused += 1;
                }
                Ok(notices) => {
                    let end = ends.iter().rfind(|end| **end <= length).unwrap();
                    assert!(notices[0].contains(&format!("up to byte {end},")), "{length}: {notices:?}");
                    shown += 1;
                }
            }
        }
        assert!(shown > 500 && refused == ends[0], "{shown} shown, {refused} refused");
    }

    #[test]
    fn what_is_none_is_refused_and_damage_is_named() {
        let own = RerunVersion::viewer().0;
        let mut unknown = recording(own, &MESSAGES, true);
        unknown[68] = 200; // the kind of the second message
        assert!(read(&unknown).unwrap()[0].contains("damaged from byte 68 on"));
        let mut long = recording(own, &MESSAGES, true);
        long[76..84].copy_from_slice(&u64::MAX.to_le_bytes()); // its length
        assert!(read(&long).unwrap()[0].contains("up to byte 68,"));
        let mut first = recording(own, &MESSAGES, true);
        first[12] = 9;
        for (bytes, says) in [
            (&b"RRF2, and no more"[..], "it begins like a recording, and is none"),
            (b"RRF2", "it ends within its header"),
            (b"RRF2\0\x24\x03\0", "it ends within its header"),
            (b"RRF2\0\x24\x03\0\x01\x02\0\0", "it has a header, and no message"),
            (b"RRF2\0\x24\x03\0\x09\x02\0\0and so on and so on", "it begins like a recording, and is none"),
            (b"", "expected a recording of rerun"),
            (b"RR", "expected a recording of rerun"),
            (b"PK\x03\x04 and the rest of a ZIP file", "expected a recording of rerun"),
            (&first, "it has a header, and no message"),
        ] {
            let refused = read(bytes).unwrap_err();
            assert!(refused.starts_with("recording a.rrd: ") && refused.contains(says), "{refused}");
        }
    }

    #[test]
    fn recordings_that_were_joined_are_read_to_the_end_of_the_last() {
        let own = RerunVersion::viewer().0;
        let joined = [recording(own, &MESSAGES, false), recording(own, &MESSAGES, false)].concat();
        let length = joined.len();
        assert!(read(&joined).unwrap()[0].contains(&format!("up to byte {length},")));
        assert_eq!(read(&[joined, recording(own, &[], true)].concat()), Ok(vec![]));
        assert_eq!(read(&recording(own, &[], true)), Ok(vec![]), "of a viewer that has drawn nothing");
    }
}
