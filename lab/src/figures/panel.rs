//! A rectangle of the sheet between two axes, and the words around a figure: what charts and maps have in common.

use super::axis::Axis;
use super::canvas::{Canvas, HPos, Text};
use super::style::{AXIS_WIDTH, FAINT, FOOTER_EM, GRID, INK, text_width};

/// Length of a tick [units].
const TICK: f64 = 8.0;
/// Distance between tick and tick label [units].
const GAP: f64 = 8.0;

/// A rectangle on the sheet [units] whose sides are two axes.
#[derive(Debug)]
pub struct Panel {
    /// Left, upper end.
    pub corner: [f64; 2],
    /// Width and height.
    pub size: [f64; 2],
    /// Axis along the lower side.
    pub x: Axis,
    /// Axis along the left side.
    pub y: Axis,
}

/// Whether a panel has lines at its ticks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Grid {
    /// Horizontal lines.
    Rows,
    /// No lines.
    None,
}

impl Panel {
    /// Where the point (`x`, `y`) is on the sheet [units].
    pub fn at(&self, x: f64, y: f64) -> [f64; 2] {
        [self.corner[0] + self.x.place(x) * self.size[0], self.bottom() - self.y.place(y) * self.size[1]]
    }

    /// Lower side [units].
    pub fn bottom(&self) -> f64 {
        self.corner[1] + self.size[1]
    }

    /// Draws both axes and the frame, with text at an em of `em` and about a tick every `spacing` units.
    pub fn draw(&self, canvas: &mut Canvas, em: f64, spacing: [f64; 2], grid: Grid) {
        self.draw_y_axis(canvas, em, spacing[1], grid);
        self.draw_x_axis(canvas, em, spacing[0]);
        self.draw_frame(canvas);
    }

    fn draw_y_axis(&self, canvas: &mut Canvas, em: f64, spacing: f64, grid: Grid) {
        let (left, right) = (self.corner[0], self.corner[0] + self.size[0]);
        for (value, label) in self.y.ticks((self.size[1] / spacing) as usize + 1) {
            let y = self.bottom() - self.y.place(value) * self.size[1];
            if grid == Grid::Rows {
                canvas.line(vec![[left, y], [right, y]], AXIS_WIDTH / 2.0, GRID);
            }
            canvas.line(vec![[left - TICK, y], [left, y]], AXIS_WIDTH, INK);
            canvas.text(Text::new(label, [left - TICK - GAP, y + 0.36 * em], em, HPos::Right));
        }
    }

    /// Draws ticks and tick labels of the lower side.
    pub fn draw_x_axis(&self, canvas: &mut Canvas, em: f64, spacing: f64) {
        let bottom = self.bottom();
        for (value, label) in self.x.ticks((self.size[0] / spacing) as usize + 1) {
            let x = self.corner[0] + self.x.place(value) * self.size[0];
            canvas.line(vec![[x, bottom], [x, bottom + TICK]], AXIS_WIDTH, INK);
            canvas.text(Text::new(label, [x, bottom + TICK + GAP + 0.76 * em], em, HPos::Center));
        }
    }

    /// Draws the four sides.
    pub fn draw_frame(&self, canvas: &mut Canvas) {
        let [left, top] = self.corner;
        let (right, bottom) = (left + self.size[0], self.bottom());
        let frame = vec![[left, top], [right, top], [right, bottom], [left, bottom], [left, top]];
        canvas.line(frame, AXIS_WIDTH, INK);
    }

    /// Space [units] left of the left side that ticks and their labels take up.
    pub fn left_margin(&self, em: f64, spacing_y: f64) -> f64 {
        let ticks = self.y.ticks((self.size[1] / spacing_y) as usize + 1);
        ticks.iter().map(|(_, label)| text_width(label, em)).fold(0.0, f64::max) + TICK + GAP
    }

    /// Space [units] below the lower side that ticks and their labels take up.
    pub fn bottom_margin(em: f64) -> f64 {
        TICK + GAP + em
    }
}

/// The lines of a footer within `width` [units]; it is broken at spaces.
pub fn footer_lines(footer: &str, width: f64) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for piece in footer.split_whitespace() {
        match lines.last_mut() {
            // Somebody else's font may be wider.
            Some(line) if text_width(&format!("{line} {piece}"), FOOTER_EM) < 0.94 * width => {
                line.push(' ');
                line.push_str(piece);
            }
            _ => lines.push(piece.to_owned()),
        }
    }
    lines
}

/// Height [units] of a footer of so many lines.
pub fn footer_height(lines: &[String]) -> f64 {
    1.35 * FOOTER_EM * lines.len() as f64
}

/// Puts a footer on the sheet, from `left` and just above `bottom` [units].
pub fn draw_footer(canvas: &mut Canvas, lines: Vec<String>, [left, bottom]: [f64; 2]) {
    let top = bottom - footer_height(&lines);
    for (i, line) in lines.into_iter().enumerate() {
        let base = top + 1.35 * FOOTER_EM * (i as f64 + 0.75);
        canvas.text(Text { colour: FAINT, ..Text::new(line, [left, base], FOOTER_EM, HPos::Left) });
    }
}
