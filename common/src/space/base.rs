//! The base: where UAVs land and charge (decisions D9 and D34).

use std::sync::Arc;

use nalgebra::Vector2;

use crate::airspace::{Airspace, Polygon};
use crate::geometry::{Position, distance_squared, within};

/// How far from a polygon a UAV is in it [m], so that rounding does not leave it outside.
const RIM_M: f64 = 1e-6;

/// Places that are tried for the deepest one of a polygon, along each axis.
const PLACES: u32 = 32;

/// Where UAVs land and charge.
#[derive(Debug, Clone, PartialEq)]
pub enum Base {
    /// A disk.
    Disk {
        /// Its centre [m].
        centre: Position,
        /// Its radius [m].
        radius_m: f64,
    },
    /// Polygons.
    Areas(Arc<[BaseArea]>),
    /// Several bases, each a disk or a polygon, that do not overlap.
    Sites(Arc<[BaseSite]>),
}

/// One of several bases.
#[derive(Debug, Clone, PartialEq)]
pub struct BaseSite {
    /// Where it is: a disk or a polygon.
    pub shape: Base,
    /// What it gives to a UAV that stays in it.
    pub charger: Charger,
}

/// What a site gives to the UAVs that stay in it (decision D34).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Charger {
    /// Its power [W].
    pub charge_w: f64,
    /// Slots of a stay after which the battery is full; `None` if it is charged.
    pub swap_slots: Option<u64>,
    /// UAVs that charge at the same time.
    pub pads: u32,
}

impl Charger {
    /// Whether it gives energy.
    pub fn charges(&self) -> bool {
        self.charge_w > 0.0 || self.swap_slots.is_some()
    }
}

/// A polygon in which UAVs land and charge.
#[derive(Debug, Clone, PartialEq)]
pub struct BaseArea {
    /// Its outline.
    pub polygon: Polygon,
    /// A place deep in it, and outside of zones where there is one [m].
    pub place: Position,
    /// How far it is from there to its rim [m].
    pub depth_m: f64,
}

impl BaseArea {
    /// The area within `polygon`.
    pub(crate) fn new(polygon: Polygon, airspace: &Airspace) -> Self {
        let [lowest, highest] = polygon.extent();
        let extent = highest - lowest;
        let steps = || (0..PLACES).map(|step| (f64::from(step) + 0.5) / f64::from(PLACES));
        let cells = steps().flat_map(|x| steps().map(move |y| lowest + Vector2::new(extent.x * x, extent.y * y)));
        let corners = polygon.corners();
        let mean =
            Position::from(corners.iter().map(|corner| corner.coords).sum::<Vector2<f64>>() / corners.len() as f64);
        // Thin polygons fall between the cells.
        let beside = polygon.projections(&mean).map(move |rim| rim + (mean - rim) * 1e-3);
        let within = std::iter::once(mean).chain(cells).chain(beside).filter(|at| polygon.encloses(at));
        let deep = within.map(|at| (airspace.contains(&at), distance_squared(&polygon.nearest(&at), &at), at));
        let deepest = deep.max_by(|(is_free, depth_m2, _), (other_free, other_m2, _)| {
            is_free.cmp(other_free).then(depth_m2.total_cmp(other_m2))
        });
        let (depth_m, place) = deepest.map_or((0.0, corners[0]), |(_, depth_m2, at)| (depth_m2.sqrt(), at));
        Self { polygon, place, depth_m }
    }
}

impl Base {
    /// The sites of several bases; none of a single one.
    pub fn sites(&self) -> &[BaseSite] {
        if let Self::Sites(sites) = self { sites } else { &[] }
    }

    /// What it is made of: disks, and lists of polygons.
    pub fn shapes(&self) -> impl Iterator<Item = &Self> {
        let own = if let Self::Sites(_) = self { &[][..] } else { std::slice::from_ref(self) };
        own.iter().chain(self.sites().iter().map(|site| &site.shape))
    }

    /// The number of the site of `ground` [m]; `None` outside of them, and in a single base.
    pub fn site_at(&self, ground: &Position) -> Option<usize> {
        self.sites().iter().position(|site| site.shape.contains(ground))
    }

    /// The charger of the site of `ground` [m]; `None` outside of them, and in a single base, whose charger is that of
    /// the battery.
    pub fn charger_at(&self, ground: &Position) -> Option<&Charger> {
        Some(&self.sites()[self.site_at(ground)?].charger)
    }

