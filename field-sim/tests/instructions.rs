//! A slot of the field does not take more instructions than it used to: see `instructions.txt`.

#[path = "../../tests/support/instructions.rs"]
mod instructions;

use std::fmt::Write;
use std::path::Path;

use instructions::{Case, counted};
use skysink_common::message::{FlightReport, Mode};
use skysink_common::scenario::{Overrides, Scenario};
use skysink_common::sensors::SensorList;
use skysink_field_sim::Field;

/// Slots of each case.
const SLOTS: u64 = 20;

/// Batteries that sleep, sample, wake for a UAV and harvest.
const BATTERIES: &str = "energy = { capacity_j = 5.0, sleep_w = 1e-4, sample_j_per_bit = 1e-7, wake_j = 0.01, tx_w = 0.1, harvest_w = 1e-3 }\n";

/// Advances a field of 10^4 sensor nodes with queues of 10 000 bit, buffers of `capacity_bits` and rates `rate_bps(i)`,
/// with these `keys` of `[sensors]`.
fn advance(capacity_bits: u32, keys: &str, rate_bps: impl Fn(u32) -> f64) {
    let text = format!("name = 'a'\n[sensors]\ncapacity_bits = {capacity_bits}\n{keys}");
    let scenario = Scenario::parse(&text, Path::new("a.toml"), Overrides::default()).unwrap();
    let mut list = "x_m,y_m,queue_bits,sampling_bps,gain_db\n".to_owned();
    (0..10_000).for_each(|id| writeln!(list, "1,2,10000,{},-52", rate_bps(id)).unwrap());
    let mut field = Field::new(&scenario, &SensorList::parse(&list, Path::new("list.csv"), &scenario).unwrap());
    let nobody = [FlightReport::at([50.0, 50.0, 20.0], Mode::Hold)];
    for slot in 1..=SLOTS {
        counted(|| field.step(slot, &nobody)).unwrap();
    }
}

fn main() -> std::process::ExitCode {
    let cases = [
        Case { name: "field, one rate, N = 10^4", steps: SLOTS, work: || advance(30_000, "", |_| 100.0) },
        Case { name: "field, all full, N = 10^4", steps: SLOTS, work: || advance(10_000, "", |_| 100.0) },
        Case {
            name: "field, a rate each, N = 10^4",
            steps: SLOTS,
            work: || advance(30_000, "", |id| 100.0 + f64::from(id % 100) / 10.0),
        },
        Case { name: "field, batteries, N = 10^4", steps: SLOTS, work: || advance(30_000, BATTERIES, |_| 100.0) },
        Case { name: "field, expiry, N = 10^4", steps: SLOTS, work: || advance(30_000, "expiry_s = 9\n", |_| 100.0) },
    ];
    instructions::main(&cases, &Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/instructions.txt"))
}
