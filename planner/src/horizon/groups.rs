//! Groups of sources that are served together: a cover of the field by few of them, found by annealing.
//!
//! Where sources stand so dense that the resource blocks are the bottleneck, serving full groups in a cycle loses least.

use rand::Rng;
use rand_chacha::ChaCha8Rng;
use skysink_common::geometry::Position;
use skysink_common::random::{Purpose, Streams};

use super::world::{Place, World};
use crate::geometry::circle::Circle;

/// Sources that one may be grouped with.
const NEIGHBOURS: usize = 24;

/// Steps per source.
const STEPS: u64 = 4_000;

/// Most steps in all.
const MOST_STEPS: u64 = 4_000_000;

/// Energy of a group that is too wide by its communication radius; a full group has −1.
const EXCESS: f64 = 4.0;

/// Temperature at the start and at the end, in energies of a full group.
const HEAT: [f64; 2] = [0.3, 0.015];

/// Share of the communication radius that groups may fill: the rest keeps rounding out of it.
const FILL: f64 = 1.0 - 1e-9;

/// Sources in groups, some of which may be too wide during the search.
#[derive(Debug, Clone)]
struct Partition<'a> {
    positions: &'a [Position],
    radius_m: f64,
    most: usize,
    groups: Vec<Vec<u32>>,
    energies: Vec<f64>,
    /// The group of each source.
    home: Vec<usize>,
    points: Vec<Position>,
}

impl Partition<'_> {
    fn energy(&mut self, members: &[u32]) -> f64 {
        self.points.clear();
        self.points.extend(members.iter().map(|&member| self.positions[member as usize]));
        let radius_m = Circle::around(&self.points).radius_m2.sqrt();
        let full = members.len() as f64 / self.most as f64;
        let excess = (radius_m / (self.radius_m * FILL) - 1.0).max(0.0);
        EXCESS * excess - full * full
    }
}

/// Groups that cover all sources of `world`, each once, each within its circle; none where no two can be served together.
pub(super) fn cover(world: &World, seed: u64) -> Vec<Place> {
    let count = world.positions.len();
    let neighbours: Vec<Vec<u32>> = (0..).zip(&world.positions).map(|(own, at)| near(world, own, at)).collect();
    if world.blocks() < 2 || neighbours.iter().all(Vec::is_empty) {
        return Vec::new();
    }
    let most = world.blocks();
    let mut partition = Partition {
        positions: &world.positions,
        radius_m: world.radius_m(),
        most,
        groups: (0..count as u32).map(|source| vec![source]).collect(),
        energies: vec![-1.0 / (most * most) as f64; count],
        home: (0..count).collect(),
        points: Vec::new(),
    };
    let mut random = Streams::new(seed).stream(Purpose::Groups, 0, 0);
    let steps = (STEPS * count as u64).min(MOST_STEPS);
    partition.anneal(&neighbours, steps, &mut random);
    partition.split();
    partition.places(world)
}

/// The sources nearest to source `own` that can be served together with it.
fn near(world: &World, own: u32, at: &Position) -> Vec<u32> {
    let mut near: Vec<(f64, u32)> = Vec::new();
    world.grid.visit(at, 2.0 * world.radius_m() * FILL, |node, d2_m2| near.push((d2_m2, node.id)));
    near.retain(|&(_, other)| other != own);
    near.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    near.truncate(NEIGHBOURS);
    near.into_iter().map(|(_, other)| other).collect()
}

