//! The airspace against independent libraries: `geo` for polygons, `petgraph` for shortest paths.

use std::path::Path;

use geo::{Contains, Coord, Distance, Euclidean, Line, LineString, Point, Polygon, Relate};
use petgraph::algo::dijkstra;
use petgraph::graph::UnGraph;
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use skysink_common::geometry::{Position, length_m};
use skysink_common::scenario::{Overrides, Scenario};

/// Side of the area [m].
const SIDE_M: f64 = 1_000.0;

/// Reach of a slot [m].
const REACH_M: f64 = 30.0;

type Corners = Vec<[f64; 2]>;

/// A polygon around a point, star-shaped, so that it does not cross itself.
fn star(random: &mut impl Rng, centre: [f64; 2], radius_m: f64) -> Corners {
    let count = random.random_range(3..12);
    let turn = random.random::<f64>() * std::f64::consts::TAU;
    let corner = |index: usize| {
        let angle = turn + index as f64 / count as f64 * std::f64::consts::TAU;
        let away_m = radius_m * random.random_range(0.3..1.0);
        [centre[0] + away_m * angle.cos(), centre[1] + away_m * angle.sin()]
    };
    (0..count).map(corner).collect()
}

/// A comb of walls, so that paths are long.
fn maze(random: &mut impl Rng) -> Vec<Corners> {
    let walls = random.random_range(1..8);
    let wall = |index: usize| {
        let x_m = SIDE_M * (index + 1) as f64 / (walls + 1) as f64;
        let gap_m = random.random_range(0.0..SIDE_M - 60.0);
        let [low, high] = if index.is_multiple_of(2) { [gap_m + 60.0, SIDE_M + 5.0] } else { [-5.0, gap_m] };
        vec![[x_m, low], [x_m + 10.0, low + 3.0], [x_m + 8.0, high], [x_m - 2.0, high]]
    };
    (0..walls).map(wall).collect()
}

fn zones(random: &mut impl Rng) -> Vec<Corners> {
    if random.random::<bool>() {
        return maze(random);
    }
    let count = random.random_range(1..12);
    let mut zone = || {
        let centre = [random.random::<f64>() * SIDE_M, random.random::<f64>() * SIDE_M];
        let radius_m = random.random_range(20.0..200.0);
        star(random, centre, radius_m)
    };
    (0..count).map(|_| zone()).collect()
}

fn scenario(zones: &[Corners], start: Position) -> Option<Scenario> {
    scenario_with(zones, start, "")
}

fn scenario_with(zones: &[Corners], start: Position, uav: &str) -> Option<Scenario> {
    let zone = |corners: &Corners| format!("{{ polygon_m = {corners:?} }}");
    let zones: Vec<String> = zones.iter().map(zone).collect();
    let text = format!(
        "name = 'maze'\n[area]\nside_m = {SIDE_M:?}\nno_fly = [{}]\n[uav]\n{uav}start_m = [{:?}, {:?}]\n",
        zones.join(", "),
        start.x,
        start.y
    );
    Scenario::parse(&text, Path::new("maze.toml"), Overrides::default()).ok()
}

fn polygon(corners: &Corners) -> Polygon {
    Polygon::new(LineString::from(corners.iter().map(|&[x, y]| (x, y)).collect::<Vec<_>>()), vec![])
}

fn coord(position: &Position) -> Coord {
    Coord { x: position.x, y: position.y }
}

/// Whether the interior of a polygon and the segment have a point in common (DE-9IM).
fn enters(polygon: &Polygon, from: Coord, to: Coord) -> bool {
    if from == to {
        return polygon.contains(&Point::from(from));
    }
    polygon.relate(&LineString::from(vec![from, to])).matches("T********").expect("a pattern")
        || polygon.contains(&Line::new(from, to))
}

