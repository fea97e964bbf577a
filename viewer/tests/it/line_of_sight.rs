//! Missions over a channel with probabilistic line of sight, written to a file and read back.

use std::path::Path;

use crate::support::{Found, Slot, letter, sensors, town};
use skysink_common::channel::{Channel, LineOfSight, Uplink};
use skysink_common::geometry::elevation_deg;
use skysink_common::message::LinkReport;
use skysink_common::scenario::{Overrides, Scenario};
use skysink_viewer::los::{self, profile};
use skysink_viewer::{Scene, Sinks, WallClock, colour, legend, links, uav};

const SENSORS: u32 = 20;

fn link() -> LineOfSight {
    Channel::of(&town().link).line_of_sight().cloned().expect("the town has buildings")
}

/// Slot `slot` of a UAV that flies east by 1 m and climbs by 2 m, and serves two sensor nodes: that below it, in line
/// of sight in even slots, and the next, in line of sight in odd ones.
fn climb(slot: u64) -> Slot {
    let mut climb = Slot::new(slot, SENSORS as usize);
    let flight = &mut climb.flight;
    flight.z_m = 50.0 + 2.0 * slot as f64;
    for ahead in 0..2 * flight.served {
        flight.links[ahead as usize] = LinkReport {
            sensor: u32::try_from(slot).unwrap() + ahead,
            line_of_sight: u32::from((slot + u64::from(ahead)).is_multiple_of(2)),
            distance_m: f64::from(ahead),
            elevation_deg: elevation_deg(f64::from(ahead).powi(2), flight.z_m),
            rate_bps: 1e6,
            capacity_bits: 1_000,
        };
    }
    flight.served *= 2;
    climb
}

/// Records the given slots, those between as missed.
fn record(scenario: &Scenario, slots: &[Slot]) -> Found {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mission.rrd");
    let sinks = Sinks { save: Some(path.clone()), ..Sinks::default() };
    let mut scene = Scene::open(&sinks, scenario, &sensors(SENSORS), "test-run", WallClock::Unmeasured, None).unwrap();
    let mut next = 0;
    for slot in slots {
        if slot.slot > next {
            scene.log_missed(next..=slot.slot - 1).unwrap();
        }
        scene.log_slot(&slot.view()).unwrap();
        next = slot.slot + 1;
    }
    scene.close().unwrap();
    Found::read(&path)
}

fn town_until(last: u64) -> Found {
    record(&town(), &(0..=last).map(climb).collect::<Vec<_>>())
}

fn below(root: &str, name: &str) -> String {
    format!("{root}/{name}")
}

#[test]
fn the_altitude_curve_is_the_flown_one() {
    let found = town_until(9);
    let altitudes_m = found.curve(los::ALTITUDE);
    assert_eq!(altitudes_m, (0..=9).map(|slot| (slot, 50.0 + 2.0 * slot as f64)).collect());
    for (entity, component) in [(uav::TRAIL, "LineStrips3D:strips"), (uav::PLUMB, "LineStrips3D:strips")] {
        assert!(found.text(entity, component, Some(7)).contains("64.0"), "{entity}");
    }
    assert!(found.text(uav::UAV, "Transform3D:translation", Some(7)).contains("64.0"));
    assert!(found.text(los::MARK, "Points3D:labels", Some(7)).contains("64 m"));
}

#[test]
fn a_link_has_the_colour_and_the_width_of_its_draw() {
    let found = town_until(2);
    let written = |[r, g, b]: colour::Rgb| u32::from_be_bytes([r, g, b, 255]).to_string();
    let at = |component: &str, slot, word: &str| {
        let text = found.text(links::LINKS, component, Some(slot));
        text.find(word).unwrap_or_else(|| panic!("no {word} in slot {slot}: {text}"))
    };
    let sight = written(colour::SIGHT);
    let blocked = written(colour::BLOCKED);
    let colours = "LineStrips3D:colors";
    assert!(at(colours, 1, &blocked) < at(colours, 1, &sight), "slot 1: the second in sight");
    assert!(at(colours, 2, &sight) < at(colours, 2, &blocked), "slot 2: the first in sight");
    assert!(at("LineStrips3D:radii", 2, "-3.0") < at("LineStrips3D:radii", 2, "-1.4"), "points of the screen, below 0");
}

