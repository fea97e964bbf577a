//! Line of sight among buildings against an independent library: `geo` cuts the ground plan of a link at the walls.

use geo::{BooleanOps, Line, LineString, MultiLineString, Polygon};
use nalgebra::Point3;
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use skysink_common::airspace;
use skysink_common::channel::{Buildings, Channel, ChannelModel, LinkModel};
use skysink_common::geometry::Position;
use skysink_common::scenario::{Overrides, Scenario};
use std::path::Path;

/// Side of the town [m].
const SIDE_M: f64 = 400.0;

/// Links that are checked.
const LINKS: u32 = 100_000;

/// Heights and lengths [m] that the libraries may disagree by.
const TOLERANCE_M: f64 = 1e-4;

/// The outline of a building: a rotated rectangle, or a star.
fn outline(random: &mut impl Rng) -> Vec<[f64; 2]> {
    let centre = [random.random::<f64>() * SIDE_M, random.random::<f64>() * SIDE_M];
    let count = if random.random::<bool>() { 4 } else { random.random_range(3..10) };
    let turn = random.random::<f64>() * std::f64::consts::TAU;
    let size_m = random.random_range(5.0..60.0);
    let corner = |index: usize| {
        let angle = turn + index as f64 / count as f64 * std::f64::consts::TAU;
        let away_m = if count == 4 { size_m } else { size_m * random.random_range(0.3..1.0) };
        [centre[0] + away_m * angle.cos(), centre[1] + away_m * angle.sin()]
    };
    (0..count).map(corner).collect()
}

/// How far [m] the lowest point of the link above or in the ground plan lies above the top of the building; infinite if
/// the link passes by. `None` where the ground plan is hardly touched.
fn clearance_m(polygon: &Polygon, height_m: f64, sensor: &Point3<f64>, uav: &Point3<f64>) -> Option<f64> {
    let ground = Line::new((sensor.x, sensor.y), (uav.x, uav.y));
    let inside = polygon.clip(&MultiLineString::new(vec![LineString::from(ground)]), false);
    let ends: Vec<_> = inside.0.iter().flat_map(|part| part.0.iter()).collect();
    if ends.is_empty() {
        return Some(f64::INFINITY);
    }
    let along = |x: f64, y: f64| {
        let dx = uav.x - sensor.x;
        let dy = uav.y - sensor.y;
        ((x - sensor.x) * dx + (y - sensor.y) * dy) / (dx * dx + dy * dy)
    };
    let fractions: Vec<f64> = ends.iter().map(|end| along(end.x, end.y)).collect();
    let lengths = fractions.iter().copied().fold(f64::NEG_INFINITY, f64::max)
        - fractions.iter().copied().fold(f64::INFINITY, f64::min);
    if lengths * (uav - sensor).xy().norm() < 100.0 * TOLERANCE_M {
        return None;
    }
    let lowest_m = fractions.iter().map(|part| sensor.z + part * (uav.z - sensor.z)).fold(f64::INFINITY, f64::min);
    Some(lowest_m - height_m)
}

#[test]
fn line_of_sight_agrees_with_an_independent_library_on_100_000_links() {
    let mut random = ChaCha8Rng::seed_from_u64(16);
    let mut seen = 0;
    let mut hidden = 0;
    let mut close = 0;
    for _ in 0..LINKS / 100 {
        let town: Vec<_> =
            (0..random.random_range(1..12)).map(|_| (outline(&mut random), random.random_range(2.0..60.0))).collect();
        let height_m = [0.0, 1.5, 25.0][random.random_range(0..3)];
        let ours = town.iter().map(|(corners, top_m)| (airspace::Polygon::of(corners, false).unwrap(), *top_m));
        let buildings = Buildings::new(ours, height_m);
        let theirs: Vec<_> = town
            .iter()
            .map(|(corners, top_m)| (Polygon::new(LineString::from(corners.clone()), vec![]), *top_m))
            .collect();
        for _ in 0..100 {
            let [x_m, y_m, u_m, v_m] = std::array::from_fn(|_| random.random::<f64>() * SIDE_M);
            // Near and far, low and high, below the sensor node, too.
            let near = random.random_range(0.02..1.0f64).powi(2);
            let uav = Point3::new(x_m + near * (u_m - x_m), y_m + near * (v_m - y_m), random.random_range(3.0..90.0));
            let sensor = Point3::new(x_m, y_m, height_m);
            let clearances: Vec<_> =
                theirs.iter().map(|(plan, top_m)| clearance_m(plan, *top_m, &sensor, &uav)).collect();
            if clearances.iter().any(|clearance| clearance.is_none_or(|clear_m| clear_m.abs() < 100.0 * TOLERANCE_M)) {
                close += 1;
                continue;
            }
            let expected = clearances.into_iter().flatten().all(|clear_m| clear_m > 0.0);
            assert_eq!(buildings.sees(&sensor.xy(), &uav), expected, "{town:?} {sensor} {uav}");
            *if expected { &mut seen } else { &mut hidden } += 1;
        }
    }
    assert!(seen > 50_000 && hidden > 10_000 && close < 2_000, "{seen} seen, {hidden} hidden, {close} too close");
}

