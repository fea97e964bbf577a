//! Which boxes a straight way comes near: an index of zones, and of the places where they touch.

use rstar::primitives::{GeomWithData, Rectangle};
use rstar::{AABB, RTree, RTreeObject, SelectionFunction};
use smallvec::SmallVec;

use crate::geometry::Position;

type IndexedBox = GeomWithData<Rectangle<[f64; 2]>, usize>;

/// Slack of lengths that are compared, relative to them.
pub(super) const LENGTH_SLACK: f64 = 1e-9;

/// Boxes up to which each is looked at, which is faster than a tree.
const FEW: usize = 16;

/// Boxes, by number.
#[derive(Debug, Clone, Default)]
pub(super) struct BoxIndex {
    /// Those of an index of few.
    few: Vec<AABB<[f64; 2]>>,
    /// Those of one of many.
    many: RTree<IndexedBox>,
}

/// The boxes that a straight way touches, or comes nearer to than a margin.
struct Near {
    from: Position,
    to: Position,
    margin_m: f64,
}

impl Near {
    fn touches(&self, envelope: &AABB<[f64; 2]>) -> bool {
        let [low, high] = [envelope.lower(), envelope.upper()];
        let is_apart = |axis: usize| {
            self.from[axis].max(self.to[axis]) < low[axis] - self.margin_m
                || self.from[axis].min(self.to[axis]) > high[axis] + self.margin_m
        };
        if is_apart(0) || is_apart(1) {
            return false;
        }
        // Apart along the normal of the way.
        let along = self.to - self.from;
        let half = [0, 1].map(|axis| (high[axis] - low[axis]) / 2.0 + self.margin_m);
        let middle = Position::new((low[0] + high[0]) / 2.0, (low[1] + high[1]) / 2.0);
        let off = along.perp(&(middle - self.from)).abs();
        let reach = along.y.abs() * half[0] + along.x.abs() * half[1];
        off <= reach * (1.0 + LENGTH_SLACK)
    }
}

impl SelectionFunction<IndexedBox> for Near {
    fn should_unpack_parent(&self, envelope: &AABB<[f64; 2]>) -> bool {
        self.touches(envelope)
    }

    fn should_unpack_leaf(&self, leaf: &IndexedBox) -> bool {
        self.touches(&leaf.envelope())
    }
}

impl PartialEq for BoxIndex {
    /// What is found from the rest of an airspace is not compared.
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

impl BoxIndex {
    /// The index of boxes by their south-west and north-east corners [m].
    pub fn new(boxes: impl Iterator<Item = [Position; 2]>) -> Self {
        let boxes: Vec<_> = boxes.map(|[low, high]| ([low.x, low.y], [high.x, high.y])).collect();
        if boxes.len() <= FEW {
            let few = boxes.into_iter().map(|(low, high)| AABB::from_corners(low, high)).collect();
            return Self { few, many: RTree::new() };
        }
        let indexed = boxes
            .into_iter()
            .zip(0..)
            .map(|((low, high), number)| GeomWithData::new(Rectangle::from_corners(low, high), number));
        Self { few: Vec::new(), many: RTree::bulk_load(indexed.collect()) }
    }

    /// The numbers of the boxes that the way from `from` to `to` comes as near as `margin_m` [m], in any order.
    pub fn near(&self, from: &Position, to: &Position, margin_m: f64) -> impl Iterator<Item = usize> {
        let near = Near { from: *from, to: *to, margin_m };
        let few = self.few.iter().enumerate().filter(|(_, few)| near.touches(few));
        let mut found: SmallVec<[usize; FEW]> = few.map(|(number, _)| number).collect();
        if self.many.size() > 0 {
            found.extend(self.many.locate_with_selection_function(near).map(|found| found.data));
        }
        found.into_iter()
    }
}