/// Exact length of the shortest path over the corners: segments may touch polygons, but not enter them.
fn independent_m(polygons: &[Polygon], from: &Position, to: &Position) -> f64 {
    let mut places = vec![coord(from), coord(to)];
    let in_area = |place: &Coord| (0.0..=SIDE_M).contains(&place.x) && (0.0..=SIDE_M).contains(&place.y);
    let corners = polygons.iter().flat_map(|polygon| polygon.exterior().0[1..].to_vec());
    places.extend(corners.filter(in_area));
    let mut graph = UnGraph::<(), f64>::new_undirected();
    let nodes: Vec<_> = places.iter().map(|_| graph.add_node(())).collect();
    for first in 0..places.len() {
        for second in first + 1..places.len() {
            let a = places[first];
            let b = places[second];
            if !polygons.iter().any(|polygon| enters(polygon, a, b)) {
                graph.add_edge(nodes[first], nodes[second], Euclidean.distance(a, b));
            }
        }
    }
    dijkstra(&graph, nodes[0], Some(nodes[1]), |edge| *edge.weight()).get(&nodes[1]).copied().unwrap_or(f64::INFINITY)
}

/// Flies from one point to another in each of `count` mazes; returns how many were flown and how many of them had
/// bends.
fn fly_mazes(seed: u64, count: usize) -> (usize, usize) {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let place =
        |random: &mut ChaCha8Rng| Position::new(random.random::<f64>() * SIDE_M, random.random::<f64>() * SIDE_M);
    let mut flown = 0;
    let mut bent = 0;
    for _ in 0..count {
        let zones = zones(&mut random);
        let polygons: Vec<Polygon> = zones.iter().map(polygon).collect();
        let free =
            |position: &Position| !polygons.iter().any(|polygon| polygon.contains(&Point::from(coord(position))));
        let [start, goal] = std::array::from_fn(|_| {
            loop {
                let drawn = place(&mut random);
                if free(&drawn) {
                    break drawn;
                }
            }
        });
        let Some(scenario) = scenario(&zones, start) else { continue };
        let airspace = scenario.airspace();
        let way = airspace.way(&start, &goal);
        let shortest_m = independent_m(&polygons, &start, &goal);
        assert_eq!(way.is_empty(), shortest_m == f64::INFINITY, "{zones:?} {start} {goal}");
        if way.is_empty() {
            continue;
        }
        let found_m = length_m(&start, &way);
        assert!(found_m <= shortest_m * 1.000_001 + 1e-4, "{found_m} {shortest_m} {zones:?} {start} {goal}");
        assert!(found_m >= shortest_m * (1.0 - 1e-9), "{found_m} {shortest_m} {zones:?} {start} {goal}");
        flown += 1;
        bent += usize::from(way.len() > 1);
        let mut at = start;
        for slot in 0.. {
            if at == goal {
                break;
            }
            let next = airspace.toward(&at, &goal, REACH_M);
            assert!(slot < 3_000 && next != at, "no progress at {at}: {zones:?} {start} {goal}");
            assert!((next - at).norm() <= REACH_M * (1.0 + 1e-9));
            let entered = polygons.iter().any(|polygon| enters(polygon, coord(&at), coord(&next)));
            assert!(!entered, "{at} to {next}: {zones:?} {start} {goal}");
            at = next;
        }
    }
    (flown, bent)
}

#[test]
fn paths_avoid_zones_and_are_shortest() {
    let (flown, bent) = fly_mazes(1, 100);
    assert!(flown > 60 && bent > 20, "{flown} flown, {bent} with bends");
}

#[test]
#[ignore = "takes a minute"]
fn paths_through_a_thousand_mazes_avoid_zones_and_are_shortest() {
    let (flown, bent) = fly_mazes(2, 1_000);
    assert!(flown > 600 && bent > 200, "{flown} flown, {bent} with bends");
}

