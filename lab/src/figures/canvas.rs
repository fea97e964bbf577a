//! A sheet of lines, areas and texts, and the two files it becomes: the only place that writes with plotters' backends.

use std::path::Path;
use std::{fs, io};

use plotters::backend::{BitMapBackend, DrawingBackend, SVGBackend};
use plotters::coord::Shift;
use plotters::drawing::{DrawingArea, DrawingAreaErrorKind, IntoDrawingArea};
use plotters::element::{Circle, PathElement, Polygon};
pub use plotters::style::FontTransform;
pub use plotters::style::text_anchor::HPos;
use plotters::style::text_anchor::{Pos, VPos};
use plotters::style::{Color, RGBColor, ShapeStyle, TextStyle, WHITE};
use skysink_mission::error::FileContext;

use super::error::FigureError;
use super::style::{INK, bitmap_size, font, lacks};
use crate::error::LabError;

/// Backend pixels a unit: the SVG has coordinates that fine, the PNG is averaged from that many by that many samples.
const FINENESS: u32 = 3;

/// A text on the sheet.
pub struct Text {
    /// What it says.
    pub text: String,
    /// Its anchor, on the base line [units].
    pub at: [f64; 2],
    /// Size [units].
    pub em: f64,
    /// Which part is there.
    pub anchor: HPos,
    /// Whether it runs from left to right or, rotated by 270°, from below to above.
    pub turn: FontTransform,
    /// Its colour.
    pub colour: RGBColor,
}

impl Text {
    /// A text that runs from left to right in the colour of axes.
    pub fn new(text: impl Into<String>, at: [f64; 2], em: f64, anchor: HPos) -> Self {
        Self { text: text.into(), at, em, anchor, turn: FontTransform::None, colour: INK }
    }
}

/// What can lie on the sheet.
enum Shape {
    Line { points: Vec<[f64; 2]>, width: f64, colour: RGBColor },
    Area { points: Vec<[f64; 2]>, colour: RGBColor, opacity: f64 },
    Text(Text),
}

/// A white sheet; x to the right and y downwards from its upper left corner, a unit is a pixel of the PNG.
pub struct Canvas {
    width: u32,
    height: u32,
    shapes: Vec<Shape>,
}

impl Canvas {
    /// An empty sheet of `width` by `height` units.
    pub fn new(width: u32, height: u32) -> Self {
        Self { width, height, shapes: Vec::new() }
    }

    /// Puts an opaque line on the sheet.
    pub fn line(&mut self, points: Vec<[f64; 2]>, width: f64, colour: RGBColor) {
        self.shapes.push(Shape::Line { points, width, colour });
    }

    /// Puts a filled polygon on the sheet; `opacity` from 0 to 1.
    pub fn area(&mut self, points: Vec<[f64; 2]>, colour: RGBColor, opacity: f64) {
        self.shapes.push(Shape::Area { points, colour, opacity });
    }

    /// Puts a text on the sheet.
    pub fn text(&mut self, text: Text) {
        self.shapes.push(Shape::Text(text));
    }

    /// Writes `stem`.svg and `stem`.png.
    ///
    /// # Errors
    /// A text that the embedded font cannot set, a file that cannot be written.
    pub fn write(&self, stem: &Path) -> Result<(), LabError> {
        for shape in &self.shapes {
            if let Shape::Text(Text { text, .. }) = shape
                && let Some(character) = lacks(text)
            {
                return Err(FigureError::Character { text: text.clone(), character }.into());
            }
        }
        let path = stem.with_added_extension("svg");
        fs::write(&path, self.svg()).at(&path)?;
        let path = stem.with_added_extension("png");
        let size = (self.width, self.height);
        let mut png = BitMapBackend::new(&path, size);
        let written = png.blit_bitmap((0, 0), size, &self.bitmap()).and_then(|()| png.present());
        Ok(written.map_err(io::Error::other).at(&path)?)
    }

    /// The sheet as an SVG document of `width` by `height`.
    fn svg(&self) -> String {
        let (width, height) = (self.width * FINENESS, self.height * FINENESS);
        let mut svg = String::new();
        let area = SVGBackend::with_string(&mut svg, (width, height)).into_drawing_area();
        self.paint(&area, Medium::Svg).expect("a string takes everything");
        drop(area);
        svg.replacen(
            &format!("width=\"{width}\" height=\"{height}\""),
            &format!("width=\"{}\" height=\"{}\" stroke-linejoin=\"round\"", self.width, self.height),
            1,
        )
    }

