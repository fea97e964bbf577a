//! A slot of the field beside a copy of its queues: all SNs sample the same or each at its own rate, into roomy buffers
//! or into full ones.

use std::fmt::Write;
use std::hint::black_box;
use std::mem::MaybeUninit;
use std::path::Path;
use std::time::Duration;

use criterion::{Criterion, criterion_group, criterion_main};
use skysink_common::message::{FlightReport, Mode};
use skysink_common::scenario::{Overrides, Scenario};
use skysink_common::sensors::SensorList;
use skysink_field_sim::Field;

/// Numbers of sensor nodes.
const COUNTS: [u32; 3] = [200, 10_000, 1_000_000];

/// Buffers [bit]: one that no benchmark fills, and one that is full from the start.
const BUFFERS_BITS: [(&str, u32); 2] = [("roomy", 2_000_000_000), ("full", 100)];

fn scenario(capacity_bits: u32) -> Scenario {
    let text = format!("name = \"bench\"\n[sensors]\ncapacity_bits = {capacity_bits}\n");
    Scenario::parse(&text, Path::new("bench.toml"), Overrides::default()).expect("a valid scenario")
}

/// `count` SNs, with 10 000 bit each or full, at rates [bit/s] by SN.
fn list(scenario: &Scenario, count: u32, rate_bps: fn(u32) -> f64) -> SensorList {
    let queue_bits = scenario.sensors.capacity_bits.min(10_000);
    let mut text = "x_m,y_m,queue_bits,sampling_bps\n".to_owned();
    for id in 0..count {
        let (x_m, y_m) = (f64::from(id % 1_000) / 10.0, f64::from(id / 1_000 % 1_000) / 10.0);
        writeln!(text, "{x_m},{y_m},{queue_bits},{}", rate_bps(id)).expect("a string has room");
    }
    SensorList::parse(&text, Path::new("list.csv"), scenario).expect("a valid list")
}

/// Sampling rate [bit/s] of a sensor node, by id.
type Rate = fn(u32) -> f64;

fn field(criterion: &mut Criterion) {
    let nobody = FlightReport::at([50.0, 50.0, 20.0], Mode::Hold);
    let rates: [(&str, Rate); 2] = [("one rate", |_| 2.0), ("a rate each", |id| 1.0 + f64::from(id % 1_013) / 1e3)];
    for count in COUNTS {
        let mut group = criterion.benchmark_group(format!("a slot of the field, N = {count}"));
        group.warm_up_time(Duration::from_secs(1)).measurement_time(Duration::from_secs(2)).sample_size(30);
        let mut message = vec![MaybeUninit::new(0); count as usize];
        let queues_bits = vec![10_000; count as usize];
        let mut copy = queues_bits.clone();
        group.bench_function("copy of the queues", |bencher| {
            bencher.iter(|| black_box(&mut copy).copy_from_slice(black_box(&queues_bits)));
        });
        for (buffers, capacity_bits) in BUFFERS_BITS {
            for (rates, rate_bps) in rates {
                let scenario = scenario(capacity_bits);
                let list = list(&scenario, count, rate_bps);
                let mut field = Field::new(&scenario, &list);
                let mut slot = 0;
                group.bench_function(format!("{rates}, {buffers}"), |bencher| {
                    bencher.iter(|| {
                        slot += 1;
                        field.step(slot, &nobody).expect("nobody is somebody")
                    });
                });
                let mut field = Field::new(&scenario, &list);
                let mut slot = 0;
                group.bench_function(format!("{rates}, {buffers}, into a message"), |bencher| {
                    bencher.iter(|| {
                        slot += 1;
                        field.step_into(slot, &nobody, Some(black_box(&mut message))).expect("nobody is somebody")
                    });
                });
            }
        }
        group.finish();
    }
}

criterion_group!(benches, field);
criterion_main!(benches);