    /// A place well inside, of each of its areas [m].
    pub fn places(&self) -> impl Iterator<Item = Position> {
        self.shapes().flat_map(|shape| {
            let (disk, areas) = match shape {
                Self::Disk { centre, .. } => (Some(*centre), &[][..]),
                Self::Areas(areas) => (None, &areas[..]),
                Self::Sites(_) => (None, &[][..]), // a shape is none
            };
            disk.into_iter().chain(areas.iter().map(|area| area.place))
        })
    }

    /// Each of its places with its name on maps [m]: that of a site has its number and its pads.
    pub fn names(&self) -> impl Iterator<Item = (Position, String)> {
        let of = |(number, site): (usize, &BaseSite)| {
            let pads = if site.charger.pads == 1 { "pad" } else { "pads" };
            format!("base {number}: {} {pads}", site.charger.pads)
        };
        let sites = self.sites().iter().enumerate().map(of).map(Some).chain(std::iter::repeat(None));
        self.places().zip(sites).map(|(place, name)| (place, name.unwrap_or_else(|| "base".to_owned())))
    }

    /// How far a UAV may end beside any of the [places](Self::places) and still be in the base [m].
    pub fn depth_m(&self) -> f64 {
        match self {
            Self::Disk { radius_m, .. } => *radius_m,
            Self::Areas(areas) => areas.iter().map(|area| area.depth_m).fold(f64::INFINITY, f64::min),
            Self::Sites(sites) => sites.iter().map(|site| site.shape.depth_m()).fold(f64::INFINITY, f64::min),
        }
    }

    /// Distance of `ground` from its rim [m]; 0 or below within.
    pub fn away_m(&self, ground: &Position) -> f64 {
        match self {
            Self::Disk { centre, radius_m } => (ground - centre).norm() - radius_m,
            Self::Areas(_) => (ground - self.nearest(ground)).norm(),
            Self::Sites(sites) => sites.iter().map(|site| site.shape.away_m(ground)).fold(f64::INFINITY, f64::min),
        }
    }

    /// Whether a UAV at `ground` [m] may land and charge.
    pub fn contains(&self, ground: &Position) -> bool {
        match self {
            Self::Disk { centre, radius_m } => within(ground, centre, *radius_m),
            Self::Areas(areas) => areas.iter().any(|BaseArea { polygon, .. }| {
                polygon.encloses(ground) || within(ground, &polygon.nearest(ground), RIM_M)
            }),
            Self::Sites(sites) => sites.iter().any(|site| site.shape.contains(ground)),
        }
    }