    /// The sheet as RGB bytes, row by row.
    fn bitmap(&self) -> Vec<u8> {
        let (width, height) = (self.width * FINENESS, self.height * FINENESS);
        let mut fine = vec![u8::MAX; (width * height * 3) as usize];
        let area = BitMapBackend::with_buffer(&mut fine, (width, height)).into_drawing_area();
        self.paint(&area, Medium::Bitmap).expect("a buffer takes everything");
        drop(area);
        average(&fine, width)
    }

    fn paint<B: DrawingBackend>(&self, area: &DrawingArea<B, Shift>, medium: Medium) -> Painted<B> {
        area.fill(&WHITE)?;
        for shape in &self.shapes {
            match shape {
                Shape::Line { points, width, colour } => medium.draw_line(area, points, *width, *colour)?,
                Shape::Area { points, colour, opacity } => {
                    area.draw(&Polygon::new(fine(points), colour.mix(*opacity)))?
                }
                Shape::Text(text) => medium.draw_text(area, text)?,
            }
        }
        area.present()
    }
}

/// What drawing on a backend comes to.
type Painted<B> = Result<(), DrawingAreaErrorKind<<B as DrawingBackend>::ErrorType>>;

/// What the two kinds of file need done differently.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Medium {
    Svg,
    Bitmap,
}

impl Medium {
    /// A line with round corners. Plotters fills the outline of a bitmap's thick line, with holes where it crosses
    /// itself; stretch by stretch there are none.
    fn draw_line<B: DrawingBackend>(
        self,
        area: &DrawingArea<B, Shift>,
        points: &[[f64; 2]],
        width: f64,
        colour: RGBColor,
    ) -> Painted<B> {
        let stroke_width = (width * f64::from(FINENESS)).round() as u32;
        let style = ShapeStyle { color: colour.to_rgba(), filled: true, stroke_width };
        if self == Self::Svg {
            return area.draw(&PathElement::new(fine(points), style));
        }
        for (i, ends) in points.windows(2).enumerate() {
            let ends = fine(ends);
            if i > 0 {
                area.draw(&Circle::new(ends[0], stroke_width / 2, style))?;
            }
            area.draw(&PathElement::new(ends, style))?;
        }
        Ok(())
    }

    /// A text with its anchor on the base line, which plotters' two backends put at different depths below the top.
    fn draw_text<B: DrawingBackend>(self, area: &DrawingArea<B, Shift>, text: &Text) -> Painted<B> {
        let (size, depth) = match self {
            Self::Svg => (1.24 * text.em, 0.76 * text.em),
            Self::Bitmap => (bitmap_size(text.em), bitmap_size(text.em) / 2.0),
        };
        let at = match text.turn {
            FontTransform::None => [text.at[0], text.at[1] - depth],
            _ => [text.at[0] - depth, text.at[1]],
        };
        let font = font(size * f64::from(FINENESS)).transform(text.turn.clone());
        let style = TextStyle { font, color: text.colour.to_backend_color(), pos: Pos::new(text.anchor, VPos::Top) };
        area.draw_text(&text.text, &style, fine(&[at])[0])
    }
}

/// Units → backend pixels.
fn fine(points: &[[f64; 2]]) -> Vec<(i32, i32)> {
    let pixel = |units: f64| (units * f64::from(FINENESS)).round() as i32;
    points.iter().map(|&[x, y]| (pixel(x), pixel(y))).collect()
}

/// Means of the squares of `FINENESS` by `FINENESS` pixels of an RGB picture `width` pixels wide.
fn average(fine: &[u8], width: u32) -> Vec<u8> {
    let (fineness, row) = (FINENESS as usize, width as usize * 3);
    let mut coarse = Vec::with_capacity(fine.len() / (fineness * fineness));
    for rows in fine.chunks_exact(row * fineness) {
        for x in (0..row).step_by(3 * fineness) {
            for channel in 0..3 {
                let samples = (0..fineness * fineness)
                    .map(|i| u32::from(rows[i / fineness * row + x + i % fineness * 3 + channel]));
                let count = FINENESS * FINENESS;
                coarse.push(((samples.sum::<u32>() + count / 2) / count) as u8);
            }
        }
    }
    coarse
}
