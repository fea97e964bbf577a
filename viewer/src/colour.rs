//! Colours of the scene, and its colour scales. Each hue means one thing: blue over grey to yellow how full a queue is,
//! red loss, white the UAV and where it has flown, magenta the plan, cyan and its shades the range, green what is
//! delivered; light blue and orange a link in line of sight and one that is blocked.

use std::ops::RangeInclusive;

/// Red, green, blue: what rerun takes as a colour.
pub type Rgb = [u8; 3];

/// Behind the scene.
pub const BACKGROUND: Rgb = [12, 13, 17];
/// The ground of the area.
pub const GROUND: Rgb = [30, 33, 40];
/// Grid and frame of the area.
pub const GRID: Rgb = [62, 67, 78];
/// Writing in the scene.
pub const WRITING: Rgb = [190, 196, 206];
/// Body and heading of the UAV.
pub const UAV: Rgb = [245, 246, 250];
/// Rotors of the UAV.
pub const ROTOR: Rgb = [170, 175, 185];
/// Flown path.
pub const TRAIL: Rgb = [225, 228, 235];
/// The same on the ground.
pub const TRACK: Rgb = [170, 175, 185];
/// Planned waypoint, and the path to it.
pub const PLAN: Rgb = [230, 80, 240];
/// The path planned after it, near and far: fainter, for it will change.
pub const PATH: [Rgb; 2] = [[205, 84, 222], [112, 52, 128]];
/// Waypoints on that path, near and far.
pub const STOP: [Rgb; 2] = [[236, 150, 245], [138, 76, 152]];
/// Rim of the coverage circle.
pub const COVERAGE: Rgb = [40, 205, 220];
/// Ground in the coverage circle.
pub const COVERED: Rgb = [16, 58, 66];
/// Candidate circles.
pub const CANDIDATE: Rgb = [150, 60, 165];
/// The chosen candidate circle.
pub const CHOSEN: Rgb = [235, 110, 245];
/// Loss.
pub const LOSS: Rgb = [255, 60, 50];
/// Deliveries, and serving.
pub const DELIVERY: Rgb = [60, 200, 105];
/// Flying in transit.
pub const TRANSIT: Rgb = [135, 130, 255];
/// Holding.
pub const HOLD: Rgb = [225, 228, 235];
/// Wall-clock figures.
pub const CLOCK: Rgb = [160, 165, 175];
/// In line of sight. With [`BLOCKED`] a pair that the colour-blind tell apart: it differs in blue against orange.
pub const SIGHT: Rgb = [105, 205, 255];
/// Out of line of sight.
pub const BLOCKED: Rgb = [255, 120, 20];
/// Missions that are compared: those of Okabe and Ito that are seen on a dark ground, which the colour-blind tell
/// apart.
pub const COMPARED: [Rgb; 7] =
    [[230, 159, 0], [86, 180, 233], [0, 190, 140], [240, 228, 66], [213, 94, 0], [204, 121, 167], [200, 200, 200]];
/// The fullest queue, in curves: the yellow end of the queue scale.
pub const FULLEST: Rgb = [253, 234, 69];
/// The mean queue, in curves: the middle of the queue scale.
pub const FILL_MEAN: Rgb = [140, 140, 130];
/// What the viewer missed, and marks in plots.
pub const MISSED: Rgb = [110, 114, 124];

/// Colour of a queue fill, 0 (blue) over 0.5 (grey) to 1 (yellow): Cividis (Nunez, Anderton and Renslow, 2018), made
/// for the colour-blind, its dark end lightened to be seen on a dark ground.
pub(crate) fn of_fill(fill: f64) -> Rgb {
    const FIRST: f64 = 0.2;
    let lighter = 1.75 - 0.75 * fill;
    let map = colorous::CIVIDIS.eval_continuous(FIRST + (1.0 - FIRST) * fill).into_array();
    map.map(|channel| (f64::from(channel) * lighter).round().min(255.0) as u8)
}

