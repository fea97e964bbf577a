use std::path::Path;

use proptest::prelude::*;

use super::*;
use crate::channel::Channel;

/// Rates of the CQI 1 to 15 with 1.4 Mbit/s for each bit/s/Hz, by their SNRs, in bit/s.
const CQI: &str = "snr_db,rate_bps\n-6.7,210e3\n-4.7,322e3\n-2.3,532e3\n0.2,840e3\n2.4,1232e3\n4.3,1652e3\n5.9,2072e3\n\
                   8.1,2674e3\n10.3,3374e3\n11.7,3822e3\n14.1,4648e3\n16.3,5460e3\n18.7,6328e3\n21.0,7168e3\n22.7,7770e3\n";

fn steps(text: &str) -> Vec<[f64; 2]> {
    LinkMap::parse_steps(text, Path::new("rates.csv")).unwrap()
}

fn map(rows: &str) -> LinkMap {
    let text = format!("sensor,x_m,y_m,z_m,snr_db\n{rows}");
    LinkMap::parse(&text, Path::new("links.csv"), Some(steps(CQI))).unwrap()
}

fn channel(map: LinkMap, residual_db: f64, residual_m: Option<f64>) -> MapChannel {
    MapChannel { map: map.shared(), residual_db, residual_m, is_observed: false, law: None, comm_s: 1.0 }
}

fn uplink(level: f64) -> Uplink {
    Uplink { level, ..Uplink::at(1.0, 0.0, 20.0) }
}

/// A cell of 10 m, 20 m and 30 m with the levels 0 to 7 dB at its corners.
fn cell() -> LinkMap {
    map(",0,0,0,0\n,0,0,30,1\n,0,20,0,2\n,0,20,30,3\n,10,0,0,4\n,10,0,30,5\n,10,20,0,6\n,10,20,30,7\n")
}

#[test]
fn levels_are_trilinear_within_the_grid_and_constant_beyond() {
    let sensor = Position::origin();
    // 4 x/10 + 2 y/20 + z/30.
    for (at, level) in [
        ([2.5, 5.0, 15.0], 1.0 + 0.5 + 0.5),
        ([10.0, 20.0, 30.0], 7.0),
        ([-9.0, 10.0, 0.0], 1.0),
        ([99.0, 99.0, 99.0], 7.0),
    ] {
        assert_eq!(cell().level(&sensor, &Point3::from(at)), level, "{at:?}");
    }
}

#[test]
fn a_cell_with_an_empty_corner_has_no_link() {
    let half = map(",0,0,20,5\n,10,0,20,5\n,20,0,20,\n");
    let level = |x_m: f64| half.level(&Position::origin(), &Point3::new(x_m, 0.0, 20.0));
    assert_eq!([level(5.0), level(10.0), level(10.1), level(20.0), level(30.0)], [5.0, 5.0, NO_LINK, NO_LINK, NO_LINK]);
    let channel = channel(half, 3.0, None);
    assert_eq!(channel.expected_rate_bps(&uplink(NO_LINK)), 0.0);
    let draw = channel.draw(&uplink(NO_LINK), &Streams::new(1), 1, 0);
    assert_eq!(draw, Draw { line_of_sight: false, rate_bps: 0.0 });
}

#[test]
fn the_rate_is_that_of_the_highest_step_reached() {
    let channel = channel(map(",0,0,0,30\n"), 0.0, None);
    for (snr_db, rate_bps) in [(-6.71, 0.0), (-6.7, 210e3), (10.0, 2_674e3), (22.69, 7_168e3), (22.7, 7_770e3)] {
        assert_eq!(channel.expected_rate_bps(&uplink(snr_db)), rate_bps, "{snr_db} dB");
    }
    // 1.4 Mbit/s times the efficiencies of the CQI.
    let efficiencies = [0.15, 0.23, 0.38, 0.60, 0.88, 1.18, 1.48, 1.91, 2.41, 2.73, 3.32, 3.90, 4.52, 5.12, 5.55];
    for ([_, rate_bps], efficiency) in steps(CQI).iter().zip(efficiencies) {
        assert!((rate_bps - 1.4e6 * efficiency).abs() < 1e-6, "{efficiency}");
    }
}