#[test]
fn the_distance_table_has_the_lengths_of_the_shortest_paths() {
    let mut random = ChaCha8Rng::seed_from_u64(7);
    let mut around = [0; 2]; // around zones, and along grids
    for maze in 0..40 {
        let grid = if maze % 4 == 0 { "moves = 'grid'\ncell_m = 50.0\n" } else { "" };
        let zones = zones(&mut random);
        let start = Position::new(25.0, 25.0);
        let Some(scenario) = scenario_with(&zones, start, grid) else { continue };
        let airspace = scenario.airspace();
        let points: Vec<Position> =
            (0..12).map(|_| Position::new(random.random::<f64>() * SIDE_M, random.random::<f64>() * SIDE_M)).collect();
        let distances_m = airspace.distances_m(&points);
        for (from, a) in points.iter().enumerate() {
            for (to, b) in points.iter().enumerate() {
                let [a, b] = [a, b].map(|point| airspace.nearest(point));
                let expected_m = airspace.distance_m(&a, &b);
                let found_m = distances_m[from * points.len() + to];
                assert!((found_m - expected_m).abs() < 1e-6, "maze {maze}: {found_m} and {expected_m} m");
                around[usize::from(maze % 4 == 0)] += usize::from(expected_m > (a - b).norm() + 1.0);
            }
        }
    }
    assert!(around.iter().all(|&ways| ways > 300), "{around:?}");
}

/// Rectangles on a lattice, so that most share edges or corners, overlap, or lie on the edge of the area.
fn parcels(random: &mut impl Rng) -> Vec<Corners> {
    let count = random.random_range(2..14);
    let mut parcel = || {
        let [west, south] = [0, 0].map(|_| f64::from(random.random_range(0..9_u32)) * 100.0);
        let [width, height] = [0, 0].map(|_| f64::from(random.random_range(1..4_u32)) * 100.0);
        let [east, north] = [(west + width).min(SIDE_M), (south + height).min(SIDE_M)];
        vec![[west, south], [east, south], [east, north], [west, north]]
    };
    (0..count).map(|_| parcel()).collect()
}

/// Whether there is closed ground around `point`: in all directions, a little away, it lies in a zone or outside.
fn is_walled_in(zones: &[Corners], point: &Position) -> bool {
    let is_closed = |at: Position| {
        let [x, y] = [at.x, at.y];
        let is_outside = !(0.0..=SIDE_M).contains(&x) || !(0.0..=SIDE_M).contains(&y);
        is_outside || zones.iter().any(|c| c[0][0] <= x && x <= c[2][0] && c[0][1] <= y && y <= c[2][1])
    };
    (0..16).all(|step| {
        let (sin, cos) = (f64::from(step) * std::f64::consts::PI / 8.0 + 0.1).sin_cos();
        is_closed(point + 0.05 * nalgebra::Vector2::new(cos, sin))
    })
}

#[test]
fn no_path_leads_between_zones_that_touch() {
    let mut random = ChaCha8Rng::seed_from_u64(14);
    let mut arrangements = 0;
    let mut bends = 0;
    while arrangements < 1_000 {
        let zones = parcels(&mut random);
        let mut place = || Position::new(random.random::<f64>() * SIDE_M, random.random::<f64>() * SIDE_M);
        let start = place();
        let ends = [place(), place(), place()];
        let Some(scenario) = scenario(&zones, start) else { continue };
        arrangements += 1;
        let airspace = scenario.airspace();
        for end in ends {
            let to = airspace.nearest(&end);
            let mut from = start;
            for bend in airspace.way(&start, &to) {
                bends += 1;
                for part in 0..=100 {
                    let at = from + (bend - from) * (f64::from(part) / 100.0);
                    assert!(!is_walled_in(&zones, &at), "{at} from {start} to {to} among {zones:?}");
                }
                from = bend;
            }
        }
    }
    assert!(bends > 3_000, "{bends}");
}

