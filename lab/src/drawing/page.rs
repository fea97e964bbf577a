//! The page of a figure: its size, title, legend, description and font, and its files.
//!
//! Everything is drawn as SVG. `pictures` converts the same document to PDF and PNG. Text stays text in SVG and PDF.

use std::path::{Path, PathBuf};

use skysink_mission::files::write_whole;
use svg::node::element::{Description, Group, Path as Stroke, Rectangle, Text};
use svg::{Document, Node};
use ttf_parser::Face;

#[cfg(feature = "pictures")]
use super::pictures;
use crate::error::{LabError, MissingGlyph};

/// Width of a page for a screen [units], and minimum width of a PNG [pixels].
const WIDTH: f64 = 1600.0;
/// Margin of the page [units].
pub const MARGIN: f64 = 30.0;
/// Lower end of the title [units].
const TOP: f64 = 78.0;
/// Width of the sample of a legend entry [units].
pub const SAMPLE: f64 = 100.0;
/// Colour of axis lines and text.
pub const INK: &str = "#202020";
/// Font size of the title [units].
const TITLE_EM: f64 = 34.0;
/// Font size of the footer [units].
const FOOTER_EM: f64 = 21.0;
/// Units per point in print, so that the text of axes and legends (28 units) has 8 pt.
const UNITS_PER_PT: f64 = 3.5;
/// Points per millimetre.
const PT_PER_MM: f64 = 72.0 / 25.4;

/// The font families in the SVG. Text is measured with the first one, which is embedded.
const FAMILIES: &str = "DejaVu Sans, Verdana, Arial, sans-serif";
/// A subset of DejaVu Sans; licence and command in `DejaVuSans-subset.LICENSE.txt`.
pub const DEJAVU_SANS: &[u8] = include_bytes!("DejaVuSans-subset.ttf");

/// The texts and the width of a page.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Look {
    /// Title at the top, or empty.
    pub title: String,
    /// Footer at the bottom, or empty.
    pub footer: String,
    /// Missions, version and command, as metadata of the file.
    pub description: String,
    /// Printed width [mm]; `None` for a screen, [`WIDTH`].
    pub width_mm: Option<f64>,
}

/// A white page. The origin is its upper left corner; x points right and y down.
pub struct Page {
    document: Document,
    look: Look,
}

impl Look {
    /// Width of the page [units].
    pub fn width(&self) -> f64 {
        self.width_mm.map_or(WIDTH, |width_mm| (width_mm * PT_PER_MM * UNITS_PER_PT).round())
    }

    /// Upper end of the figure, below the title [units].
    pub fn top(&self) -> f64 {
        if self.title.is_empty() { MARGIN } else { TOP }
    }
}

impl Page {
    /// A page with the title of `look`.
    pub fn new(look: &Look) -> Self {
        let description = Description::new().add(svg::node::Text::new(&look.description));
        let white = Rectangle::new().set("width", "100%").set("height", "100%").set("fill", "white");
        let document = Document::new().set("font-family", FAMILIES).set("stroke-linejoin", "round").set("fill", INK);
        let mut page = Self { document: document.add(description).add(white), look: look.clone() };
        page.add_line(&look.title, MARGIN + 0.8 * TITLE_EM, TITLE_EM);
        page
    }

    /// Adds a line of text on the base line `y` [units], shrunk to the width of the page, unless it is empty.
    fn add_line(&mut self, line: &str, y: f64, em: f64) {
        if !line.is_empty() {
            let room = self.look.width() - 2.0 * MARGIN;
            self.add(text(line, [MARGIN, y], fitting(line, em, room), "start"));
        }
    }

    /// Adds a node on top of the others.
    pub fn add(&mut self, node: impl Into<Box<dyn Node>>) {
        self.document.append(node);
    }

