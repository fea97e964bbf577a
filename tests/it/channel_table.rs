//! A channel of one's own, as a table of rates.

use expect_test::expect_file;

use crate::support::Place;

/// The settings of a table in `table.csv`.
pub const TABLE: &str = "link.model=table link.file=table.csv";

/// Rates that fall with the distance, at random by half, from 20 m.
pub fn table() -> String {
    let mut rows = String::from("distance_m,altitude_m,probability,rate_bps\n");
    for distance_m in [0, 4, 8] {
        for (probability, factor) in [(0.25, 1), (0.75, 3)] {
            rows += &format!("{distance_m},20,{probability},{}\n", factor * (60_000 - 5_000 * distance_m));
        }
    }
    rows
}

#[test]
fn an_impossible_table_is_refused() {
    let place = Place::new();
    place.scenario("smoke");
    place.write("good.csv", &table());
    place.assert_transcript(&expect_file!["transcripts/channel-table.txt"]);
}