/// A building of 20 m by 20 m around (50, 50).
fn block(height_m: f64, sensors_m: f64) -> Buildings {
    let corners = [[40.0, 40.0], [60.0, 40.0], [60.0, 60.0], [40.0, 60.0]];
    Buildings::new(std::iter::once((airspace::Polygon::of(&corners, false).unwrap(), height_m)), sensors_m)
}

#[test]
fn a_building_blocks_sight_behind_below_and_inside() {
    let sees = |height_m, x_m, z_m| block(height_m, 0.0).sees(&Position::new(10.0, 50.0), &Point3::new(x_m, 50.0, z_m));
    assert!(sees(30.0, 39.0, 5.0), "in front of it");
    // The ray to (90, 50, z) leaves the building at x = 60, five eighths of its length; it enters it at three eighths.
    assert!(!sees(30.0, 90.0, 79.9) && sees(30.0, 90.0, 80.1), "over its front edge: 30 m at 3/8 of the way");
    assert!(!sees(30.0, 50.0, 30.0) && !sees(30.0, 50.0, 35.0), "above it, the walls are in the way");
    assert!(!block(30.0, 0.0).sees(&Position::new(50.0, 50.0), &Point3::new(50.0, 50.0, 90.0)), "from within");
    assert!(block(30.0, 31.0).sees(&Position::new(50.0, 50.0), &Point3::new(90.0, 50.0, 31.0)), "from its roof");
    assert!(block(30.0, 0.0).sees(&Position::new(10.0, 40.0), &Point3::new(90.0, 40.0, 5.0)), "along its wall");
}

/// The channel of a town with one building, and these keys.
fn channel(keys: &str) -> Channel {
    let text = format!(
        "name = 'x'\n[link]\nmodel = 'buildings'\ncomm_radius_m = 60.0\n{keys}\n\
         [[area.building]]\nheight_m = 30.0\npolygon_m = [[40.0, 40.0], [60.0, 40.0], [60.0, 60.0], [40.0, 60.0]]\n\
         [uav]\nstart_m = [5.0, 5.0]\n"
    );
    let scenario = Scenario::parse(&text, Path::new("x.toml"), Overrides::default()).unwrap();
    assert_eq!(scenario.link.model, LinkModel::Buildings);
    Channel::of(&scenario.link)
}

#[test]
fn a_link_has_the_rate_of_its_state_and_the_mean_of_its_shadowing() {
    let sensor = Position::new(10.0, 50.0);
    let uav = Point3::new(35.0, 50.0, 20.0);
    let behind = Point3::new(65.0, 50.0, 20.0);
    let steady = channel("");
    let model = steady.line_of_sight().unwrap();
    let [seen, hidden] = [uav, behind].map(|uav| steady.uplink(1.0, &sensor, &uav));
    assert_eq!((seen.in_sight, hidden.in_sight, steady.is_random()), (true, false, false));
    assert_eq!(steady.expected_rate_bps(&seen), model.los_rate_bps(625.0, 20.0));
    assert_eq!(steady.expected_rate_bps(&hidden), model.nlos_rate_bps(55.0 * 55.0, 20.0));
    let shadowed = channel("shadowing_db = [2.0, 6.0]\n");
    let streams = skysink_common::random::Streams::new(3);
    for (uplink, in_sight) in [(seen, true), (hidden, false)] {
        let draws: Vec<_> = (0..40_000).map(|slot| shadowed.draw(&uplink, &streams, slot, 1)).collect();
        assert!(draws.iter().all(|draw| draw.line_of_sight == in_sight));
        let mean_bps = draws.iter().map(|draw| draw.rate_bps).sum::<f64>() / draws.len() as f64;
        let expected_bps = shadowed.expected_rate_bps(&uplink);
        assert!((mean_bps / expected_bps - 1.0).abs() < 0.01, "{mean_bps}, not {expected_bps}");
        assert!(draws.iter().all(|draw| draw.rate_bps <= shadowed.best_rate_bps(&uplink)));
        let best_bps = |slot| shadowed.best_drawn_rate_bps(&uplink, &streams, slot, 1);
        assert!(draws.iter().zip(0..).all(|(draw, slot)| draw.rate_bps <= best_bps(slot)));
    }
}