    /// Whether a point lies in both, of which each is a disk or a polygon.
    pub fn overlaps(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Disk { centre, radius_m }, other) | (other, Self::Disk { centre, radius_m }) => {
                other.away_m(centre) <= *radius_m
            }
            (Self::Areas(areas), Self::Areas(others)) => areas.iter().any(|BaseArea { polygon, .. }| {
                polygon.corners().iter().any(|corner| other.contains(corner))
                    || others.iter().any(|other| !polygon.crossings(&other.polygon).is_empty())
                    || others.iter().flat_map(|other| other.polygon.corners()).any(|corner| self.contains(corner))
            }),
            (Self::Sites(sites), other) | (other, Self::Sites(sites)) => {
                sites.iter().any(|site| site.shape.overlaps(other))
            }
        }
    }

    /// The point of the base that is nearest to `ground` [m].
    pub fn nearest(&self, ground: &Position) -> Position {
        if self.contains(ground) {
            return *ground;
        }
        let away_m2 = |rim: &Position| distance_squared(rim, ground);
        let nearer = |a: &Position, b: &Position| away_m2(a).total_cmp(&away_m2(b));
        match self {
            Self::Disk { centre, radius_m } => {
                let away = ground - centre;
                centre + away * (radius_m / away.norm())
            }
            Self::Areas(areas) => {
                areas.iter().map(|area| area.polygon.nearest(ground)).min_by(nearer).unwrap_or(*ground)
            }
            Self::Sites(sites) => sites.iter().map(|site| site.shape.nearest(ground)).min_by(nearer).unwrap_or(*ground),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::{Overrides, Scenario};
    use std::path::Path;

    fn base(keys: &str) -> Option<Base> {
        let text = format!("name = 'a'\n{keys}");
        Scenario::parse(&text, Path::new("a.toml"), Overrides::default()).unwrap().landing_base()
    }

    fn disk(x_m: f64, y_m: f64, radius_m: f64) -> Base {
        Base::Disk { centre: Position::new(x_m, y_m), radius_m }
    }

    #[test]
    fn the_base_defaults_to_the_start() {
        assert_eq!(base("[uav.battery]\ncapacity_j = 1000.0\n"), Some(disk(50.0, 50.0, 1.0)));
        assert_eq!(base("[base]\nposition_m = [3.0, 4.0]\nradius_m = 5.0\n"), Some(disk(3.0, 4.0, 5.0)));
        assert_eq!(base(""), None);
    }

    #[test]
    fn the_nearest_point_of_a_base_is_in_it() {
        let centre = Position::new(3.0, 4.0);
        let disk = disk(3.0, 4.0, 5.0);
        assert_eq!(disk.nearest(&Position::new(3.0, 104.0)), Position::new(3.0, 9.0));
        let areas = base("[base]\nareas_m = [[[0, 0], [9, 0.3], [1, 7]], [[40, 40], [41, 48], [33, 41]]]\n").unwrap();
        for base in [disk, areas] {
            assert_eq!(base.nearest(&Position::new(1.0, 1.0)), Position::new(1.0, 1.0));
            for step in 0..1_000 {
                let (sine, cosine) = (f64::from(step) * 0.37).sin_cos();
                let away = centre + Vector2::new(cosine, sine) * (6.0 + f64::from(step));
                let nearest = base.nearest(&away);
                assert!(base.contains(&nearest), "{away}");
                assert!((base.away_m(&away).max(0.0) - (nearest - away).norm()).abs() < 1e-9, "{away}");
            }
        }
    }

    #[test]
    fn each_area_has_a_landing_point_far_from_its_border() {
        // An L whose mean corner lies outside, a square, and one of which a zone leaves the west.
        let keys = "[area]\nno_fly = [{ polygon_m = [[85, 0], [100, 0], [100, 20], [85, 20]] }]\n[base]\nareas_m = [\
                    [[0, 0], [30, 0], [30, 4], [4, 4], [4, 30], [0, 30]], [[50, 50], [60, 50], [60, 60], [50, 60]],\
                    [[80, 0], [100, 0], [100, 20], [80, 20]]]\n";
        let base = base(keys).unwrap();
        let places: Vec<Position> = base.places().collect();
        assert!(places.iter().all(|place| base.contains(place)));
        assert!(places[0].x < 4.0 && places[0].y < 4.0, "{}", places[0]);
        assert!((places[1] - Position::new(55.0, 55.0)).norm() < 0.5, "{}", places[1]);
        assert!((80.0..85.0).contains(&places[2].x), "{}", places[2]);
        // The largest circle in the bend of the L: 4 (2 − √2) m.
        assert!((2.2..=2.344).contains(&base.depth_m()), "{}", base.depth_m());
        assert!(!base.contains(&Position::new(20.0, 20.0)) && base.contains(&Position::new(58.0, 51.0)));
    }

    #[test]
    fn invalid_base_areas_are_refused() {
        for (areas, expected) in [
            ("[]", "base.areas_m = []: expected at least one polygon"),
            ("[[[0, 0], [9, 0], [9, 0]]]", "base.areas_m[0]"),
            ("[[[0, 0], [9, 0], [9, 9]], [[0, 0], [101, 0], [9, 9]]]", "base.areas_m[1]"),
            ("[[[0, 0], [9, 0], [9, 9]]]\nradius_m = 3.0", "either areas_m, or position_m and radius_m"),
            ("[[[0, 0], [9, 0], [9, 9]]]\nposition_m = [1.0, 1.0]", "either areas_m, or position_m and radius_m"),
            ("[[71, 71], [79, 71], [79, 79]]", "base.areas_m"),
            (
                "[[[71, 71], [79, 71], [79, 79]]]\n[area]\nno_fly = [{ polygon_m = [[70, 70], [80, 70], [80, 80], [70, 80]] }]",
                "expected a polygon that the UAV can fly to",
            ),
        ] {
            let text = format!("name = 'a'\n[base]\nareas_m = {areas}\n");
            let error = Scenario::parse(&text, Path::new("a.toml"), Overrides::default()).unwrap_err().to_string();
            assert!(error.contains("a.toml") && error.contains(expected), "{error}");
        }
    }
}