impl Partition<'_> {
    fn below(random: &mut ChaCha8Rng, count: usize) -> usize {
        ((u64::from(random.next_u32()) * count as u64) >> 32) as usize
    }

    fn anneal(&mut self, neighbours: &[Vec<u32>], steps: u64, random: &mut ChaCha8Rng) {
        let count = self.home.len();
        let (full, rest) = (count / self.most, (count % self.most) as f64 / self.most as f64);
        let least = -(full as f64) - rest * rest;
        let mut energy: f64 = self.energies.iter().sum();
        let (mut best, mut best_groups) = (energy, self.groups.clone());
        let mut changed: [Vec<u32>; 2] = [Vec::new(), Vec::new()];
        for step in 0..steps {
            let heat = HEAT[0] * (HEAT[1] / HEAT[0]).powf(step as f64 / steps as f64);
            let source = Self::below(random, count) as u32;
            let near = &neighbours[source as usize];
            if near.is_empty() {
                continue;
            }
            let other = near[Self::below(random, near.len())];
            let (from, to) = (self.home[source as usize], self.home[other as usize]);
            if from == to {
                continue;
            }
            changed[0].clone_from(&self.groups[from]);
            changed[0].retain(|&member| member != source);
            changed[1].clone_from(&self.groups[to]);
            let swapped = self.groups[to].len() == self.most || random.next_u32() & 1 == 0;
            if swapped {
                let back = Self::below(random, self.groups[to].len());
                let moved = changed[1].swap_remove(back);
                changed[0].push(moved);
            }
            changed[1].push(source);
            let energies = [self.energy(&changed[0]), self.energy(&changed[1])];
            let rise = energies[0] + energies[1] - self.energies[from] - self.energies[to];
            let chance = (f64::from(random.next_u32()) + 1.0) / 4_294_967_296.0;
            if rise > -heat * chance.ln() {
                continue;
            }
            energy += rise;
            (self.energies[from], self.energies[to]) = (energies[0], energies[1]);
            self.groups[from].clone_from(&changed[0]);
            self.groups[to].clone_from(&changed[1]);
            changed[0].iter().for_each(|&member| self.home[member as usize] = from);
            self.home[source as usize] = to;
            if energy < best - 1e-9 {
                best = energy;
                best_groups.clone_from(&self.groups);
                if best <= least + 1e-9 {
                    break;
                }
            }
        }
        self.groups = best_groups;
    }

    /// Splits groups that are too wide: the member whose leaving shrinks the circle most goes, until it fits.
    fn split(&mut self) {
        let mut left: Vec<u32> = Vec::new();
        let mut groups = std::mem::take(&mut self.groups);
        for group in &mut groups {
            while self.radius_m(group) > self.radius_m * FILL {
                let without = |partition: &mut Self, index: usize| {
                    let mut rest = group.clone();
                    rest.remove(index);
                    partition.radius_m(&rest)
                };
                let radii_m: Vec<f64> = (0..group.len()).map(|index| without(self, index)).collect();
                let (worst, _) =
                    radii_m.iter().enumerate().min_by(|a, b| a.1.total_cmp(b.1)).expect("a wide group has members");
                left.push(group.remove(worst));
            }
        }
        for source in left {
            let fits = |partition: &mut Self, group: &Vec<u32>| {
                let with = [&group[..], &[source]].concat();
                group.len() < partition.most && partition.radius_m(&with) <= partition.radius_m * FILL
            };
            match groups.iter().position(|group| !group.is_empty() && fits(self, group)) {
                Some(index) => groups[index].push(source),
                None => groups.push(vec![source]),
            }
        }
        groups.retain(|group| !group.is_empty());
        groups.iter_mut().for_each(|group| group.sort_unstable());
        self.groups = groups;
    }

    fn radius_m(&mut self, members: &[u32]) -> f64 {
        self.points.clear();
        self.points.extend(members.iter().map(|&member| self.positions[member as usize]));
        Circle::around(&self.points).radius_m2.sqrt()
    }

    fn places(&self, world: &World) -> Vec<Place> {
        let place = |members: &Vec<u32>| {
            let points: Vec<Position> = members.iter().map(|&member| self.positions[member as usize]).collect();
            let circle = Circle::around(&points);
            let radius_m = (world.radius_m() - circle.radius_m2.sqrt()).max(0.0);
            Place { centre: circle.centre, radius_m, members: members.clone() }
        };
        self.groups.iter().map(place).collect()
    }
}
