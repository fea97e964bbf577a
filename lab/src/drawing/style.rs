//! The styles of the series of a chart, distinguishable with and without colour.

use std::borrow::Cow;

use skysink_planner::strategies::{
    best_of, drift_plus_penalty, edf, exact, gfs, horizon, hover, look_ahead, max_age_first, max_weight, mes, rfs,
    round_robin, tour, uts, uts_wide, whittle,
};
use skysink_planner::strategy::Registered;
use svg::node::element::{Group, Path};

use super::page::{SAMPLE, line, stroke};

/// The style of a series.
#[derive(Debug, Clone)]
pub struct SeriesStyle {
    /// From the palette of Okabe and Ito, which is suited for colour-blind readers. The colours also differ in
    /// lightness.
    pub colour: Cow<'static, str>,
    /// Width [units] of the line. Later series are thinner, so that they do not hide earlier ones.
    width: f64,
    /// Lengths [units] of dash, gap, dash, gap ..., or [`SOLID`].
    dashes: &'static str,
    /// Marker at every point, as relative SVG path data. Markers have different sizes and are open or small, so that
    /// all are visible where curves coincide.
    pub marker: Cow<'static, str>,
    /// Size of lines and markers, relative to that on a screen.
    scale: f64,
}

/// The styles of the best known loss and of its lower bounds.
static BOUNDS: [SeriesStyle; 3] =
    [series("#662255", 2.0, SOLID, ""), series("#555555", 3.0, "3 6", ""), series("#8C8C8C", 3.0, "12 4", "")];

/// The styles of the strategies of the registry.
static STYLED: [(&Registered, SeriesStyle); 17] = [
    (&rfs::STRATEGY, series("#E69F00", 6.0, SOLID, "m-9,0a9,9 0 1,0 18,0a9,9 0 1,0 -18,0z")), // circle
    (&gfs::STRATEGY, series("#009E73", 5.0, "30 14", "m-15.5,-15.5h31v31h-31z")),             // square
    (&uts::STRATEGY, series("#0072B2", 3.5, SOLID, "m0,-26l22.5,39h-45z")),                   // triangle
    (&uts_wide::STRATEGY, series("#D55E00", 4.0, "20 8 4 8", "m-12,-12l24,24m0,-24l-24,24")), // cross
    (&exact::STRATEGY, series("#000000", 4.0, "5 7", "m-4,0a4,4 0 1,0 8,0a4,4 0 1,0 -8,0m1.5,0h5")), // dot
    (&tour::STRATEGY, series("#56B4E9", 4.0, SOLID, "m0,-15l15,15l-15,15l-15,-15z")),         // diamond
    (&round_robin::STRATEGY, series("#999999", 4.0, "10 6", "m-13,0h26m-13,-13v26")),         // plus
    (&max_age_first::STRATEGY, series("#B8A400", 4.0, "18 6", "m0,20l17.3,-30h-34.6z")),      // nabla
    (&horizon::STRATEGY, series("#CC79A7", 6.0, SOLID, "m0,-17v34m-14.7,-25.5l29.4,17m0,-17l-29.4,17")), // star
    (&edf::STRATEGY, series("#332288", 4.0, "24 6 6 6", "m-7,-18h14v36h-14z")),               // upright bar
    (&mes::STRATEGY, series("#88CCEE", 4.0, SOLID, "m-18,-7h36v14h-36z")),                    // lying bar
    (&max_weight::STRATEGY, series("#117733", 4.0, "8 8", "m-15,-9h30l-15,24z")),             // wedge
    (&drift_plus_penalty::STRATEGY, series("#882255", 4.0, "16 4 4 4 4 4", "m-14,-14h28l-28,28h28z")), // hourglass
    (&whittle::STRATEGY, series("#AA4499", 4.0, "26 10", "m-16,0h32m-24,-14v28m16,-28v28")),  // hash
    (&look_ahead::OFFLINE, series("#44AA99", 4.0, SOLID, "m-16,8l16,-16l16,16")),             // roof
    (&hover::STRATEGY, series("#EE3377", 5.0, "14 8", "m-16,-8l16,16l16,-16")),               // valley
    (&best_of::STRATEGY, series("#661100", 4.0, "12 4 4 4", "m-18,0h36m-18,-18v36m-9,-27l18,18m-18,0l18,-18")), // rose
];

