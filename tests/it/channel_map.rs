//! Links by place: never better than the bound, and warned of where the map ends.

use expect_test::expect_file;
use skysink_common::channel::LinkMap;
use skysink_common::geometry::Position;
use skysink_common::scenario::{Overrides, Scenario};
use skysink_common::sensors::{SensorList, Sensors};
use skysink_common::stop::Stop;
use skysink_mission::Mission;
use skysink_planner::bound::mission_bound;

use crate::support::Place;

/// The settings of a map in `links.csv`, whose SNR becomes a rate by `rates.csv`.
pub const MAP: &str = "link.model=map link.file=links.csv link.rates=rates.csv link.residual_db=3.0";

/// More settings, of a planner that knows the law of the links alone, and of UAVs that hear those near them.
pub const LAW: &str = "link.residual_m=30.0 link.beacon_radius_m=20.0 link.law_snr_db=45.0 planner.links=law";

/// A hill of SNR in the middle of 100 m for all SNs, without links in a corner, and a flat map for SN 2.
pub fn links() -> String {
    let mut rows = String::from("sensor,x_m,y_m,z_m,snr_db\n2,0,0,20,7\n");
    for x_m in [0, 25, 50, 75, 100] {
        for y_m in [0, 25, 50, 75, 100] {
            let snr_db = 12 - ((x_m - 50i32).abs() + (y_m - 50i32).abs()) / 8;
            rows += &if x_m + y_m == 0 { format!(",{x_m},{y_m},20,\n") } else { format!(",{x_m},{y_m},20,{snr_db}\n") };
        }
    }
    rows
}

/// The rates of SNRs.
pub fn rates() -> String {
    "snr_db,rate_bps\n0,20000\n5,60000\n10,180000\n".to_owned()
}

fn write(place: &Place) {
    place.write("links.csv", &links());
    place.write("rates.csv", &rates());
}

#[test]
fn an_impossible_map_is_refused() {
    let place = Place::new();
    place.scenario("smoke");
    write(&place);
    place.assert_transcript(&expect_file!["transcripts/channel-map.txt"]);
}

/// The first sensor node of this list is named as the second one's id.
#[test]
fn grids_of_arrays_are_those_of_ids_whatever_sensor_nodes_are_named() {
    let place = Place::new();
    place.write("nodes.csv", "x_m,y_m,name\n10,10,1\n90,90,0\n");
    let arrays = LinkMap::of_arrays([vec![0.0], vec![0.0], vec![20.0]], &[2, 1, 1, 1], &[5e4, 9e4], None).unwrap();
    let text = "name = 'x'\nsensors.file = 'nodes.csv'\nlink = { model = 'map', file = 'links.csv' }\n";
    let first_bps = |overrides: Overrides| {
        let scenario = Scenario::parse(text, &place.path("x.toml"), overrides);
        let scenario = scenario.and_then(skysink_planner::settings::resolve).unwrap();
        scenario.link.map.unwrap().level(&Position::new(10.0, 10.0), &[0.0, 0.0, 20.0].into())
    };
    let names = "sensor,x_m,y_m,z_m,rate_bps\n0,0,0,20,50000\n1,0,0,20,90000\n";
    let named = LinkMap::parse(names, &place.path("links.csv"), None).unwrap();
    assert_eq!(named, arrays);
    place.write("links.csv", names);
    assert_eq!(first_bps(Overrides::default()), 9e4, "by name");
    assert_eq!(first_bps(Overrides { map: Some(arrays.clone().shared()), ..Overrides::default() }), 5e4);
    place.write("links.csv", &arrays.to_csv().0);
    assert_eq!(first_bps(Overrides::default()), 5e4, "and as a run keeps them");
}

#[test]
fn check_warns_of_a_map_that_ends_before_the_places_of_service() {
    let place = Place::new();
    place.write("nodes.csv", "x_m,y_m\n10,30\n55,30\n");
    let warned = |rows: &str, altitude_m: f64| {
        place.write("links.csv", &format!("sensor,x_m,y_m,z_m,rate_bps\n{rows}"));
        let text =
            format!("name = 'a'\narea.side_m = 100.0\nsensors.file = 'nodes.csv'\nuav.altitude_m = {altitude_m:?}\n");
        place.write("a.toml", &format!("{text}link = {{ model = 'map', file = 'links.csv', comm_radius_m = 10.0 }}\n"));
        let checked = place.run_ok(&["check", "a.toml"]).stderr;
        checked.lines().find(|line| line.contains("constant beyond")).map(str::to_owned)
    };
    // SN 0 is served from x = 0 to 20 m, SN 1 from 45 to 65 m: a cell less is enough.
    assert_eq!(warned(",0,30,20,9e4\n,30,30,20,9e4\n,60,30,20,9e4\n", 20.0), None);
    assert_eq!(warned(",7,30,20,9e4\n", 20.0), None, "the same everywhere");
    let short = warned(",0,30,20,9e4\n,20,30,20,9e4\n", 20.0).unwrap();
    let span = "x = 0 to 20, y = 30, z = 20 m";
    assert!(
        short
            .ends_with(&format!("the links of SN 1 are given for {span}: constant beyond, where they are served, too"))
    );
    let high = warned(",0,30,20,9e4\n,80,30,20,9e4\n", 50.0).unwrap();
    assert!(high.contains("z = 20 m, and those of 1 more sensor nodes: constant"), "{high}");
}

#[test]
fn no_flight_over_a_map_loses_less_than_the_bound() {
    let place = Place::new();
    write(&place);
    let mut tight = 0;
    for seed in 1..=20 {
        for (strategy, keys) in [
            ("horizon", ""),
            ("gfs", "residual_db = 4.0\n"),
            ("edf", "residual_db = 4.0\nservice = 'observed'\n"),
            ("tour", "residual_db = 4.0\nresidual_m = 20.0\n"),
            ("hover", "residual_db = 2.0\nlaw_snr_db = 40.0\n"),
        ] {
            let links = if keys.contains("law") { "planner.links = 'law'\n" } else { "" };
            let text = format!(
                "name = 'x'\nseed = {seed}\nslots = 60\nplanner.strategy = '{strategy}'\n{links}\
                 planner.horizon.iterations = 50\n[sensors]\ncount = 12\nsampling_bps = 9e3\n\
                 [link]\nmodel = 'map'\nfile = 'links.csv'\nrates = 'rates.csv'\n{keys}"
            );
            let scenario = Scenario::parse(&text, &place.path("x.toml"), Overrides::default()).unwrap();
            let scenario = skysink_planner::settings::resolve(scenario).unwrap();
            let list = SensorList::of(&scenario).unwrap();
            let mut mission = Mission::new(&scenario, &list).unwrap();
            mission.drive(&mut [], &Stop::default()).unwrap();
            let lost_bits = mission.header().totals.lost_bits;
            let sensors = Sensors::of(&scenario, &list.nodes());
            let bound = mission_bound(&scenario, &sensors, &list.queues_bits(), u64::MAX);
            assert!(bound.loss_bits <= lost_bits, "seed {seed}, {strategy}: {bound:?}, {lost_bits}");
            tight += u32::from(bound.loss_bits > 0);
        }
    }
    assert!(tight > 20, "{tight} bounds above 0");
}
