//! The rules of `[[base.site]]`: several bases, each with a charger of its own (decision D34).

use super::base::SiteKeys;
use super::mission::Scenario;
use super::zones::{expected_of, is_led_to, toml_of};
use crate::airspace::{Airspace, MAX_CORNERS, Polygon};
use crate::base::{Base, BaseArea, BaseSite};
use crate::error::InputError;
use crate::geometry::Position;
use crate::slack::TIME_SLACK;

/// The base with these sites. A site without a shape is left out; a checked scenario has no such.
pub(super) fn base(scenario: &Scenario, sites: &[SiteKeys]) -> Base {
    let airspace = scenario.airspace_without_ways();
    let shape = |site: &SiteKeys| match &site.area_m {
        None => Some(Base::Disk { centre: site.position_m?.into(), radius_m: site.radius_m() }),
        Some(corners) => Some(Base::Areas([BaseArea::new(Polygon::of(corners, false).ok()?, &airspace)].into())),
    };
    let made = |site: &SiteKeys| Some(BaseSite { shape: shape(site)?, charger: site.charger(scenario.slot_s) });
    Base::Sites(sites.iter().filter_map(made).collect())
}

/// Checks the keys of the sites of `scenario`, and that no two overlap.
pub(super) fn check(scenario: &Scenario) -> Result<(), InputError> {
    let Some(sites) = scenario.base.as_ref().and_then(|base| base.site.as_ref()) else { return Ok(()) };
    if sites.is_empty() {
        return Err(scenario.refusal("base.site", &toml_of(sites), "at least one table, [[base.site]]"));
    }
    sites.iter().enumerate().try_for_each(|(index, site)| check_keys(scenario, index, site))?;
    let base = base(scenario, sites);
    let shapes: Vec<&Base> = base.shapes().collect();
    for (index, shape) in shapes.iter().enumerate() {
        if let Some(other) = shapes[..index].iter().position(|other| other.overlaps(shape)) {
            let (key, value) = place_of(index, &sites[index]);
            let expected = format!("a place that does not overlap with base.site[{other}]");
            return Err(scenario.refusal(&key, &value, &expected));
        }
    }
    Ok(())
}

/// The key that says where the site number `index` is, and its value.
fn place_of(index: usize, site: &SiteKeys) -> (String, toml::Value) {
    match (&site.area_m, &site.position_m) {
        (Some(corners), _) => (format!("base.site[{index}].area_m"), toml_of(corners)),
        (None, Some(position_m)) => (format!("base.site[{index}].position_m"), toml_of(position_m)),
        (None, None) => (format!("base.site[{index}]"), toml_of(site)),
    }
}

/// Checks the keys of the site number `index`.
fn check_keys(scenario: &Scenario, index: usize, site: &SiteKeys) -> Result<(), InputError> {
    let refuse = |key: &str, value: toml::Value, expected: &str| {
        Err(scenario.refusal(&format!("base.site[{index}].{key}"), &value, expected))
    };
    let (place, value) = place_of(index, site);
    let is_in_area = |&at: &[f64; 2]| scenario.area.contains(&Position::from(at), 0.0);
    match (&site.position_m, &site.area_m) {
        (Some(_), Some(_)) | (None, None) => {
            return Err(scenario.refusal(&place, &value, "either position_m, or area_m"));
        }
        (Some(position_m), None) if !is_in_area(position_m) => {
            return Err(scenario.refusal(&place, &value, "a position in the area"));
        }
        (None, Some(corners)) => {
            let expected = match Polygon::of(corners, false) {
                _ if corners.len() > MAX_CORNERS => Some("a polygon of fewer corners"),
                Ok(_) if corners.iter().all(is_in_area) => None,
                Ok(_) => Some("a polygon in the area"),
                Err(expected) => Some(expected),
            };
            if let Some(expected) = expected {
                return Err(scenario.refusal(&place, &value, expected));
            }
        }
        _ => {}
    }
    if let (Some(radius_m), Some(_)) = (site.radius_m, &site.area_m) {
        return refuse("radius_m", radius_m.into(), "none beside area_m");
    }
    let Some(swap_s) = site.swap_s else { return Ok(()) };
    if let Some(charge_w) = site.charge_w {
        return refuse("charge_w", charge_w.into(), "either charge_w or swap_s, not both");
    }
    let is_slot = swap_s * (1.0 + TIME_SLACK) >= scenario.slot_s;
    let expected = format!("at least the slot's {} s", scenario.slot_s);
    if is_slot { Ok(()) } else { refuse("swap_s", swap_s.into(), &expected) }
}