/// 20 lg(γ/D): the SNR of the paper's link, 10^6.5 at 1 m, and of a map with it at its nodes.
#[test]
fn a_map_of_free_space_is_free_space_at_its_nodes() {
    let snr_db = |x_m: f64| 65.0 - 10.0 * (x_m * x_m + 400.0).log10();
    let places = [0.0, 3.0, 7.0, 10.0];
    let rows: String = places.iter().map(|&x_m| format!(",{x_m},0,20,{}\n", snr_db(x_m))).collect();
    let rates: String = (0..400).map(|step| format!("{},{}\n", f64::from(step) * 0.1, 1.0 + f64::from(step))).collect();
    let steps = steps(&format!("snr_db,rate_bps\n{rates}"));
    let map = LinkMap::parse(&format!("sensor,x_m,y_m,z_m,snr_db\n{rows}"), Path::new("a"), Some(steps)).unwrap();
    for x_m in places {
        let at = Point3::new(x_m, 0.0, 20.0);
        assert_eq!(map.level(&Position::origin(), &at), snr_db(x_m));
        let law = LinkLaw { snr_db: 65.0, exponent: 2.0 };
        let by_law_db = law.snr_db(&Uplink::new(1.0, &Position::origin(), &at));
        assert!((by_law_db - snr_db(x_m)).abs() < 1e-9, "{by_law_db} dB");
    }
    assert!(map.level(&Position::origin(), &Point3::new(5.0, 0.0, 20.0)) < snr_db(5.0), "linear in dB between");
}

#[test]
fn the_expected_rate_sums_over_the_steps() {
    let of = |residual_m| channel(map(",0,0,0,30\n"), 2.0, residual_m);
    // Far above all steps, half-way at the first, and no less than 7 σ below it.
    assert!((of(None).expected_rate_bps(&uplink(60.0)) - 7_770e3).abs() < 1e-3);
    let first = "snr_db,rate_bps\n10,1000\n";
    let text = "sensor,x_m,y_m,z_m,snr_db\n,0,0,0,10\n";
    let single = channel(LinkMap::parse(text, Path::new("a"), Some(steps(first))).unwrap(), 2.0, None);
    // 1000 Φ(0), and 1000 Φ(−1) = 158.655.
    assert!((single.expected_rate_bps(&uplink(10.0)) - 500.0).abs() < 1e-9);
    assert!((single.expected_rate_bps(&uplink(8.0)) - 158.655_253_931).abs() < 1e-6);
    let streams = Streams::new(3);
    let drawn = |slot: u64| single.draw(&uplink(8.0), &streams, slot, 4).rate_bps;
    let mean = (1..=40_000).map(drawn).sum::<f64>() / 40_000.0;
    assert!((mean - 158.655).abs() < 9.0, "{mean}");
    // A residual that stays is assumed to be the best.
    assert_eq!(of(Some(30.0)).best_drawn_rate_bps(&uplink(0.0), &streams, 1, 0), 7_770e3);
}

#[test]
fn a_planner_with_a_law_knows_no_places() {
    let law = LinkLaw { snr_db: 50.0, exponent: 2.5 };
    let known = Channel::Map(channel(cell(), 1.0, None));
    let believed = known.by_law(law);
    let at = Point3::new(3.0, 4.0, 12.0); // 13 m: 50 − 25 lg 13 = 22.15 dB
    let uplink = believed.uplink(1.0, &Position::origin(), &at);
    assert!((law.snr_db(&uplink) - 22.151).abs() < 1e-3);
    assert!(believed.map().is_none() && !believed.depends_on_place() && believed.is_random());
    let slope = believed.slopes(&uplink).by_distance2;
    let rate_bps = |d2_m2: f64| believed.expected_rate_bps(&Uplink { d2_m2, ..uplink });
    let difference = (rate_bps(uplink.d2_m2 + 1e-3) - rate_bps(uplink.d2_m2 - 1e-3)) / 2e-3;
    assert!(slope < 0.0 && (slope / difference - 1.0).abs() < 1e-4, "{slope}, {difference}");
}

#[test]
fn a_written_map_reads_back_exactly() {
    let text = "sensor,x_m,y_m,z_m,snr_db\n,0,0,0,1.5\n,1,0,0,\n7,0,0,0,-3\n\"a, b\",0,0,0,4\n";
    let map = LinkMap::parse(text, Path::new("a"), Some(steps(CQI))).unwrap();
    let (levels, rates) = map.to_csv();
    let again = LinkMap::parse(&levels, Path::new("b"), Some(steps(&rates.unwrap()))).unwrap();
    assert_eq!(again, map);
    let map = map.shared();
    assert!(Arc::ptr_eq(&again.shared(), &map), "held once");
    let rates = LinkMap::parse("sensor,x_m,y_m,z_m,rate_bps\n,0,0,0,70\n", Path::new("a"), None).unwrap();
    assert_eq!((rates.rate_bps(70.0), rates.to_csv().1), (70.0, None));
}