/// The styles of the first strategies that are not in the registry.
static OTHERS: [SeriesStyle; 2] = [
    series("#663300", 4.0, SOLID, "m-12,0a12,12 0 1,0 24,0a12,12 0 1,0 -24,0m0,0h24"), // circle with a bar
    series("#99B300", 4.0, "4 4 12 4", "m-14,-8h28m-28,16h28"),                        // two bars
];

/// The index of the style of the best known loss. Those of the bounds follow.
pub const BEST_KNOWN_STYLE: usize = 0;

/// The index of the first style of curves that are not strategies of the registry.
pub const FIRST_STYLE: usize = BOUNDS.len();

/// The indices of the styles for the curves of these strategies: that of a strategy of the registry is the same in all
/// charts, the others get those after it, in their order.
pub fn styles_of(names: &[String]) -> Vec<usize> {
    let mut others = STYLED.len()..;
    let place = |name: &String| STYLED.iter().position(|(strategy, _)| strategy.name == name);
    let style = |name| FIRST_STYLE + place(name).or_else(|| others.next()).expect("there is no last one");
    names.iter().map(style).collect()
}

/// No dashes.
const SOLID: &str = "none";

/// Size of markers and widths of lines in print, relative to those on a screen.
const IN_PRINT: f64 = 0.55;

const fn series(colour: &'static str, width: f64, dashes: &'static str, marker: &'static str) -> SeriesStyle {
    SeriesStyle { colour: Cow::Borrowed(colour), width, dashes, marker: Cow::Borrowed(marker), scale: 1.0 }
}

impl SeriesStyle {
    /// The style of the series with this index, for print or for a screen. No two indices have the same colour or the
    /// same marker, except those of the bounds, which have none.
    pub fn of(index: usize, is_print: bool) -> Self {
        let style = match index.checked_sub(FIRST_STYLE) {
            None => BOUNDS[index].clone(),
            Some(place) => {
                let listed = STYLED.iter().map(|(_, style)| style).chain(&OTHERS).nth(place);
                listed.cloned().unwrap_or_else(|| Self::made(place - STYLED.len() - OTHERS.len()))
            }
        };
        Self { scale: if is_print { IN_PRINT } else { 1.0 }, ..style }
    }

    /// A style after the last of [`OTHERS`]: a hue of its own, and a polygon with a corner more.
    fn made(number: usize) -> Self {
        let hue = (137.508 * number as f64).rem_euclid(360.0); // the golden angle
        let sides = number + 5;
        // Each side turns by the same angle.
        let side = |side: usize| {
            let angle = std::f64::consts::TAU * (side as f64 + 0.5) / sides as f64;
            let length = 30.0 * (std::f64::consts::PI / sides as f64).sin();
            format!("l{:.2},{:.2}", length * angle.cos(), length * angle.sin())
        };
        let sides: String = (0..sides).map(side).collect();
        let colour = format!("hsl({hue:.1}, 70%, {}%)", 30 + 12 * (number % 3));
        Self { colour: colour.into(), marker: format!("m0,-15{sides}z").into(), ..series("", 3.0, SOLID, "") }
    }

    /// The line through these points [units].
    pub fn curve(&self, points: &[[f64; 2]]) -> Path {
        stroke(line(points.iter().copied()), self.scale * self.width, &self.colour).set("stroke-dasharray", self.dashes)
    }

    /// A line with a marker, for the legend.
    pub fn sample(&self) -> Group {
        let curve = self.curve(&[[0.0, 0.0], [SAMPLE, 0.0]]);
        Group::new().add(curve).add(self.markers(&[[SAMPLE / 2.0, 0.0]]))
    }

    /// The markers at these points [units].
    pub fn markers(&self, points: &[[f64; 2]]) -> Path {
        let marker = |[x, y]: &[f64; 2]| format!("M{:.1},{:.1}{}", x / self.scale, y / self.scale, self.marker);
        let markers = stroke(points.iter().map(marker).collect::<String>(), 3.0, &self.colour);
        if self.scale == 1.0 { markers } else { markers.set("transform", format!("scale({})", self.scale)) }
    }
}

/// Colour of a fraction: cividis (Nuñez, Anderton and Renslow, 2018) from light (0) to dark (1).
///
/// Its lightness is monotonic, so that it works in grey. High fractions are dark.
pub fn shade(fraction: f64) -> String {
    format!("#{:x}", colorous::CIVIDIS.eval_continuous(1.0 - fraction.clamp(0.0, 1.0)))
}
