//! The text of a file, from its bytes: encodings by byte order mark and XML declaration, and KMZ archives.

use std::io::{Cursor, Read};

use encoding_rs::{Encoding, UTF_8, UTF_16BE, UTF_16LE};
use zip::ZipArchive;

use crate::error::quoted;

/// Most bytes of the document of an archive.
const MOST_BYTES: u64 = 1 << 28;

/// Ends of the names of files in an archive that have places: documents, and archives of them.
const DOCUMENTS: [&str; 2] = [".kml", ".kmz"];

/// Bytes in which an XML declaration names its encoding.
const DECLARATION: usize = 200;

/// Decodes the text of a file, without its byte order mark. Text that is valid UTF-8 is taken as such, whatever it
/// declares: programs copy declarations.
///
/// # Errors
/// If it is neither UTF-8 nor UTF-16 with a byte order mark, and declares no known encoding.
pub fn decode(bytes: &[u8]) -> Result<String, String> {
    let encoding = match (Encoding::for_bom(bytes), bytes) {
        (Some((encoding, _)), _) => encoding,
        (None, [b'<', 0, ..]) => UTF_16LE,
        (None, [0, b'<', ..]) => UTF_16BE,
        _ => match (std::str::from_utf8(bytes), declared(bytes)) {
            (Ok(text), _) => return Ok(text.to_owned()),
            (Err(_), Some(label)) => Encoding::for_label(label.as_bytes())
                .ok_or_else(|| format!("encoding `{}`: expected a known one, such as UTF-8", quoted(&label)))?,
            (Err(_), None) => UTF_8,
        },
    };
    let (text, _, is_malformed) = encoding.decode(bytes);
    if !is_malformed {
        return Ok(text.into_owned());
    }
    let valid = text.split('\u{fffd}').next().unwrap_or_default();
    let line = valid.matches('\n').count() + 1;
    Err(format!("line {line}: expected {} text", encoding.name()))
}

/// The encoding that an XML declaration names.
fn declared(bytes: &[u8]) -> Option<String> {
    let head = String::from_utf8_lossy(&bytes[..bytes.len().min(DECLARATION)]);
    let declaration = head.strip_prefix("<?xml")?.split("?>").next()?;
    let value = declaration.split_once("encoding")?.1.trim_start().strip_prefix('=')?.trim_start();
    let quote = value.chars().next().filter(|quote| "\"'".contains(*quote))?;
    Some(value[1..].split(quote).next()?.to_owned())
}

/// The document of a KMZ archive, its first file named `.kml` in the outermost folder that has one; and the names of
/// all other documents and archives in it.
///
/// # Errors
/// If it is no zip archive, has no such file, or one that is damaged or too large.
pub fn unzip(bytes: &[u8]) -> Result<(Vec<u8>, Vec<String>), String> {
    let refuse = |error: &dyn std::fmt::Display| format!("{error}: expected a KMZ file, a zip archive with a KML file");
    let mut archive = ZipArchive::new(Cursor::new(bytes)).map_err(|error| refuse(&error))?;
    let files = (0..archive.len()).filter_map(|index| {
        let name = archive.name_for_index(index)?.replace('\\', "/");
        let is_own = !name.rsplit('/').next()?.starts_with('.'); // macOS adds files such as `__MACOSX/._doc.kml`
        let lower = name.to_lowercase();
        (is_own && DOCUMENTS.iter().any(|end| lower.ends_with(end))).then_some((name, index))
    });
    let files: Vec<(String, usize)> = files.collect();
    let documents = files.iter().filter(|(name, _)| name.to_lowercase().ends_with(DOCUMENTS[0]));
    let document = documents.min_by_key(|(name, index)| (name.matches('/').count(), *index));
    let index = document.ok_or_else(|| refuse(&"no KML file in it"))?.1;
    let others = files.into_iter().filter(|(_, other)| *other != index).map(|(name, _)| name).collect();
    let document = archive.by_index(index).map_err(|error| refuse(&error))?;
    let mut text = Vec::new();
    document.take(MOST_BYTES + 1).read_to_end(&mut text).map_err(|error| refuse(&error))?;
    if text.len() as u64 > MOST_BYTES {
        return Err(format!("a document of more than {MOST_BYTES} bytes: expected a smaller one"));
    }
    Ok((text, others))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `<a>Wäldli</a>` with this declaration and encoding.
    fn encoded(declared: &str, encode: fn(&str) -> Vec<u8>) -> Vec<u8> {
        encode(&format!("<?xml version=\"1.0\" encoding={declared}?><a>Wäldli</a>"))
    }

    fn latin(text: &str) -> Vec<u8> {
        text.chars().map(|character| character as u8).collect()
    }

    fn utf16(text: &str) -> Vec<u8> {
        text.encode_utf16().flat_map(u16::to_le_bytes).collect()
    }

    #[test]
    fn declared_encodings_and_byte_order_marks_are_followed() {
        for bytes in [
            encoded("\"windows-1252\"", latin),
            encoded("'ISO-8859-1'", latin),
            encoded("\"utf-16\"", utf16),
            encoded("\"utf-16\"", |text| utf16(&format!("\u{feff}{text}"))),
            encoded("\"utf-16\"", |text| text.as_bytes().to_vec()),
            encoded("\"windows-1252\"", |text| format!("\u{feff}{text}").into_bytes()),
        ] {
            assert!(decode(&bytes).unwrap().ends_with("<a>Wäldli</a>"), "{bytes:?}");
        }
        assert_eq!(
            decode(&encoded("\"ebcdic\"", latin)).unwrap_err(),
            "encoding `ebcdic`: expected a known one, such as UTF-8"
        );
        assert_eq!(decode(b"a\nb\n\xff").unwrap_err(), "line 3: expected UTF-8 text");
        assert_eq!(decode(b"\xef\xbb\xbfa").unwrap(), "a");
    }

    #[test]
    fn what_is_no_archive_of_kml_is_refused() {
        assert!(unzip(b"<kml/>").unwrap_err().ends_with("expected a KMZ file, a zip archive with a KML file"));
    }
}
