//! Checks that the readers of KML and GPX lack: they hang on truncated files or accept them, and have no depth limit.

use quick_xml::Reader;
use quick_xml::events::Event;

/// Maximum depth of nested elements.
const MOST_NESTED: usize = 200;

/// Refuses incomplete XML, elements that are nested too deep, and elements `point` without text. `format` is the
/// expected format.
pub fn check(text: &str, format: &str, point: Option<&str>) -> Result<(), String> {
    let mut reader = Reader::from_str(text);
    let mut open: Vec<(Vec<u8>, bool)> = Vec::new(); // name, and whether it contains text
    let is_point = |name: &[u8]| point.is_some_and(|point| point.as_bytes() == name);
    let refuse = || Err(format!("{} without coordinates: expected a position", point.unwrap_or_default()));
    loop {
        match reader.read_event().map_err(|error| format!("{error}: expected a {format} file"))? {
            Event::Start(begin) => open.push((begin.local_name().as_ref().to_vec(), false)),
            Event::Empty(element) if is_point(element.local_name().as_ref()) => return refuse(),
            Event::Text(text) if !text.trim_ascii().is_empty() => {
                open.iter_mut().for_each(|(_, has_text)| *has_text = true);
            }
            Event::End(_) => match open.pop() {
                Some((name, false)) if is_point(&name) => return refuse(),
                _ => {}
            },
            Event::Eof if !open.is_empty() => {
                return Err(format!("it ends within an element: expected a complete {format} file"));
            }
            Event::Eof => return Ok(()),
            _ => {}
        }
        if open.len() > MOST_NESTED {
            return Err(format!("elements nested deeper than {MOST_NESTED}: expected fewer"));
        }
    }
}
