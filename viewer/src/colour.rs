//! Colours and colour scales of the scene. Each hue has one meaning: blue to grey to yellow for the queue fill, red for
//! loss, white for the UAV and its flown path, magenta for the plan, cyan for the range, green for deliveries, light
//! blue and orange for links with and without line of sight. A map in degrees has colours of its own, because its
//! background may be light.

use std::ops::RangeInclusive;

use skysink_common::interpolation::interpolate;

/// Red, green, blue.
pub type Rgb = [u8; 3];

/// Background of the scene.
pub const BACKGROUND: Rgb = [12, 13, 17];
/// The ground of the area.
pub const GROUND: Rgb = [30, 33, 40];
/// Grid and frame of the area.
pub const GRID: Rgb = [62, 67, 78];
/// Text in the scene.
pub const WRITING: Rgb = [190, 196, 206];
/// Body and heading of the UAV.
pub const UAV: Rgb = [245, 246, 250];
/// UAVs after the first, in turn.
const UAVS: [Rgb; 7] = [
    [94, 201, 232],
    [255, 176, 77],
    [170, 227, 108],
    [240, 130, 190],
    [178, 150, 255],
    [255, 231, 110],
    [120, 230, 200],
];

/// The colour of the UAV number `uav`.
#[must_use]
pub fn of_uav(uav: usize) -> Rgb {
    uav.checked_sub(1).map_or(UAV, |other| UAVS[other % UAVS.len()])
}

/// Sensor nodes on a map in degrees.
pub const MAP_SENSOR: Rgb = [40, 110, 225];
/// Border of the area on a map in degrees.
pub const MAP_AREA: Rgb = [125, 130, 140];
/// The first UAV on a map in degrees.
const MAP_UAV: Rgb = [205, 45, 200];

/// The colour of the UAV number `uav` on a map in degrees.
#[must_use]
pub fn on_map(uav: usize) -> Rgb {
    if uav == 0 { MAP_UAV } else { of_uav(uav) }
}

/// Rotors of the UAV.
pub const ROTOR: Rgb = [170, 175, 185];
/// Flown path.
pub const TRAIL: Rgb = [225, 228, 235];
/// Flown path on the ground.
pub const TRACK: Rgb = [170, 175, 185];
/// Planned waypoint, and the path to it.
pub const PLAN: Rgb = [230, 80, 240];
/// The planned path after the waypoint, near and far: fainter, because it may change.
pub const PATH: [Rgb; 2] = [[205, 84, 222], [112, 52, 128]];
/// Waypoints on that path, near and far.
pub const STOP: [Rgb; 2] = [[236, 150, 245], [138, 76, 152]];
/// Border of the coverage circle.
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
/// What arrives at random.
pub const BURST: Rgb = [120, 235, 255];
/// Flying to a waypoint without serving there.
pub const FLY: Rgb = [70, 130, 200];
/// Flying in transit.
pub const TRANSIT: Rgb = [135, 130, 255];
/// Not at the waypoint by the end of a slot.
pub const EN_ROUTE: Rgb = [205, 150, 120];
/// Holding.
pub const HOLD: Rgb = [225, 228, 235];
/// No-fly zones, and the boundary of the area.
pub const NO_FLY: Rgb = [225, 90, 80];
/// Buildings.
pub const BUILDING: Rgb = [125, 130, 140];
/// Edges of buildings.
pub const EDGE: Rgb = [200, 205, 215];
/// Charging, the energy in the battery, and the base.
pub const CHARGE: Rgb = [150, 220, 90];
/// An empty battery of a sensor node.
const EMPTY: Rgb = [150, 60, 40];
/// Crosses over dead sensor nodes.
pub const DEAD: Rgb = [235, 235, 240];
/// Returning to the base.
pub const RETURN: Rgb = [240, 175, 60];
/// Wall-clock figures.
pub const CLOCK: Rgb = [160, 165, 175];
/// Line of sight. Blue and orange, as in [`BLOCKED`], are distinguishable for colour-blind readers.
pub const SIGHT: Rgb = [105, 205, 255];
/// No line of sight.
pub const BLOCKED: Rgb = [255, 120, 20];
/// Missions of a comparison: the colours of the palette of Okabe and Ito that are visible on a dark background. The
/// palette is suited for colour-blind readers.
pub const COMPARED: [Rgb; 7] =
    [[230, 159, 0], [86, 180, 233], [0, 190, 140], [240, 228, 66], [213, 94, 0], [204, 121, 167], [200, 200, 200]];
