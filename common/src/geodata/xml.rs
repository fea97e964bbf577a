//! Checks that the readers of KML and GPX lack: they hang on truncated files or accept them, have no depth limit, and
//! omit some items without a point.

use quick_xml::Reader;
use quick_xml::events::Event;

/// Maximum depth of nested elements.
const MOST_NESTED: usize = 200;

/// Elements of KML with a position that are not points.
const NO_POINTS: [&[u8]; 11] = [
    b"LineString",
    b"LinearRing",
    b"Polygon",
    b"Model",
    b"Track",
    b"MultiTrack",
    b"Tour",
    b"NetworkLink",
    b"GroundOverlay",
    b"PhotoOverlay",
    b"ScreenOverlay",
];

/// An element whose end has not been read.
struct OpenElement {
    name: Vec<u8>,
    has_text: bool,
    /// Whether it contains an item with a position.
    has_place: bool,
}

/// Refuses incomplete XML, elements that are nested too deep, and points of KML without coordinates. `format` is the
/// expected format. Returns the number of items of KML without a point: lines and the like, and empty placemarks.
///
/// # Errors
/// If the text is refused.
pub fn check(text: &str, format: &str) -> Result<usize, String> {
    let mut reader = Reader::from_str(text);
    let mut open: Vec<OpenElement> = Vec::new();
    let mut items = 0;
    loop {
        let event = reader.read_event().map_err(|error| format!("{error}: expected a {format} file"))?;
        match &event {
            Event::Start(element) | Event::Empty(element) => {
                let name = element.local_name().as_ref().to_vec();
                let is_item = NO_POINTS.contains(&&name[..]);
                let is_within_item = open.iter().any(|above| NO_POINTS.contains(&&above.name[..]));
                items += usize::from(is_item && !is_within_item);
                if is_item || name == b"Point" {
                    open.iter_mut().for_each(|above| above.has_place = true);
                }
                open.push(OpenElement { name, has_text: false, has_place: false });
            }
            Event::Text(text) if !text.trim_ascii().is_empty() => {
                open.iter_mut().for_each(|above| above.has_text = true);
            }
            Event::Eof if !open.is_empty() => {
                return Err(format!("it ends within an element: expected a complete {format} file"));
            }
            Event::Eof => return Ok(items),
            _ => {}
        }
        if let Event::Empty(_) | Event::End(_) = event
            && let Some(OpenElement { name, has_text, has_place }) = open.pop()
        {
            if name == b"Point" && !has_text && format == "KML" {
                return Err("Point without coordinates: expected a position".to_owned());
            }
            items += usize::from(name == b"Placemark" && !has_place);
        }
        if open.len() > MOST_NESTED {
            return Err(format!("elements nested deeper than {MOST_NESTED}: expected fewer"));
        }
    }
}