/// Colour of a loss, 0 (dark red) to 1 (pale): Reds (ColorBrewer), from the dark end.
pub(crate) fn of_loss(fraction: f64) -> Rgb {
    const LAST: f64 = 0.85;
    colorous::REDS.eval_continuous(LAST - 0.70 * fraction).into_array()
}

/// Colour of how long ago a place was in range, 0 (just now, pale) to 1 (long ago, deep blue): GnBu (ColorBrewer).
pub(crate) fn of_age(fraction: f64) -> Rgb {
    const FIRST: f64 = 0.1;
    colorous::GREEN_BLUE.eval_continuous(FIRST + (1.0 - FIRST) * fraction).into_array()
}

/// Colour of an error, −1 (too low, orange) over 0 (white) to 1 (too high, purple): PuOr (ColorBrewer).
pub(crate) fn of_error(error: f64) -> Rgb {
    colorous::PURPLE_ORANGE.eval_continuous(0.5 - 0.34 * error).into_array()
}

/// Colour of a probability of line of sight, 0 (black) to 1 (white), as in the slice.
pub(crate) fn of_probability(probability: f64) -> Rgb {
    [(255.0 * probability).round() as u8; 3]
}

/// Colour of a link rate within the range of rates that are possible: dark green for the lowest, pale green for the
/// highest.
pub(crate) fn of_rate(rate_bps: f64, range_bps: &RangeInclusive<f64>) -> Rgb {
    const LOWEST: Rgb = [16, 120, 70];
    const HIGHEST: Rgb = [205, 255, 150];
    let span_bps = range_bps.end() - range_bps.start();
    let fraction = if span_bps > 0.0 { ((rate_bps - range_bps.start()) / span_bps).clamp(0.0, 1.0) } else { 1.0 };
    between(LOWEST, HIGHEST, fraction)
}

/// The colour between two others, at a fraction from 0 to 1.
pub(crate) fn between(from: Rgb, to: Rgb, fraction: f64) -> Rgb {
    let [from, to] = [from, to].map(|colour| colour.map(f64::from));
    std::array::from_fn(|channel| (from[channel] + (to[channel] - from[channel]) * fraction).round() as u8)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Relative luminance, without the curve of the screen.
    fn brightness([red, green, blue]: Rgb) -> f64 {
        0.2126 * f64::from(red) + 0.7152 * f64::from(green) + 0.0722 * f64::from(blue)
    }

    #[test]
    fn queues_turn_from_blue_to_yellow_and_brighter() {
        let [empty, half, full] = [0.0, 0.5, 1.0].map(of_fill);
        assert!(empty[2] > empty[0] && empty[2] > empty[1], "{empty:?}");
        assert!(full[0] > 200 && full[1] > 200 && full[2] < 120, "{full:?}");
        assert!(brightness(empty) < brightness(half) && brightness(half) < brightness(full));
    }

    #[test]
    fn losses_turn_brighter_and_ages_darker() {
        assert!(brightness(of_loss(0.0)) < brightness(of_loss(1.0)));
        assert!(brightness(of_age(0.0)) > brightness(of_age(1.0)));
    }

    #[test]
    fn errors_turn_from_orange_over_white_to_purple() {
        let [low, none, high] = [-1.0, 0.0, 1.0].map(of_error);
        assert!(low[0] > low[1] && low[1] > low[2], "{low:?}");
        assert!(none.iter().all(|&channel| channel > 230), "{none:?}");
        assert!(high[2] > high[1], "{high:?}");
    }

    #[test]
    fn probabilities_turn_from_black_to_white() {
        assert_eq!([0.0, 1.0].map(of_probability), [[0; 3], [255; 3]]);
    }

    #[test]
    fn a_rate_beyond_the_range_takes_the_colour_of_its_end() {
        let range_bps = 10.0..=20.0;
        assert_eq!(of_rate(5.0, &range_bps), [16, 120, 70]);
        assert_eq!(of_rate(25.0, &range_bps), [205, 255, 150]);
        assert_eq!(of_rate(15.0, &(15.0..=15.0)), [205, 255, 150]);
    }
}
