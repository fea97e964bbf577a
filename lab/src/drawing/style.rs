//! The styles of the series of a chart, distinguishable with and without colour.

use skysink_planner::strategies::{
    STRATEGIES, exact, gfs, horizon, max_age_first, rfs, round_robin, tour, uts, uts_wide,
};
use skysink_planner::strategy::Registered;
use svg::node::element::{Group, Path};

use super::page::{SAMPLE, line, stroke};

/// The style of a series.
#[derive(Debug, Clone, Copy)]
pub struct SeriesStyle {
    /// From the palette of Okabe and Ito, which is suited for colour-blind readers. The colours also differ in
    /// lightness.
    pub colour: &'static str,
    /// Width [units] of the line. Later series are thinner, so that they do not hide earlier ones.
    width: f64,
    /// Lengths [units] of dash, gap, dash, gap ..., or [`SOLID`].
    dashes: &'static str,
    /// Marker at every point, as relative SVG path data. Markers have different sizes and are open or small, so that
    /// all are visible where curves coincide.
    pub marker: &'static str,
}

/// The styles of [`STYLED`], of the best known loss, and of the lower bound.
static SERIES: [SeriesStyle; 11] = [
    series("#E69F00", 6.0, SOLID, "m-9,0a9,9 0 1,0 18,0a9,9 0 1,0 -18,0z"), // circle
    series("#009E73", 5.0, "30 14", "m-15.5,-15.5h31v31h-31z"),             // square
    series("#0072B2", 3.5, SOLID, "m0,-26l22.5,39h-45z"),                   // triangle
    series("#D55E00", 4.0, "20 8 4 8", "m-12,-12l24,24m0,-24l-24,24"),      // cross
    series("#000000", 4.0, "5 7", "m-4,0a4,4 0 1,0 8,0a4,4 0 1,0 -8,0m1.5,0h5"), // dot
    series("#56B4E9", 4.0, SOLID, "m0,-15l15,15l-15,15l-15,-15z"),          // diamond
    series("#999999", 4.0, "10 6", "m-13,0h26m-13,-13v26"),                 // plus
    series("#B8A400", 4.0, "18 6", "m0,20l17.3,-30h-34.6z"),                // nabla
    series("#CC79A7", 6.0, SOLID, "m0,-17v34m-14.7,-25.5l29.4,17m0,-17l-29.4,17"), // star
    series("#662255", 2.0, SOLID, ""),
    series("#555555", 3.0, "3 6", ""),
];

/// The strategies with the first styles, in their order.
const STYLED: [&Registered; 9] = [
    &rfs::STRATEGY,
    &gfs::STRATEGY,
    &uts::STRATEGY,
    &uts_wide::STRATEGY,
    &exact::STRATEGY,
    &tour::STRATEGY,
    &round_robin::STRATEGY,
    &max_age_first::STRATEGY,
    &horizon::STRATEGY,
];

/// The index of the style of the best known loss. Those of the bounds follow.
pub const BEST_KNOWN_STYLE: usize = STYLED.len();

/// The index of the style for a strategy's curve, the same in all charts; `place` is that of the strategy in the sweep,
/// for one that is not in the registry.
pub fn style_of(name: &str, place: usize) -> usize {
    let is_named = |strategy: &&Registered| strategy.name == name;
    let unstyled = || STRATEGIES.iter().position(is_named).unwrap_or(STRATEGIES.len() + place);
    STYLED.iter().position(is_named).unwrap_or_else(|| SERIES.len() + unstyled())
}

/// No dashes.
const SOLID: &str = "none";

/// The number of styles with a marker, which come first in [`SERIES`].
const MARKED: usize = 9;

const fn series(colour: &'static str, width: f64, dashes: &'static str, marker: &'static str) -> SeriesStyle {
    SeriesStyle { colour, width, dashes, marker }
}

impl SeriesStyle {
    /// The style of the series with this index. After the last of [`SERIES`], colours and lines repeat with other
    /// markers.
    pub fn of(index: usize) -> Self {
        let style = SERIES[index % SERIES.len()];
        match index / SERIES.len() {
            0 => style,
            repetition => Self { marker: SERIES[(index + 2 * repetition) % MARKED].marker, ..style },
        }
    }

    /// The line through these points [units].
    pub fn curve(&self, points: &[[f64; 2]]) -> Path {
        stroke(line(points.iter().copied()), self.width, self.colour).set("stroke-dasharray", self.dashes)
    }

    /// A line with a marker, for the legend.
    pub fn sample(&self) -> Group {
        let curve = self.curve(&[[0.0, 0.0], [SAMPLE, 0.0]]);
        Group::new().add(curve).add(self.markers(&[[SAMPLE / 2.0, 0.0]]))
    }

    /// The markers at these points [units].
    pub fn markers(&self, points: &[[f64; 2]]) -> Path {
        let marker = |[x, y]: &[f64; 2]| format!("M{x:.1},{y:.1}{}", self.marker);
        stroke(points.iter().map(marker).collect::<String>(), 3.0, self.colour)
    }
}

/// Colour of a fraction: cividis (Nuñez, Anderton and Renslow, 2018) from light (0) to dark (1).
///
/// Its lightness is monotonic, so that it works in grey. High fractions are dark.
pub fn shade(fraction: f64) -> String {
    format!("#{:x}", colorous::CIVIDIS.eval_continuous(1.0 - fraction.clamp(0.0, 1.0)))
}