/// An outline of many corners about a point, with inlets.
fn lake(count: u32) -> Corners {
    let corner = |index: u32| {
        let angle = f64::from(index) / f64::from(count) * std::f64::consts::TAU;
        let away_m = 150.0 + 30.0 * (5.0 * angle).sin() + 10.0 * (23.0 * angle).sin() + (397.0 * angle).sin();
        [400.0 + away_m * angle.cos(), 500.0 + away_m * angle.sin()]
    };
    (0..count).map(corner).collect()
}

#[test]
fn a_zone_of_many_corners_grows_by_its_tolerance_and_never_shrinks() {
    for (corners, tolerance_m) in [(900, 5.0), (3_000, 5.0), (3_000, 0.5)] {
        let lake = lake(corners);
        let text = format!(
            "name = 'lake'\n[uav]\nstart_m = [900.0, 900.0]\nmax_speed_mps = 30.0\n[area]\nside_m = {SIDE_M:?}\n\
             simplify_m = {tolerance_m:?}\nno_fly = [{{ polygon_m = {lake:?} }}]\n"
        );
        let scenario = Scenario::parse(&text, Path::new("lake.toml"), Overrides::default()).unwrap();
        let simplified = scenario.simplified_zones();
        assert_eq!(simplified.grown_m == 0.0, corners < 1_000, "as it is up to 1 000 corners");
        assert!(simplified.grown_m <= tolerance_m, "{} m", simplified.grown_m);
        assert!(simplified.corners <= 1_000, "{} corners", simplified.corners);
        let grown = &simplified.zones[0].0;
        assert!(lake.iter().all(|[x, y]| {
            let at = Position::new(*x, *y);
            grown.encloses(&at) || grown.projections(&at).any(|rim| (rim - at).norm() < 1e-6)
        }));
    }
}

/// The zone of a lake on whose shore the base has a polygon, or its place, as the scenario simplifies it.
fn shore(lake: &Corners, base: &str) -> Scenario {
    let text = format!(
        "name = 'shore'\n[uav]\nstart_m = [900.0, 900.0]\nmax_speed_mps = 30.0\n[area]\nside_m = {SIDE_M:?}\n\
         no_fly = [{{ polygon_m = {lake:?} }}]\n[base]\n{base}\n"
    );
    Scenario::parse(&text, Path::new("shore.toml"), Overrides::default()).unwrap()
}

#[test]
fn a_zone_that_grows_covers_nothing_of_a_base_that_was_free() {
    let lake = lake(3_000);
    let outline = skysink_common::airspace::Polygon::of(&lake, false).unwrap();
    let dry = |at: &Position| !outline.encloses(at);
    let grid = (0..=110).flat_map(|x| (0..=80).map(move |y| [f64::from(x), f64::from(y)]));
    let places: Vec<Position> =
        grid.map(|[x, y]| Position::new(545.0 + x / 2.0, 480.0 + y / 2.0)).filter(dry).collect();
    let flooded = |base: &str| {
        let scenario = shore(&lake, base);
        let zones = scenario.simplified_zones();
        assert!(zones.grown_m > 0.0 && zones.corners < 1_500, "{} corners", zones.corners);
        let grown = &zones.zones[0].0;
        let is_deep = |at: &&Position| grown.encloses(at) && (grown.nearest(at) - *at).norm() > 1e-6;
        places.iter().filter(is_deep).count()
    };
    assert_eq!(flooded("areas_m = [[[545, 480], [600, 480], [600, 520], [545, 520]]]"), 0);
    assert!(flooded("position_m = [570.0, 500.0]") > 0, "what the polygon keeps free");
}

/// Clones share what is simplified, and a changed key has its own.
#[test]
fn zones_are_simplified_again_only_if_their_keys_change() {
    let scenario = shore(&lake(3_000), "position_m = [570.0, 500.0]");
    let mut other = scenario.clone();
    assert_eq!(other.simplified_zones().grown_m, scenario.simplified_zones().grown_m);
    other.area.simplify_m = Some(1e-3);
    assert!(other.simplified_zones().grown_m <= 1e-3 && scenario.simplified_zones().grown_m > 1e-3);
}
