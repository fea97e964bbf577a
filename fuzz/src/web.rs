//! What whoever connects to `skysink view` sends.

use std::fs;
use std::sync::{Arc, LazyLock};

use skysink_web::server::converse;
use skysink_web::{Site, WebPage};

use crate::world::FOLDER;

/// The token in the address of the page, which the corpus knows.
const TOKEN: &[u8] = b"0badcafe";

/// Another one of the same length.
const GUESS: &[u8] = b"0badcaff";

/// The content of the recording.
const SECRET: &[u8] = b"RRF2 for those who know the address";

/// Bytes that are read of the answers.
const READ_BYTES: u64 = 1 << 16;

static SITE: LazyLock<Arc<Site>> = LazyLock::new(|| {
    let folder = FOLDER.path().join("run");
    fs::create_dir_all(&folder).expect("a folder can be made");
    fs::write(folder.join("mission.rrd"), SECRET).expect("a file can be written");
    let page = WebPage::new("run", &[folder.join("mission.rrd")], None);
    Arc::new(Site::with_token(page, std::str::from_utf8(TOKEN).expect("digits")))
});

/// Requests are answered in HTTP; only one with the token and a host gets a file.
pub fn request(bytes: &[u8]) {
    let answers = answers(bytes);
    if contains(&answers, SECRET) {
        assert!(contains(bytes, TOKEN), "the recording is served without the token");
        assert!(bytes.split(|&byte| byte == b'\n').any(is_host), "the recording is served without a host");
    }
    let mut guessed = bytes.to_vec();
    while let Some(at) = guessed.windows(TOKEN.len()).position(|window| window == TOKEN) {
        guessed[at..at + GUESS.len()].copy_from_slice(GUESS);
    }
    let refused = self::answers(&guessed);
    let is_served = contains(&refused, b"HTTP/1.1 200") || contains(&refused, b"HTTP/1.0 200");
    assert!(!is_served && !contains(&refused, SECRET), "a file is served without the token");
}

/// Whether a line is a header `Host` with a value.
fn is_host(line: &[u8]) -> bool {
    let Some(colon) = line.iter().position(|&byte| byte == b':') else { return false };
    line[..colon].eq_ignore_ascii_case(b"host") && !line[colon + 1..].trim_ascii().is_empty()
}

/// What the server answers to these bytes.
fn answers(bytes: &[u8]) -> Vec<u8> {
    let answers = converse(&SITE, bytes, READ_BYTES).expect("a connection in memory");
    if let Some(head) = answers.get(..12) {
        let status = [200, 308, 400, 403, 404, 405, 414, 431, 505];
        let is_known = status.iter().any(|status| head[9..] == *status.to_string().as_bytes());
        assert!(head.starts_with(b"HTTP/1.") && is_known, "{}", head.escape_ascii());
    }
    answers
}

fn contains(bytes: &[u8], part: &[u8]) -> bool {
    bytes.windows(part.len()).any(|window| window == part)
}
