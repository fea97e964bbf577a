//! XML as a tree of elements: what KML and GPX are read from.
//!
//! Names lose their prefixes, since loggers declare other namespaces than the standards, or none.

use quick_xml::escape::resolve_predefined_entity;
use quick_xml::events::{BytesStart, Event};
use quick_xml::{Reader, XmlVersion};

use crate::error::quoted;

/// Maximum depth of nested elements.
const MOST_NESTED: usize = 200;

/// Elements with many positions, or none, that no reader looks into.
const UNREAD: [&str; 6] = ["trkseg", "rtept", "extensions", "Track", "Style", "Tour"];

/// An element with all that is in it.
#[derive(Debug, Default)]
pub struct XmlElement {
    /// Its name without a prefix.
    pub name: String,
    attributes: Vec<(String, String)>,
    text: String,
    /// The elements in it.
    pub children: Vec<Self>,
}

/// Parses the text of a file whose outermost element has one of the names `roots`. `format` is the expected format.
///
/// # Errors
/// If it is not well-formed or incomplete, if elements are nested too deep, or if it has another outermost element.
pub fn parse(text: &str, format: &str, roots: &[&str]) -> Result<XmlElement, String> {
    let refuse = |reason: &dyn std::fmt::Display| format!("{reason}: expected a {format} file");
    let mut reader = Reader::from_str(text);
    let mut open = Vec::new(); // the elements around the current one, the outermost first
    let mut current = XmlElement::default();
    loop {
        let event = reader.read_event().map_err(|error| refuse(&error))?;
        match &event {
            Event::Start(start) | Event::Empty(start) => {
                let element = XmlElement::of(start).map_err(|error| refuse(&error))?;
                open.push(std::mem::replace(&mut current, element));
            }
            Event::Text(text) => current.text += &text.xml10_content().map_err(|error| refuse(&error))?,
            Event::CData(text) => current.text += &text.xml10_content().map_err(|error| refuse(&error))?,
            Event::GeneralRef(reference) => {
                let name = reference.decode().map_err(|error| refuse(&error))?;
                let character = reference.resolve_char_ref().map_err(|error| refuse(&error))?;
                let text = character.map(String::from).or_else(|| Some(resolve_predefined_entity(&name)?.to_owned()));
                current.text += &text.ok_or_else(|| refuse(&format_args!("unknown entity `&{};`", quoted(&name))))?;
            }
            Event::Eof if !open.is_empty() => {
                return Err(format!("it ends within an element: expected a complete {format} file"));
            }
            Event::Eof => break,
            _ => {}
        }
        if open.len() > MOST_NESTED {
            return Err(format!("elements nested deeper than {MOST_NESTED}: expected fewer"));
        }
        let is_closed = match &event {
            Event::Start(start) if UNREAD.contains(&current.name.as_str()) => {
                reader.read_to_end(start.name()).map_err(|error| refuse(&error))?;
                true
            }
            Event::Empty(_) | Event::End(_) => true,
            _ => false,
        };
        if is_closed && let Some(around) = open.pop() {
            let closed = std::mem::replace(&mut current, around);
            current.children.push(closed);
        }
    }
    let mut roots_found = current.children.into_iter();
    let root = roots_found.next().ok_or_else(|| refuse(&"no element"))?;
    if let Some(second) = roots_found.next() {
        return Err(refuse(&format_args!("`{}` after the outermost element", quoted(&second.name))));
    }
    if !roots.contains(&root.name.as_str()) {
        return Err(refuse(&format_args!("`{}`", quoted(&root.name))));
    }
    Ok(root)
}

impl XmlElement {
    fn of(start: &BytesStart) -> Result<Self, quick_xml::Error> {
        let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
        let attribute = |attribute: Result<quick_xml::events::attributes::Attribute, _>| {
            let attribute = attribute?;
            let value = attribute.normalized_value(XmlVersion::Implicit1_0)?.into_owned();
            Ok((text(attribute.key.local_name().as_ref()), value))
        };
        Ok(Self {
            name: text(start.local_name().as_ref()),
            attributes: start.attributes().map(attribute).collect::<Result<_, quick_xml::Error>>()?,
            ..Self::default()
        })
    }

    /// The elements of this name in it.
    pub fn named(&self, name: &str) -> impl Iterator<Item = &Self> {
        self.children.iter().filter(move |child| child.name == name)
    }

    /// The text of the first element of this name in it; `None` without such an element, or if it is empty.
    pub fn text_of(&self, name: &str) -> Option<&str> {
        self.children.iter().find(|child| child.name == name).and_then(Self::text)
    }

    /// Its text without the blanks around it; `None` if it has none.
    pub fn text(&self) -> Option<&str> {
        Some(self.text.trim()).filter(|text| !text.is_empty())
    }

    /// The value of an attribute without the blanks around it; `None` if it is missing or empty.
    pub fn attribute(&self, name: &str) -> Option<&str> {
        let found = self.attributes.iter().find(|(own, _)| own == name);
        found.map(|(_, value)| value.trim()).filter(|value| !value.is_empty())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn entities_sections_and_prefixes_are_resolved() {
        let root = parse(
            "<?xml version='1.0'?><a:gpx v='&lt;1'><n>x &amp; &#228;<![CDATA[<b>]]></n></a:gpx>",
            "GPX",
            &["gpx"],
        );
        let root = root.unwrap();
        assert_eq!((root.attribute("v"), root.text_of("n"), root.text_of("m")), (Some("<1"), Some("x & ä<b>"), None));
        assert!(parse("<gpx>&nbsp;</gpx>", "GPX", &["gpx"]).unwrap_err().contains("unknown entity `&nbsp;`"));
    }

    #[test]
    fn what_no_reader_needs_is_left_out_and_still_has_to_end() {
        let root = parse("<gpx><trk><trkseg><trkpt lat='1' lon='2'/></trkseg><trkseg/></trk></gpx>", "GPX", &["gpx"]);
        let root = root.unwrap();
        assert_eq!(root.children[0].children.iter().map(|child| child.children.len()).collect::<Vec<_>>(), [0, 0]);
        assert!(parse("<gpx><trkseg><trkpt>", "GPX", &["gpx"]).is_err());
    }
}
