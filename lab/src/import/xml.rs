//! What the readers of KML and GPX do not check: they wait for the end of a cut file for ever, or take what is there, and
//! have no limit of depth.

use quick_xml::Reader;
use quick_xml::events::Event;

/// Elements in each other, at most.
const MOST_NESTED: usize = 200;

/// Refuses what is no whole XML, nests too deep, or has an element `point` in which no text is. `format` is expected.
pub(super) fn check(text: &str, format: &str, point: Option<&str>) -> Result<(), String> {
    let mut reader = Reader::from_str(text);
    let mut open: Vec<(Vec<u8>, bool)> = Vec::new(); // names, and whether there is text within
    let is_point = |name: &[u8]| point.is_some_and(|point| point.as_bytes() == name);
    let refuse = || Err(format!("{} without coordinates: expected some", point.unwrap_or_default()));
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
                return Err(format!("it ends within an element: expected a whole {format} file"));
            }
            Event::Eof => return Ok(()),
            _ => {}
        }
        if open.len() > MOST_NESTED {
            return Err(format!("elements nested deeper than {MOST_NESTED}: expected fewer"));
        }
    }
}
