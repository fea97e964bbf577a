//! Colours of the scene, and the colour scales of queue fill, link rate and probability of line of sight.

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
/// Body of the UAV.
pub const UAV: Rgb = [245, 246, 250];
/// Rotors of the UAV.
pub const ROTOR: Rgb = [120, 200, 255];
/// Heading of the UAV.
pub const HEADING: Rgb = [255, 70, 70];
/// Flown path.
pub const TRAIL: Rgb = [74, 144, 255];
/// Ground below the whole flown path.
pub const TRACK: Rgb = [44, 70, 112];
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
pub const CANDIDATE: Rgb = [190, 120, 35];
/// The chosen candidate circle.
pub const CHOSEN: Rgb = [255, 170, 40];
/// Loss, and holding.
pub const LOSS: Rgb = [255, 85, 85];
/// Deliveries, and serving.
pub const DELIVERY: Rgb = [60, 200, 105];
/// The fullest queue.
pub const FULLEST: Rgb = [200, 110, 255];
/// The mean queue.
pub const MEAN: Rgb = [90, 160, 255];
/// Wall-clock figures, and flying in transit.
pub const CLOCK: Rgb = [255, 185, 60];
/// In line of sight. With [`BLOCKED`] a pair that the colour-blind tell apart: it differs in blue against orange.
pub const SIGHT: Rgb = [105, 205, 255];
/// Out of line of sight.
pub const BLOCKED: Rgb = [255, 120, 20];
/// Missions that are compared: those of Okabe and Ito that are seen on a dark ground, which the colour-blind tell apart.
pub const COMPARED: [Rgb; 7] =
    [[230, 159, 0], [86, 180, 233], [0, 190, 140], [240, 228, 66], [213, 94, 0], [204, 121, 167], [200, 200, 200]];
/// What the viewer missed.
pub const MISSED: Rgb = [130, 135, 145];

/// Colour of a queue fill, 0 (blue) over 0.5 (green) to 1 (red): Turbo (Mikhailov, 2019) without its near-black ends.
pub(crate) fn of_fill(fill: f64) -> Rgb {
    const FIRST: f64 = 0.10;
    const LAST: f64 = 0.90;
    colorous::TURBO.eval_continuous(FIRST + (LAST - FIRST) * fill).into_array()
}

/// Colour of a probability of line of sight, 0 (violet) over 0.5 (teal) to 1 (yellow): Viridis, as in the slice.
pub(crate) fn of_probability(probability: f64) -> Rgb {
    colorous::VIRIDIS.eval_continuous(probability).into_array()
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

    #[test]
    fn queues_turn_from_blue_over_green_to_red() {
        let [empty, half, full] = [0.0, 0.5, 1.0].map(of_fill);
        assert!(empty[2] > empty[0] && empty[2] > empty[1], "{empty:?}");
        assert!(half[1] > half[0] && half[1] > half[2], "{half:?}");
        assert!(full[0] > full[1] && full[0] > full[2], "{full:?}");
    }

    #[test]
    fn probabilities_turn_from_violet_over_teal_to_yellow() {
        let near = |found: Rgb, map: Rgb| std::iter::zip(found, map).all(|(a, b)| a.abs_diff(b) <= 8);
        for (probability, map) in [(0.0, [68, 1, 84]), (0.5, [33, 145, 140]), (1.0, [253, 231, 37])] {
            assert!(near(of_probability(probability), map), "{probability}: {:?}", of_probability(probability));
        }
    }

    #[test]
    fn a_rate_beyond_the_range_takes_the_colour_of_its_end() {
        let range_bps = 10.0..=20.0;
        assert_eq!(of_rate(5.0, &range_bps), [16, 120, 70]);
        assert_eq!(of_rate(25.0, &range_bps), [205, 255, 150]);
        assert_eq!(of_rate(15.0, &(15.0..=15.0)), [205, 255, 150]);
    }
}
