//! What the battery and the base allow (decisions D9 to D13).

use std::sync::Arc;

use serde::Serialize;
use skysink_common::base::{Base, BaseSite};
use skysink_common::battery::Battery;
use skysink_common::geometry::Position;
use skysink_common::propulsion::least_power_mps;
use skysink_common::scenario::Scenario;
use skysink_common::sensors::Sensors;
use skysink_planner::route::home::Home;

use super::quantity::scaled;

/// What the battery of a UAV and its base allow.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct EnergyFigures {
    /// Time in the air from a full battery to its reserve, hovering [s]; `None` without a battery.
    pub hovering_s: Option<f64>,
    /// Time in the air from a full battery to its reserve at the speed of least power [s].
    pub cruising_s: Option<f64>,
    /// Of several bases the one that is nearest to the start of the first UAV (decision D34).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub nearest_site: Option<NearestSite>,
    /// Time to charge from the reserve to full there [s]; `None` without a battery or a charger.
    pub charging_s: Option<f64>,
    /// Distance from the middle of the base [m] to which a full battery flies and comes home, at the least energy per
    /// metre; `None` without a battery.
    pub radius_m: Option<f64>,
    /// Distance [m] from the base to which a mission leaves time to fly and come home; `None` if the UAV need not land.
    pub timed_m: Option<f64>,
    /// Standard deviation of where a slot ends [m], if the base is smaller than twice that.
    pub missed_by_m: Option<f64>,
    /// Whether the battery of a UAV does not last for the flight from its start to the base, with the reserve.
    pub is_stranded: bool,
    /// Number of sampling SNs that cannot be served within both.
    pub beyond: usize,
}

/// One of several bases.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct NearestSite {
    /// Its number, from 0.
    pub number: usize,
    /// How far its rim is [m]; 0 within it.
    pub away_m: f64,
    /// UAVs that charge there at the same time.
    pub pads: u32,
}

impl NearestSite {
    /// Of `base`, seen from `ground` [m]; `None` if it is a single one.
    fn of(base: &Base, ground: &Position) -> Option<Self> {
        let away_m = |site: &BaseSite| site.shape.away_m(ground).max(0.0);
        let sites = base.sites().iter().enumerate();
        let nearest = sites.min_by(|(_, a), (_, b)| away_m(a).total_cmp(&away_m(b)));
        nearest.map(|(number, site)| Self { number, away_m: away_m(site), pads: site.charger.pads })
    }
}

/// Time to charge `battery` from its reserve to full, with the charger of `scenario` or of `site` [s]; `None` if it is
/// not charged.
fn charging_s(scenario: &Scenario, battery: &Battery, site: Option<&BaseSite>) -> Option<f64> {
    let usable_j = battery.capacity_j - battery.reserve_j;
    let charge_w = scenario.base.as_ref().map_or(0.0, |base| base.charge_w);
    let charger = site.map(|site| site.charger);
    let swapped_s = charger.and_then(|charger| charger.swap_slots).map(|slots| slots as f64 * scenario.slot_s);
    let charge_w = charger.map_or(charge_w, |charger| charger.charge_w);
    swapped_s.or_else(|| (charge_w > 0.0).then(|| usable_j / charge_w))
}

impl EnergyFigures {
    /// Of a scenario; `None` if its UAV need not come back.
    pub fn of(scenario: &Scenario, sensors: &Sensors) -> Option<Self> {
        let battery = Battery::finite(scenario);
        let base = scenario.landing_base().filter(|_| battery.is_some() || scenario.must_land())?;
        let reach_m = scenario.reach_m();
        let usable = |battery: &Battery| battery.capacity_j - battery.reserve_j;
        let lasting_s = |battery: &Battery, slot_m: f64| usable(battery) / battery.slot_j(slot_m) * scenario.slot_s;
        let slow_m = least_power_mps(&scenario.uav.propulsion, reach_m / scenario.slot_s) * scenario.slot_s;
        let nearest_site = NearestSite::of(&base, &scenario.start().xy());
        let site = nearest_site.map(|site| &base.sites()[site.number]);
        let depth_m = base.depth_m();
        let radius_m = battery.map(|battery| {
            let thrifty_m = battery.thrifty_m(reach_m);
            usable(&battery) / battery.slot_j(thrifty_m) * thrifty_m / 2.0 + depth_m
        });
        let timed_m = scenario.must_land().then(|| reach_m * scenario.slots as f64 / 2.0 + depth_m);
        let far_m = radius_m.unwrap_or(f64::INFINITY).min(timed_m.unwrap_or(f64::INFINITY));
        let far_m = far_m - depth_m + scenario.link.comm_radius_m;
        let is_beyond = |id: &u32| sensors.sampler(*id).mean_bits > 0.0 && base.away_m(sensors.position(*id)) > far_m;
        Some(Self {
            hovering_s: battery.map(|battery| lasting_s(&battery, 0.0)),
            cruising_s: battery.map(|battery| lasting_s(&battery, slow_m)),
            nearest_site,
            charging_s: battery.and_then(|battery| charging_s(scenario, &battery, site)),
            radius_m,
            timed_m,
            missed_by_m: scenario.uav.position_error_m.filter(|sigma_m| depth_m < 2.0 * sigma_m),
            is_stranded: battery.is_some_and(|battery| is_stranded(scenario, &battery)),
            beyond: sensors.ids().filter(is_beyond).count(),
        })
    }