#[test]
fn the_curves_contain_probability_and_elevation_of_every_link() {
    let found = town_until(6);
    let probabilities =
        |slot: i64| [0.0, 1.0].map(|d2_m2| link().los_probability(&Uplink::at(1.0, d2_m2, 50.0 + 2.0 * slot as f64)));
    let means = found.curve(&below(los::PROBABILITY, los::MEAN));
    let sights = found.points(&below(los::PROBABILITY, los::SIGHT));
    let blocks = found.points(&below(los::PROBABILITY, los::BLOCKED));
    let drawn = |points: &[f64]| points.iter().copied().filter(|point| !point.is_nan()).collect::<Vec<_>>();
    assert!(means[&0].is_nan() && drawn(&sights[&0]).is_empty(), "nobody is served in slot 0");
    for slot in 1..=6 {
        let [under, ahead] = probabilities(slot);
        assert_eq!(means[&slot], (under + ahead) / 2.0, "slot {slot}");
        let (sight, block) = if slot % 2 == 0 { (under, ahead) } else { (ahead, under) };
        assert_eq!((drawn(&sights[&slot]), drawn(&blocks[&slot])), (vec![sight], vec![block]), "slot {slot}");
    }
    let angles_deg = found.points(&below(los::ELEVATION, los::SIGHT));
    assert_eq!(drawn(&angles_deg[&2]), [90.0]);
    assert_eq!(drawn(&angles_deg[&3]), [elevation_deg(1.0, 56.0)]);
}

#[test]
fn only_a_probabilistic_channel_shows_line_of_sight() {
    let roots = [los::SPACE, "metrics/los", profile::PROFILE, los::PAGE].map(|root| format!("/{root}"));
    let is_there = |found: &Found, root: &str| {
        found.cells.keys().any(|(entity, ..)| entity == root || entity.starts_with(&format!("{root}/")))
    };
    let has_tab = |found: &Found| found.layout.values().flatten().any(|value| value.contains("Line of sight"));
    let free_space = record(&letter(), &[Slot::new(0, SENSORS as usize), Slot::new(1, SENSORS as usize)]);
    let town = town_until(1);
    for root in roots {
        assert!(is_there(&town, &root) && !is_there(&free_space, &root), "{root}");
    }
    assert!(has_tab(&town) && !has_tab(&free_space));
    let page = town.text(los::PAGE, "TextDocument:text", None);
    assert!(page.contains("Why climb?") && page.contains("drawn anew in each slot"), "{page}");
    let page = town.text(legend::PAGE, "TextDocument:text", None);
    assert!(page.contains("altitudes from 20 m to 120 m") && page.contains("sight blocked"), "{page}");
}

#[test]
fn a_slot_without_service_clears_the_profile() {
    let mut slots: Vec<_> = [0, 1, 2, 3, 6].map(climb).into();
    slots[2].flight.served = 0;
    slots[3].flight.served = 1;
    let found = record(&town(), &slots);
    let cleared = |entity: &str, slot| !found.text(entity, "Clear:is_recursive", Some(slot)).is_empty();
    for entity in [profile::CURVES, profile::FLOWN] {
        let is_clear = [1, 2, 3, 4, 6].map(|slot| cleared(entity, slot));
        assert_eq!(is_clear, [false, true, false, true, false], "{entity}: nobody in 2, missed from 4 on");
    }
    assert!(found.curve(los::ALTITUDE)[&4].is_nan(), "a gap where slots were missed");
}

#[test]
fn at_a_fixed_altitude_the_profile_spans_half_below_and_half_above() {
    let text = "name = \"level\"\n[uav]\naltitude_m = 40.0\n[link]\nmodel = \"probabilistic-los\"\n";
    let level = Scenario::parse(text, Path::new("level.toml"), Overrides::default()).unwrap();
    let mut slot = climb(1);
    slot.flight.z_m = 40.0;
    let found = record(&level, &[climb(0), slot]);
    let ticks = found.text(&below(profile::PROFILE, "ticks"), "Points2D:labels", None);
    assert!(ticks.contains("20 m") && ticks.contains("60 m"), "{ticks}");
    let flown = found.text(profile::FLOWN, "LineStrips2D:strips", Some(1));
    assert_eq!(flown.matches("100.0").count(), 3, "in the middle of 200, from 0 to 100: {flown}");
    assert!(found.text(los::PAGE, "TextDocument:text", None).contains("its altitude is fixed"));
}