    /// Adds a legend in as many columns as fit into `width`. An entry is a sample, drawn from the origin to the right,
    /// and its label. Returns the lower end.
    pub fn add_legend(&mut self, [left, top]: [f64; 2], width: f64, em: f64, entries: &[(Group, &str)]) -> f64 {
        // The viewer may use a wider font.
        let widest = entries.iter().map(|(_, label)| 1.1 * text_width(label, em)).fold(0.0, f64::max);
        let column = SAMPLE + widest + 1.4 * em;
        let columns = ((width / column) as usize).clamp(1, entries.len());
        for (i, (sample, label)) in entries.iter().enumerate() {
            let x = left + column * (i % columns) as f64;
            let y = top + 1.6 * em * ((i / columns) as f64 + 0.5);
            self.add(sample.clone().set("transform", format!("translate({x:.1} {y:.1})")));
            self.add(text(label, [x + SAMPLE + 0.4 * em, y + 0.36 * em], em, "start"));
        }
        top + 1.6 * em * entries.len().div_ceil(columns) as f64
    }

    /// Writes `stem`.svg, and with the feature `pictures` `stem`.pdf and `stem`.png; returns these files. The page ends
    /// with the footer and a margin below `bottom` [units].
    ///
    /// # Errors
    /// If the embedded font lacks a character, or a file cannot be written.
    pub fn write(mut self, stem: &Path, mut bottom: f64) -> Result<Vec<PathBuf>, LabError> {
        let look = self.look.clone();
        if !look.footer.is_empty() {
            bottom += 2.0 * FOOTER_EM;
            self.add_line(&look.footer, bottom, FOOTER_EM);
        }
        let [width, height] = [look.width(), (bottom + MARGIN).round()];
        let in_pt = |units: f64| format!("{:.3}pt", units / UNITS_PER_PT);
        let document = self.document.set("width", in_pt(width)).set("height", in_pt(height));
        let svg = document.set("viewBox", (0.0, 0.0, width, height)).to_string();
        for text in svg.split(['<', '>']).map(str::trim) {
            let refuse = |missing| LabError::FigureText { text: text.to_owned(), missing };
            check_text(text).map_err(refuse)?;
        }
        let file = stem.with_added_extension("svg");
        write_whole(&file, svg.as_bytes())?;
        #[allow(unused_mut)] // a build without pictures writes no more
        let mut files = vec![file];
        #[cfg(feature = "pictures")]
        files.extend(pictures::write(&svg, &look, width.max(WIDTH), stem)?);
        Ok(files)
    }
}

/// Refuses a text with characters that the embedded font lacks.
pub fn check_text(text: &str) -> Result<(), MissingGlyph> {
    let missing = text.chars().find(|&character| font().glyph_index(character).is_none());
    missing.map_or(Ok(()), |character| Err(MissingGlyph(character)))
}

/// Text with its `anchor` (`start`, `middle`, `end`) at a point on the base line.
pub fn text(content: &str, [x, y]: [f64; 2], em: f64, anchor: &str) -> Text {
    let rounded = |number: f64| (10.0 * number).round() / 10.0;
    let text = Text::new(content).set("x", rounded(x)).set("y", rounded(y));
    text.set("font-size", rounded(em)).set("text-anchor", anchor)
}

/// An unfilled line of `width` [units] along the SVG path `data`.
pub fn stroke(data: impl Into<String>, width: f64, colour: &str) -> Stroke {
    Stroke::new().set("d", data.into()).set("fill", "none").set("stroke", colour).set("stroke-width", width)
}

/// SVG path data of a line through these points.
pub fn line(points: impl IntoIterator<Item = [f64; 2]>) -> String {
    let points: Vec<String> = points.into_iter().map(|[x, y]| format!("{x:.1},{y:.1}")).collect();
    format!("M{}", points.join(" "))
}

/// The font size `em`, reduced if necessary so that `text` fits into `room` [units], with a reserve for wider fonts.
pub fn fitting(text: &str, em: f64, room: f64) -> f64 {
    em.min(em * room / (1.08 * text_width(text, em)).max(1.0))
}

/// Width [units] of `text` in the embedded font.
pub fn text_width(text: &str, em: f64) -> f64 {
    let font = font();
    let advance = |character| font.glyph_hor_advance(font.glyph_index(character)?);
    em / f64::from(font.units_per_em()) * text.chars().filter_map(advance).map(f64::from).sum::<f64>()
}

fn font() -> Face<'static> {
    Face::parse(DEJAVU_SANS, 0).expect("the embedded font is valid")
}