/// The fullest queue, in curves: the yellow end of the queue scale.
pub const FULLEST: Rgb = [253, 234, 69];
/// The mean queue, in curves: the middle of the queue scale.
pub const FILL_MEAN: Rgb = [140, 140, 130];
/// Missed slots, and reference lines in plots.
pub const MISSED: Rgb = [110, 114, 124];

/// Colour of a queue fill, from 0 (blue) over 0.5 (grey) to 1 (yellow): Cividis (Nunez, Anderton and Renslow, 2018),
/// which is suited for colour-blind readers. The dark end is lightened for a dark background.
pub(crate) fn of_fill(fill: f64) -> Rgb {
    const FIRST: f64 = 0.2;
    let lighter = 1.75 - 0.75 * fill;
    let map = colorous::CIVIDIS.eval_continuous(FIRST + (1.0 - FIRST) * fill).into_array();
    map.map(|channel| (f64::from(channel) * lighter).round().min(255.0) as u8)
}

/// Colour of a loss, from 0 (dark red) to 1 (pale): Reds (ColorBrewer), reversed.
pub(crate) fn of_loss(fraction: f64) -> Rgb {
    const LAST: f64 = 0.85;
    colorous::REDS.eval_continuous(LAST - 0.70 * fraction).into_array()
}

/// Colour of the time since a cell was in range, from 0 (now, pale) to 1 (long ago, deep blue): GnBu (ColorBrewer).
pub(crate) fn of_age(fraction: f64) -> Rgb {
    const FIRST: f64 = 0.1;
    colorous::GREEN_BLUE.eval_continuous(FIRST + (1.0 - FIRST) * fraction).into_array()
}

/// Colour of an error, from −1 (too low, orange) over 0 (white) to 1 (too high, purple): PuOr (ColorBrewer).
pub(crate) fn of_error(error: f64) -> Rgb {
    colorous::PURPLE_ORANGE.eval_continuous(0.5 - 0.34 * error).into_array()
}

/// Colour of the fraction of sensor nodes in sight, from 0 (black) to 1 (white), as on the ground among buildings.
pub(crate) fn of_sight(fraction: f64) -> Rgb {
    [(255.0 * fraction).round() as u8; 3]
}

/// Colour of a link rate in the range of possible rates, from dark green for the lowest to pale green for the highest.
pub(crate) fn of_rate(rate_bps: f64, range_bps: &RangeInclusive<f64>) -> Rgb {
    const LOWEST: Rgb = [16, 120, 70];
    const HIGHEST: Rgb = [205, 255, 150];
    let span_bps = range_bps.end() - range_bps.start();
    let fraction = if span_bps > 0.0 { ((rate_bps - range_bps.start()) / span_bps).clamp(0.0, 1.0) } else { 1.0 };
    between(LOWEST, HIGHEST, fraction)
}

/// Colour of the energy left in a sensor node, from 0 (brown) to 1 (light green).
pub(crate) fn of_energy(fraction: f64) -> Rgb {
    between(EMPTY, CHARGE, fraction)
}

/// Colour of an SNR that is heard, from dim at the lower end of [`HEARD_DB`] to bright at the upper.
pub(crate) fn of_snr(snr_db: f32) -> Rgb {
    const DIM: Rgb = [74, 82, 100];
    let [lowest_db, highest_db] = HEARD_DB;
    between(DIM, UAV, ((f64::from(snr_db) - lowest_db) / (highest_db - lowest_db)).clamp(0.0, 1.0))
}

/// Ends of the colour scale of SNRs [dB].
pub(crate) const HEARD_DB: [f64; 2] = [-10.0, 30.0];

/// Interpolates between two colours, at a fraction from 0 to 1.
pub(crate) fn between(from: Rgb, to: Rgb, fraction: f64) -> Rgb {
    let [from, to] = [from, to].map(|colour| colour.map(f64::from));
    std::array::from_fn(|channel| interpolate(from[channel], to[channel], fraction).round() as u8)
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
        assert_eq!([0.0, 1.0].map(of_sight), [[0; 3], [255; 3]]);
    }

    #[test]
    fn a_rate_beyond_the_range_takes_the_colour_of_its_end() {
        let range_bps = 10.0..=20.0;
        assert_eq!(of_rate(5.0, &range_bps), [16, 120, 70]);
        assert_eq!(of_rate(25.0, &range_bps), [205, 255, 150]);
        assert_eq!(of_rate(15.0, &(15.0..=15.0)), [205, 255, 150]);
    }
}
