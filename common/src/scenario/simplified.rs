//! The zones that a UAV keeps to: simpler outlines around those of many corners, made once for all clones of a
//! scenario.

use std::sync::{Arc, Mutex, PoisonError};

use super::area::Area;
use super::mission::Scenario;
use crate::airspace::{KeptGround, Polygon, SIMPLIFIED_CORNERS, simplify};
use crate::geometry::Position;

/// The zones that a UAV keeps to.
#[derive(Debug, Clone)]
pub struct SimplifiedZones {
    /// Their outlines and tops [m].
    pub zones: Vec<(Polygon, f64)>,
    /// Their corners.
    pub corners: usize,
    /// The corners of those of the scenario.
    pub given_corners: usize,
    /// How far they lie around those of the scenario, at most [m]; 0 if they are the same.
    pub grown_m: f64,
}

/// All that simplified zones depend on.
#[derive(Debug, PartialEq)]
struct ZoneSource {
    area: Area,
    /// Starts, and the place of the base [m].
    places: Vec<Position>,
    /// The polygons of the base [m].
    base_areas: Vec<Vec<[f64; 2]>>,
}

/// Simplified zones that clones of a scenario share, with what they were made from.
#[derive(Debug, Clone, Default)]
pub struct SharedZones(Arc<Mutex<Option<(SimplifiedZones, ZoneSource)>>>);

/// They follow from the keys, which are compared.
impl PartialEq for SharedZones {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

impl Scenario {
    /// The boundary, the zones and the buildings that the UAV keeps to: where they have many corners, simpler ones that
    /// lie around them. Starts, and places and areas of the base that are free stay so.
    ///
    /// # Panics
    /// If a zone is no polygon; never in a checked scenario.
    pub fn simplified_zones(&self) -> SimplifiedZones {
        let area = &self.area;
        let of_no_fly = area.no_fly.iter().flatten().map(|zone| zone.corners().len());
        let of_buildings = area.building.iter().flatten().map(|building| building.polygon_m.len());
        let count = area.boundary_m.iter().map(Vec::len).chain(of_no_fly).chain(of_buildings).sum::<usize>();
        if count <= SIMPLIFIED_CORNERS {
            return ZoneSource::of(self).simplified();
        }
        let source = ZoneSource::of(self);
        let mut shared = self.shared_zones.0.lock().unwrap_or_else(PoisonError::into_inner);
        match &*shared {
            Some((zones, made_from)) if *made_from == source => zones.clone(),
            _ => shared.insert((source.simplified(), source)).0.clone(),
        }
    }
}

impl ZoneSource {
    fn of(scenario: &Scenario) -> Self {
        let base = scenario.base.as_ref();
        let place = base.and_then(|base| base.position_m).map(Position::from);
        let sites = || base.and_then(|base| base.site.as_ref()).into_iter().flatten();
        let of_sites = sites().filter_map(|site| site.position_m).map(Position::from);
        let areas = base.and_then(|base| base.areas_m.clone()).unwrap_or_default();
        Self {
            area: scenario.area.clone(),
            places: scenario.starts().map(|start| start.xy()).chain(place).chain(of_sites).collect(),
            base_areas: areas.into_iter().chain(sites().filter_map(|site| site.area_m.clone())).collect(),
        }
    }

    fn simplified(&self) -> SimplifiedZones {
        let Self { area, places, base_areas } = self;
        let polygon = |corners: &[[f64; 2]], is_border| Polygon::of(corners, is_border).expect("zones are checked");
        let border = area.boundary_m.iter().map(|corners| (polygon(corners, true), f64::INFINITY));
        let no_fly = area.no_fly.iter().flatten().map(|zone| (polygon(zone.corners(), false), f64::INFINITY));
        let buildings = area.building.iter().flatten();
        let buildings = buildings.map(|building| (polygon(&building.polygon_m, false), building.height_m));
        let (mut polygons, tops_m): (Vec<_>, Vec<_>) = border.chain(no_fly).chain(buildings).unzip();
        let areas: Vec<Polygon> = base_areas.iter().filter_map(|corners| Polygon::of(corners, false).ok()).collect();
        let count = |polygons: &[Polygon]| polygons.iter().map(|polygon| polygon.corners().len()).sum();
        let given_corners = count(&polygons);
        let kept = KeptGround { places, areas: &areas };
        let grown_m = simplify(&mut polygons, SIMPLIFIED_CORNERS, area.simplify_m(), kept);
        let corners = count(&polygons);
        SimplifiedZones { zones: polygons.into_iter().zip(tops_m).collect(), corners, given_corners, grown_m }
    }
}