#[test]
fn maps_of_the_places_of_each_seed_share_their_grids() {
    let text = "sensor,x_m,y_m,z_m,snr_db\n7,0,0,0,-3\n8,0,0,0,4\n";
    let map = LinkMap::parse(text, Path::new("a"), Some(steps(CQI))).unwrap();
    let [one, other] = [0.0, 1.0].map(|x| map.clone().at_places(&[Position::new(x, 0.0), Position::new(x, 1.0)]));
    assert!(one != other && std::sync::Arc::ptr_eq(&one.grids, &other.grids));
}

#[test]
fn an_invalid_map_is_refused() {
    let head = "sensor,x_m,y_m,z_m,snr_db\n";
    for (text, message) in [
        ("a,b\n".to_owned(), "header `a,b`: expected sensor,x_m,y_m,z_m,snr_db"),
        (format!("{head},0,0,0,x\n"), "line 2: `,0,0,0,x`: expected a sensor or nothing"),
        (
            format!("{head},0,0,0,301\n"),
            "line 2: `,0,0,0,301`: expected a sensor or nothing, three finite numbers, and -300",
        ),
        (format!("{head},0,0,inf,1\n"), "line 2: `,0,0,inf,1`: expected a sensor or nothing"),
        (format!("{head},0,0,0,1\n,0,0,0,2\n"), "sensor ``, x_m = 0, y_m = 0, z_m = 0 twice: expected it once"),
        (format!("{head},0,0,0,1\n,5,9,0,1\n"), "no row with sensor ``, x_m = 0, y_m = 9, z_m = 0: expected one for"),
        (format!("{head}3,0,0,0,1\n,5,9,0,1\n,4,9,0,1\n3,1,1,0,1\n"), "no row with sensor `3`, x_m = 0, y_m = 1"),
        (head.to_owned(), "line 1: no rows: expected a row for each point"),
        ("sensor,x_m,y_m,z_m,rate_bps\n,0,0,0,-1\n".to_owned(), "and a rate from 0 to 1e300 or nothing"),
    ] {
        let error = LinkMap::parse(&text, Path::new("a.csv"), Some(steps(CQI))).unwrap_err().to_string();
        assert!(error.contains(message), "{error}");
    }
    let error = LinkMap::parse(&format!("{head},0,0,0,1\n"), Path::new("a.csv"), None).unwrap_err().to_string();
    assert!(error.ends_with("snr_db: expected the rates of each SNR as link.rates, or rate_bps"), "{error}");
    for (rows, message) in [
        ("1,5\n1,6\n", "snr_db = 1, rate_bps = 6: expected ascending steps"),
        ("1,5\n2,5\n", "snr_db = 2, rate_bps = 5: expected ascending steps"),
        ("1,-5\n", "line 2: `1,-5`: expected a finite SNR and a rate from 0 to 1e300"),
        ("", "no rows: expected a row for each step"),
    ] {
        let error = LinkMap::parse_steps(&format!("snr_db,rate_bps\n{rows}"), Path::new("a.csv")).unwrap_err();
        assert!(error.to_string().contains(message), "{error}");
    }
}

proptest! {
    #[test]
    fn no_place_is_better_than_the_highest_node(
        levels in prop::collection::vec(-30.0..30.0f64, 12),
        at in (-5.0..15.0f64, -5.0..25.0f64, 0.0..40.0f64),
    ) {
        let node = |index: usize| format!(",{},{},{},{}\n", 5 * (index / 4), 20 * (index / 2 % 2), 30 * (index % 2), levels[index]);
        let map = map(&(0..12).map(node).collect::<String>());
        let sensor = Position::new(1.0, 2.0);
        prop_assert!(map.level(&sensor, &Point3::new(at.0, at.1, at.2)) <= map.highest_level(&sensor));
    }

    #[test]
    fn no_draw_exceeds_the_best_rate(level in -20.0..30.0f64, lower in 0.0..9.0f64, slot in 1u64..1_000) {
        let channel = channel(map(",0,0,0,30\n"), 4.0, None);
        let streams = Streams::new(2);
        let drawn_bps = channel.draw(&uplink(level - lower), &streams, slot, 1).rate_bps;
        prop_assert!(drawn_bps <= channel.best_drawn_rate_bps(&uplink(level), &streams, slot, 1));
        prop_assert!(drawn_bps <= channel.best_rate_bps(&uplink(level)));
        prop_assert!(channel.expected_rate_bps(&uplink(level - lower)) <= channel.expected_rate_bps(&uplink(level)) + 1e-6);
    }
}