/// Checks that the UAV can fly to each site of `base`.
pub(super) fn check_ways(scenario: &Scenario, base: &Base, airspace: &Airspace) -> Result<(), InputError> {
    let Some(index) = base.shapes().position(|shape| !is_led_to(airspace, shape)) else { return Ok(()) };
    let keys = scenario.base.as_ref().and_then(|base| base.site.as_ref()).into_iter().flatten().nth(index);
    let (key, value) = place_of(index, keys.expect("a site has its keys"));
    Err(scenario.refusal(&key, &value, &expected_of(airspace, "a site")))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::Charger;
    use crate::scenario::Overrides;
    use std::path::Path;

    fn read(keys: &str) -> Result<Scenario, InputError> {
        let text = format!("name = 'a'\nslots = 100\nslot_s = 2.0\n{keys}");
        Scenario::parse(&text, Path::new("a.toml"), Overrides::default())
    }

    #[test]
    fn impossible_sites_are_refused_in_one_line() {
        let site = "[[base.site]]\nposition_m = [20, 20]\nradius_m = 5.0\n";
        for (keys, expected) in [
            (
                "[[base.site]]\nradius_m = 5.0\n",
                "base.site[0] = { radius_m = 5.0 }: expected either position_m, or area_m",
            ),
            (
                "[[base.site]]\nposition_m = [1, 1]\narea_m = [[0, 0], [9, 0], [9, 9]]\n",
                "base.site[0].area_m = [[0.0, 0.0], [9.0, 0.0], [9.0, 9.0]]: expected either position_m, or area_m",
            ),
            (
                "[[base.site]]\nradius_m = 1.0\narea_m = [[0, 0], [9, 0], [9, 9]]\n",
                "base.site[0].radius_m = 1.0: expected none beside area_m",
            ),
            ("[[base.site]]\narea_m = [[0, 0], [9, 0], [18, 0]]\n", "base.site[0].area_m = "),
            (
                "[[base.site]]\nposition_m = [101, 1]\n",
                "base.site[0].position_m = [101.0, 1.0]: expected a position in the area",
            ),
            (&format!("{site}pads = 0\n"), "base.site[0].pads = 0: expected 1 to 64"),
            (&format!("{site}charge_w = -1.0\n"), "base.site[0].charge_w = -1.0: expected a finite number, 0 or above"),
            (
                &format!("{site}charge_w = 0.0\nswap_s = 9.0\n"),
                "base.site[0].charge_w = 0.0: expected either charge_w or swap_s, not both",
            ),
            (&format!("{site}swap_s = 1.9\n"), "base.site[0].swap_s = 1.9: expected at least the slot's 2 s"),
            (
                &format!("{site}{site}"),
                "base.site[1].position_m = [20.0, 20.0]: expected a place that does not overlap with base.site[0]",
            ),
            (
                &format!("{site}[[base.site]]\narea_m = [[22, 15], [40, 15], [40, 40]]\n"),
                "base.site[1].area_m = [[22.0, 15.0], [40.0, 15.0], [40.0, 40.0]]: expected a place that does not overlap with",
            ),
            (
                &format!("[base]\nradius_m = 5.0\n{site}"),
                "base.radius_m = 5.0: expected either [[base.site]], or position_m",
            ),
            (&format!("[base]\ncharge_w = 5.0\n{site}"), "base.charge_w = 5.0: expected none beside [[base.site]]"),
            ("base.site = []\n", "base.site = []: expected at least one table, [[base.site]]"),
            (
                &format!("[area]\nno_fly = [{{ polygon_m = [[10, 10], [30, 10], [30, 30], [10, 30]] }}]\n{site}"),
                "base.site[0].position_m = [20.0, 20.0]: expected a site that the UAV can fly to",
            ),
        ] {
            let error = read(keys).unwrap_err().to_string();
            assert!(error.starts_with("scenario a.toml: ") && !error.contains('\n'), "{error}");
            assert!(error.contains(expected), "{error}: expected {expected}");
        }
    }

    #[test]
    fn polygons_overlap_where_they_cross_or_one_holds_the_other() {
        let area = |keys: &str| format!("[[base.site]]\narea_m = {keys}\n");
        let square = area("[[10, 10], [30, 10], [30, 30], [10, 30]]");
        for (other, overlap) in [
            ("[[15, 15], [20, 15], [20, 20]]", true),
            ("[[5, 5], [35, 5], [35, 35], [5, 35]]", true),
            ("[[0, 18], [40, 18], [40, 22], [0, 22]]", true), // a cross
            ("[[31, 10], [50, 10], [50, 30]]", false),
        ] {
            assert_eq!(read(&(square.clone() + &area(other))).is_err(), overlap, "{other}");
        }
    }

    #[test]
    fn a_site_is_its_shape_and_its_charger() {
        let keys = "[[base.site]]\nposition_m = [20, 20]\nradius_m = 5.0\ncharge_w = 90.0\npads = 2\n\
                    [[base.site]]\narea_m = [[60, 60], [80, 60], [80, 80], [60, 80]]\nswap_s = 5.0\n";
        let base = read(keys).unwrap().landing_base().unwrap();
        let [west, east, outside] = [[23.0, 20.0], [61.0, 79.0], [40.0, 40.0]].map(Position::from);
        assert_eq!([west, east, outside].map(|at| base.site_at(&at)), [Some(0), Some(1), None]);
        let charger = |at| *base.charger_at(at).unwrap();
        assert_eq!(charger(&west), Charger { charge_w: 90.0, swap_slots: None, pads: 2 });
        // 5 s are two and a half slots of 2 s: three.
        assert_eq!(charger(&east), Charger { charge_w: 0.0, swap_slots: Some(3), pads: 64 });
        // 15 m from the rim of the disk, 20 √2 m from the corner of the square.
        assert_eq!(base.nearest(&Position::new(40.0, 20.0)), Position::new(25.0, 20.0));
        assert!((base.nearest(&outside).x - 20.0 - 5.0 / 2f64.sqrt()).abs() < 1e-12);
        assert!((base.away_m(&Position::new(40.0, 20.0)) - 15.0).abs() < 1e-12 && !base.contains(&outside));
        let names: Vec<String> = base.names().map(|(_, name)| name).collect();
        assert_eq!(names, ["base 0: 2 pads", "base 1: 64 pads"]);
    }
}
