//! Whether the altitudes of the ground at the sensor nodes are probably heights: neither missing ones written as 0, nor
//! jumps that no ground has.

use rstar::RTree;
use rstar::primitives::GeomWithData;

use super::plausible::distance;
use crate::geometry::Position;

/// An international foot [m].
pub const FOOT_M: f64 = 0.3048;

/// Altitude [m] above which all others have to lie for a 0 to be doubted: near the sea it is one like any other.
const LEAST_OTHER_M: f64 = 20.0;

/// Difference of altitudes [m] up to which sensor nodes may stand on top of each other.
const LEAST_JUMP_M: f64 = 10.0;

/// Sensor nodes around each that it is compared with.
const NEIGHBOURS: usize = 4;

/// Probably no heights of the ground, a line each. `ground_m` are the altitudes at the `nodes` [m], or none.
pub fn doubts(nodes: &[Position], ground_m: &[f64], node_name: &dyn Fn(usize) -> String) -> Vec<String> {
    if ground_m.len() != nodes.len() {
        return Vec::new();
    }
    zeros(ground_m, node_name).or_else(|| jump(nodes, ground_m, node_name)).into_iter().collect()
}

/// Some altitudes are 0, and all others are high.
fn zeros(ground_m: &[f64], node_name: &dyn Fn(usize) -> String) -> Option<String> {
    let others = ground_m.iter().copied().filter(|altitude_m| *altitude_m != 0.0);
    let lowest_m = others.fold(f64::INFINITY, f64::min);
    let mut zeros = ground_m.iter().enumerate().filter(|(_, altitude_m)| **altitude_m == 0.0);
    let (node, _) = zeros.next().filter(|_| lowest_m > LEAST_OTHER_M && lowest_m.is_finite())?;
    let more = match zeros.count() {
        0 => String::new(),
        count => format!(", as at {count} more"),
    };
    let name = node_name(node);
    Some(format!("{name}: ground_m is 0{more}, beside {lowest_m} m and more of the others: was it not measured?"))
}

/// The ground differs by more between two neighbours than they are apart: the steepest such pair.
fn jump(nodes: &[Position], ground_m: &[f64], node_name: &dyn Fn(usize) -> String) -> Option<String> {
    let entries = nodes.iter().enumerate().map(|(node, at)| GeomWithData::new([at.x, at.y], node));
    let tree = RTree::bulk_load(entries.collect());
    let pairs = nodes.iter().enumerate().flat_map(|(node, at)| {
        let around = tree.nearest_neighbor_iter_with_distance_2(&[at.x, at.y]).take(NEIGHBOURS + 1);
        around.map(move |(other, squared_m2)| (node, other.data, squared_m2.sqrt())).collect::<Vec<_>>()
    });
    let jumps = pairs.filter_map(|(node, other, apart_m)| {
        let jump_m = (ground_m[node] - ground_m[other]).abs();
        (node < other && jump_m > apart_m.max(LEAST_JUMP_M)).then_some((node, other, apart_m, jump_m))
    });
    let (node, other, apart_m, jump_m) = jumps.max_by(|a, b| (a.3 - a.2).total_cmp(&(b.3 - b.2)))?;
    let [low_m, high_m] = [node, other].map(|node| ground_m[node]);
    let far = distance(apart_m);
    let name = node_name(node);
    Some(format!(
        "{name}: ground_m is {low_m}, and {high_m} at sensor node {other}, {far} away: a jump of {jump_m:.0} m; are \
         both heights of the ground?"
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The doubts about nodes 100 m apart along a line, at these altitudes [m].
    fn doubts_about(ground_m: &[f64]) -> Vec<String> {
        let nodes: Vec<Position> = (0..ground_m.len()).map(|node| Position::new(100.0 * node as f64, 0.0)).collect();
        doubts(&nodes, ground_m, &|node| format!("line {}", node + 2))
    }

    #[test]
    fn a_zero_beside_high_ground_is_doubted_and_one_at_the_coast_is_not() {
        let expected = "line 3: ground_m is 0, beside 388 m and more of the others: was it not measured?";
        assert_eq!(doubts_about(&[388.0, 0.0, 472.0]), [expected]);
        assert_eq!(doubts_about(&[388.0, 0.0, 472.0, 0.0]), [expected.replace("0,", "0, as at 1 more,")]);
        for plausible in [&[0.0, 2.0, 80.0][..], &[0.0, -3.0, 30.0], &[0.0, 0.0], &[388.0, 472.0], &[0.0], &[]] {
            assert!(doubts_about(plausible).is_empty(), "{plausible:?}");
        }
    }

    #[test]
    fn the_highest_jump_between_neighbours_is_doubted() {
        let [said] = &doubts_about(&[400.0, 410.0, 1310.0, 1209.0])[..] else { panic!("one doubt") };
        assert_eq!(
            said,
            "line 3: ground_m is 410, and 1310 at sensor node 2, 100 m away: a jump of 900 m; are both heights of the \
             ground?"
        );
        assert!(doubts_about(&[400.0, 490.0, 395.0]).is_empty(), "steep, but ground");
        let together = [Position::origin(), Position::origin()];
        let said = |high_m: f64| doubts(&together, &[400.0, high_m], &|node| node.to_string()).len();
        assert_eq!((said(409.0), said(411.0)), (0, 1));
    }

    #[test]
    fn a_list_without_altitudes_is_not_doubted() {
        assert!(doubts(&[Position::origin()], &[], &|_| String::new()).is_empty());
    }
}
