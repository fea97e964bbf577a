//! A slot of the field beside a copy of its queues: all SNs sample the same, each at its own rate, or all are full.

use std::fmt::Write;
use std::hint::black_box;
use std::mem::MaybeUninit;
use std::path::Path;
use std::time::Duration;

use criterion::{Bencher, BenchmarkId, Criterion, criterion_group, criterion_main};
use skysink_common::ledger::Ledger;
use skysink_common::message::{FlightReport, Mode};
use skysink_common::scenario::{Overrides, Scenario};
use skysink_common::sensors::SensorList;
use skysink_field_sim::Field;
use skysink_field_sim::arrivals::arrival_bits;

/// Numbers of sensor nodes.
const COUNTS: [u32; 3] = [200, 10_000, 1_000_000];

/// A storage [bit] that no benchmark fills.
const ROOMY_BITS: u32 = 2_000_000_000;

fn scenario(capacity_bits: u32) -> Scenario {
    let text = format!("name = \"bench\"\n[sensors]\ncapacity_bits = {capacity_bits}\n");
    Scenario::parse(&text, Path::new("bench.toml"), Overrides::default()).expect("a valid scenario")
}

/// `count` SNs, with 10 000 bit each or full, at 100 bit/s or at a rate each.
fn list(scenario: &Scenario, count: u32, rate_bps: impl Fn(u32) -> f64) -> SensorList {
    let queue_bits = scenario.sensors.capacity_bits.min(10_000);
    let mut text = "x_m,y_m,queue_bits,sampling_bps\n".to_owned();
    for id in 0..count {
        let (x_m, y_m) = (f64::from(id % 1_000) / 10.0, f64::from(id / 1_000 % 1_000) / 10.0);
        writeln!(text, "{x_m},{y_m},{queue_bits},{}", rate_bps(id)).expect("a string has room");
    }
    SensorList::parse(&text, Path::new("list.csv"), scenario).expect("a valid list")
}

/// Slots from 1 on, with nobody served: in place, or into a buffer as well.
fn live(bencher: &mut Bencher, scenario: &Scenario, list: &SensorList, into: Option<&mut [MaybeUninit<u32>]>) {
    let mut field = Field::new(scenario, list);
    let nobody = FlightReport::at([50.0, 50.0, 20.0], Mode::Hold);
    let mut slot = 0;
    match into {
        None => bencher.iter(|| {
            slot += 1;
            field.step(slot, &nobody).expect("nobody is somebody")
        }),
        Some(queues_bits) => bencher.iter(|| {
            slot += 1;
            field.step_into(slot, &nobody, black_box(queues_bits)).expect("nobody is somebody")
        }),
    }
}

fn field(criterion: &mut Criterion) {
    let (roomy, narrow) = (scenario(ROOMY_BITS), scenario(100));
    for count in COUNTS {
        let mut group = criterion.benchmark_group(format!("a slot of the field, N = {count}"));
        group.warm_up_time(Duration::from_secs(1)).measurement_time(Duration::from_secs(2)).sample_size(30);
        let mut target = vec![MaybeUninit::new(0); count as usize];
        let same = list(&roomy, count, |_| 2.0);
        let queues_bits = same.queues_bits();
        let mut copy = queues_bits.clone();
        group.bench_function("copy of the queues", |bencher| {
            bencher.iter(|| black_box(&mut copy).copy_from_slice(black_box(&queues_bits)));
        });
        group.bench_function("one rate", |bencher| live(bencher, &roomy, &same, None));
        group.bench_function("one rate, into a message", |bencher| live(bencher, &roomy, &same, Some(&mut target)));
        let full = list(&narrow, count, |_| 100.0);
        group.bench_function("one rate, all full", |bencher| live(bencher, &narrow, &full, None));
        let each = list(&roomy, count, |id| 1.0 + f64::from(id % 1_013) / 1e3);
        group.bench_function("a rate each", |bencher| live(bencher, &roomy, &each, None));
        group.bench_function(BenchmarkId::from_parameter("one SN at a time, a rate each"), |bencher| {
            one_by_one(bencher, &each);
        });
        group.finish();
    }
}

/// The same books, kept SN by SN.
fn one_by_one(bencher: &mut Bencher, list: &SensorList) {
    let mut ledger = Ledger::new(ROOMY_BITS, list.queues_bits());
    let mean_bits: Vec<f64> = list.sensors().iter().map(|sensor| sensor.sampling_bps).collect();
    let mut slot = 0;
    bencher.iter(|| {
        slot += 1;
        let sample = |(sensor, &mean)| ledger.sample(sensor, arrival_bits(mean, slot), mean);
        mean_bits.iter().enumerate().map(sample).sum::<u64>()
    });
}

criterion_group!(benches, field);
criterion_main!(benches);