    /// A UAV cannot come home on its battery.
    pub fn stranded_warning(&self) -> Option<String> {
        let text =
            "the battery does not last for the flight from the start to the base with its reserve: the UAV may go down";
        self.is_stranded.then(|| text.to_owned())
    }

    /// Name and value of each figure.
    pub fn rows(&self) -> Vec<(&'static str, String)> {
        let mut rows = Vec::new();
        if let (Some(hovering_s), Some(cruising_s)) = (self.hovering_s, self.cruising_s) {
            let [hovering, cruising] = [hovering_s, cruising_s].map(|time_s| scaled(time_s, "s"));
            rows.push(("battery: hovering, cruising", format!("{hovering}, {cruising}")));
        }
        rows.extend(self.nearest_site.map(|NearestSite { number, away_m, pads }| {
            let pads = if pads == 1 { "1 pad".to_owned() } else { format!("{pads} pads") };
            ("base: nearest to the start", format!("base.site[{number}], {} away, {pads}", scaled(away_m, "m")))
        }));
        rows.extend(self.charging_s.map(|charging_s| ("battery: charging", scaled(charging_s, "s"))));
        rows.extend(self.radius_m.map(|radius_m| ("out and back on a battery", scaled(radius_m, "m"))));
        rows.extend(self.timed_m.map(|timed_m| ("out and back in time", scaled(timed_m, "m"))));
        rows
    }

    /// The base is smaller than twice the position error.
    pub fn landing_warning(&self) -> Option<String> {
        let sigma = scaled(self.missed_by_m?, "m");
        Some(format!(
            "the UAV may miss the base again and again until its energy ends: slots end beside their waypoints by \
             {sigma}, and the base's rim is less than twice that from its middle"
        ))
    }

    /// The UAV cannot serve some SNs and come home in time, or on its battery.
    pub fn warning(&self) -> Option<String> {
        let what = match (self.radius_m, self.timed_m) {
            (Some(radius_m), Some(timed_m)) if timed_m < radius_m => "the mission is too short",
            (None, _) => "the mission is too short",
            _ => "the battery is too small",
        };
        (self.beyond > 0).then(|| {
            format!("{} sensor nodes are too far from the base to be served and returned from: {what}", self.beyond)
        })
    }
}

/// Whether `battery` does not last for the way home from the start of a UAV.
fn is_stranded(scenario: &Scenario, battery: &Battery) -> bool {
    let home = Home::of(scenario, &Arc::new(scenario.airspace()));
    let margin_j = |uav: usize| home.margin_j(0, battery.initial_j, &scenario.start_of(uav).xy());
    (0..scenario.uav.uavs()).any(|uav| margin_j(uav) < 0.0)
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use skysink_common::scenario::Overrides;
    use skysink_common::sensors::SensorList;

    use super::*;

    fn figures(keys: &str) -> Option<EnergyFigures> {
        let text = format!("name = 'a'\nslots = 10\n[area]\nside_m = 2000.0\n{keys}");
        let scenario = Scenario::parse(&text, Path::new("a.toml"), Overrides::default()).unwrap();
        let list = "x_m,y_m\n1000,1000\n1000,1150\n1000,1180\n1000,1900\n";
        let list = SensorList::parse(list, Path::new("list.csv"), &scenario).unwrap();
        EnergyFigures::of(&scenario, &list.sensors_of(&scenario))
    }

    #[test]
    fn a_battery_lasts_by_its_power_and_reaches_half_as_far_as_it_flies() {
        assert_eq!(figures(""), None);
        let keys = "[base]\ncharge_w = 90.0\n[uav.battery]\ncapacity_j = 10000.0\n";
        let figures = figures(keys).unwrap();
        // 9 kJ above the reserve: 168.49 W hovering, 126 W at 10.2 m/s, 90 W from the charger.
        assert!((figures.hovering_s.unwrap() - 9_000.0 / 168.49).abs() < 1e-9);
        assert!((figures.cruising_s.unwrap() - 9_000.0 / 126.0).abs() < 0.1, "{figures:?}");
        assert_eq!(figures.charging_s, Some(100.0));
        // About 9 J/m at 18 m/s: 1 km of flight.
        assert!((figures.radius_m.unwrap() - 500.0).abs() < 30.0, "{figures:?}");
        assert_eq!((figures.timed_m, figures.beyond, figures.stranded_warning()), (None, 1, None));
        // 100 m at 9 J/m are 0.9 kJ, and the reserve is another 0.1 kJ.
        let far = |capacity: &str| {
            let keys = format!("[base]\nposition_m = [1100.0, 1000.0]\n[uav.battery]\ncapacity_j = {capacity}\n");
            self::figures(&keys).unwrap().is_stranded
        };
        assert!(far("900.0") && !far("1300.0"));
        assert!(figures.warning().unwrap().starts_with("1 sensor nodes are too far from the base"));
        assert_eq!(figures.landing_warning(), None);
        let erring = |sigma: &str| self::figures(&format!("[uav]\nposition_error_m = {sigma}\n{keys}")).unwrap();
        assert!(erring("0.6").landing_warning().unwrap().contains("by 0.6 m") && erring("0.5").missed_by_m.is_none());
    }

    #[test]
    fn a_mission_with_landing_flies_outward_for_half_of_it() {
        // Ten slots of 30 m: 150 m out and back, 1 m of base and 10 m of range.
        let figures = figures("[uav]\nmust_land = true\n").unwrap();
        assert_eq!((figures.timed_m, figures.beyond, figures.hovering_s), (Some(151.0), 2, None));
        assert!(figures.warning().unwrap().ends_with("the mission is too short"));
    }
}
