//! Missions written to a file and read back.

use std::collections::BTreeSet;
use std::net::{TcpListener, TcpStream};
use std::num::NonZeroU64;
use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

use crate::support::{Found, Slot, in_folder, letter, sensors};
use skysink_common::message::{FlightReport, HoldReason, Mode, PathPoint};
use skysink_viewer::{Scene, SceneError, Sinks, WallClock, curves, events, legend, links, path, queues, uav};

const SENSORS: u32 = 20;

fn open(path: &Path, count: u32) -> Scene {
    let sinks = Sinks { save: Some(path.to_owned()), ..Sinks::default() };
    Scene::open(&sinks, &letter(), &sensors(count), "test-run", WallClock::Unmeasured, None).unwrap()
}

/// Records slots 0 to `last`, each changed by `change` before.
fn record(path: &Path, last: u64, change: impl Fn(&mut Slot)) -> Found {
    let mut scene = open(path, SENSORS);
    for slot in 0..=last {
        let mut slot = Slot::new(slot, SENSORS as usize);
        change(&mut slot);
        scene.log_slot(&slot.view()).unwrap();
    }
    scene.close().unwrap();
    Found::read(path)
}

#[test]
fn every_slot_is_logged_for_every_changing_entity() {
    let found = in_folder(|path| record(path, 19, |_| {}));
    let all: BTreeSet<i64> = (0..=19).collect();
    for entity in [
        queues::BARS,
        uav::UAV,
        uav::TRAIL,
        uav::TRACK,
        uav::PLAN,
        links::LINKS,
        &format!("{}/0", links::CANDIDATES),
        links::CHOSEN,
        curves::LOSS,
        curves::FILL_MEAN,
        curves::FILL_MAX,
        curves::DELIVERED,
    ] {
        assert_eq!(found.slots_of(entity), all, "{entity}");
    }
    assert_eq!(found.slots_of(uav::BODY), [1].into(), "always east");
}

#[test]
fn unchanged_components_are_logged_once() {
    let found = in_folder(|path| record(path, 30, |_| {}));
    for entity in [uav::PLUMB, uav::COVERAGE] {
        assert_eq!(found.slots_of(entity), [0].into(), "{entity} moves with the UAV");
    }
    assert_eq!(found.slots_of_component(uav::WAYPOINT, "LineStrips3D:strips"), [0, 1].into(), "none before slot 1");
    assert_eq!(found.slots_of_component(links::CHOSEN, "LineStrips3D:strips"), [0, 1].into());
    assert_eq!(found.slots_of_component(links::CHOSEN, "Transform3D:translation"), (1..=30).collect());
    assert_eq!(found.slots_of(curves::MISSED), [0, 10, 20, 30].into(), "a curve that never changes has few points");
    let still = in_folder(|path| record(path, 30, |slot| slot.flight = FlightReport::at([1.0, 2.0, 3.0], Mode::Hold)));
    for entity in [uav::UAV, links::LINKS] {
        assert_eq!(still.slots_of(entity), [0].into(), "{entity}");
    }
    assert_eq!(still.slots_of(curves::DELIVERED), (0..=30).collect());
}

/// Records every 7th of 30 slots; some are missed.
fn record_some(missed: std::ops::RangeInclusive<u64>, change: impl Fn(&mut Slot)) -> Found {
    in_folder(|path| {
        let sinks = Sinks { save: Some(path.to_owned()), every: NonZeroU64::new(7), ..Sinks::default() };
        let mut scenario = letter();
        scenario.slots = 30;
        let mut scene = Scene::open(&sinks, &scenario, &sensors(SENSORS), "x", WallClock::Unmeasured, None).unwrap();
        for slot in (0..=30).filter(|slot| !missed.contains(slot)) {
            if slot == missed.end() + 1 {
                scene.log_missed(missed.clone()).unwrap();
            }
            let mut slot = Slot::new(slot, SENSORS as usize);
            change(&mut slot);
            scene.log_slot(&slot.view()).unwrap();
        }
        scene.close().unwrap();
        Found::read(path)
    })
}

#[test]
fn every_kth_slot_and_the_first_and_last_are_drawn() {
    let found = record_some(40..=40, |slot| match slot.slot {
        3 => slot.flight.hold = HoldReason::NoPlan as u32,
        10 => slot.flight.y_m = 77.0,
        _ => {}
    });
    for entity in [queues::BARS, uav::UAV, curves::LOSS, events::STATUS] {
        assert_eq!(found.slots_of(entity), [0, 7, 14, 21, 28, 30].into(), "{entity}");
    }
    assert!(found.text(events::LOG, "TextLog:text", Some(3)).contains("no plan in time"), "events are all there");
    let path = found.text(uav::TRAIL, "LineStrips3D:strips", Some(14));
    assert!(["7.0", "77.0", "14.0"].iter().all(|place| path.contains(place)), "the path is that of every slot: {path}");
    let leg = found.text(uav::PLAN, "LineStrips3D:strips", Some(14));
    assert!(leg.contains("13.0"), "a plan begins where its slot does: {leg}");
    let expected = 21.0 / (100.0 * f64::from(SENSORS));
    assert_eq!(found.curve(curves::LOSS)[&21], expected, "sums are of every slot");
    assert_eq!(found.slots_of(curves::MISSED), [0, 14, 21, 30].into());
}

#[test]
fn the_slot_after_missed_ones_is_drawn() {
    let found = record_some(10..=11, |_| {});
    assert_eq!(found.slots_of(uav::UAV), [0, 7, 12, 14, 21, 28, 30].into());
    assert_eq!(found.curve(curves::MISSED)[&12], 2.0);
    let path = |slot| found.text(uav::TRAIL, "LineStrips3D:strips", Some(slot));
    assert!(path(10).contains("9.0") && !path(12).contains("9.0"), "it ends where the gap begins");
}

#[test]
fn the_curves_agree_with_the_ledger() {
    let found = in_folder(|path| record(path, 12, |_| {}));
    for (slot, loss_rate) in found.curve(curves::LOSS) {
        let expected = slot as f64 / (100.0 * f64::from(SENSORS)); // slot² lost of 100 · slot sampled by each
        assert_eq!(loss_rate, expected, "slot {slot}");
    }
    assert_eq!(found.curve(curves::DELIVERED)[&7], 0.07); // 70 bits, in kbit
    assert_eq!(found.curve(curves::FILL_MAX)[&7], 0.7); // 700 of 1 000 bits
    assert!((found.curve(curves::FILL_MEAN)[&7] - 0.7).abs() < 1e-12);
    assert!(found.curve(curves::PLAN_LATENCY).is_empty() && found.curve(curves::PACE).is_empty());
}

#[test]
fn a_slot_without_service_has_no_links_and_circles() {
    let hold = |slot: &mut Slot| {
        if slot.slot == 3 {
            slot.plan = None;
            slot.flight = FlightReport::at([2.0, 50.0, 20.0], Mode::Hold);
            slot.flight.hold = HoldReason::NoPlan as u32;
        }
    };
    let found = in_folder(|path| record(path, 4, hold));
    let strips = |entity, slot| found.shown_in(entity, "LineStrips3D:strips", slot);
    let candidates: Vec<_> = (0..5).map(|candidate| format!("{}/{candidate}", links::CANDIDATES)).collect();
    for (slot, is_there) in [(2, true), (3, false), (4, true)] {
        assert_eq!(strips(links::LINKS, slot).contains("PrimitiveArray<Float32>"), is_there, "links of {slot}");
        assert_eq!(strips(links::CHOSEN, slot).contains("PrimitiveArray<Float32>"), is_there, "circle of {slot}");
        for entity in [uav::WAYPOINT, uav::PLAN] {
            assert_eq!(strips(entity, slot).contains("PrimitiveArray<Float32>"), is_there, "{entity} of {slot}");
        }
        for candidate in &candidates {
            assert_eq!(strips(candidate, slot).contains("PrimitiveArray<Float32>"), is_there, "{candidate} of {slot}");
        }
    }
    assert!(found.text(events::LANE, "StateChange:state", Some(3)).contains("hold"));
    assert!(found.text(events::LANE, "StateChange:state", Some(4)).contains("serve"));
    assert!(found.text(events::LOG, "TextLog:text", Some(3)).contains("no plan in time"));
}

/// Gives the slot a path with this number of points.
fn lead(slot: &mut Slot, points: u64) {
    let point = |i| PathPoint::of(0, &[(slot.slot + 3 * i) as f64, 50.0 + i as f64, 20.0].into());
    slot.path = (0..points).map(point).collect();
}

/// Whether a slot has an empty path (`Some(false)`) or one that is drawn.
fn drawn_path(found: &Found, slot: i64) -> Option<bool> {
    let drawn = |entity, component| {
        let text = found.text(entity, component, Some(slot));
        (!text.is_empty()).then(|| text.contains("PrimitiveArray<Float32>\n[\n  "))
    };
    let line = drawn(path::PATH, "LineStrips3D:strips");
    assert_eq!(drawn(path::TRACK, "LineStrips3D:strips"), line, "slot {slot}");
    for stops in [path::STOPS, path::TRACK_STOPS] {
        assert_eq!(drawn(stops, "Points3D:positions"), line, "slot {slot}");
    }
    line
}

#[test]
fn a_path_is_shown_in_its_slot_only() {
    let points = [0, 0, 1, 3, 64, 1, 0, 2];
    let found = in_folder(|path| record(path, 7, |slot| lead(slot, points[slot.slot as usize])));
    let drawn: Vec<_> = (0..=7).map(|slot| drawn_path(&found, slot)).collect();
    let expected = [None, None, None, Some(true), Some(true), Some(false), None, Some(true)];
    assert_eq!(drawn, expected, "from the first path on, every slot shows its own");
    let line = found.text(path::PATH, "LineStrips3D:strips", Some(3));
    for coordinate in ["3.0", "6.0", "9.0", "51.0", "52.0"] {
        assert!(line.contains(coordinate), "{coordinate}: {line}");
    }
    let stops = found.text(path::STOPS, "Points3D:positions", Some(3));
    assert!(stops.contains("52.0") && !stops.contains("50.0"), "the slot's own waypoint has its ring: {stops}");
}

#[test]
fn a_mission_without_paths_logs_no_path_entities() {
    let found = in_folder(|path| record(path, 9, |slot| lead(slot, slot.slot % 2)));
    for entity in [path::PATH, path::STOPS, path::TRACK, path::TRACK_STOPS] {
        assert!(found.slots_of(entity).is_empty(), "{entity}");
    }
    assert!(found.text(legend::PAGE, "TextDocument:text", None).contains("planned path after it"));
}

#[test]
fn a_missed_slot_shows_no_path() {
    let found = in_folder(|path| {
        let mut scene = open(path, SENSORS);
        for slot in [0, 1, 5] {
            if slot == 5 {
                scene.log_missed(2..=4).unwrap();
            }
            let mut slot = Slot::new(slot, SENSORS as usize);
            lead(&mut slot, 4);
            scene.log_slot(&slot.view()).unwrap();
        }
        scene.close().unwrap();
        Found::read(path)
    });
    let drawn = [1, 2, 3, 5].map(|slot| drawn_path(&found, slot));
    assert_eq!(drawn, [Some(true), Some(false), None, Some(true)]);
}

#[test]
fn equal_missions_make_equal_recordings_without_a_clock() {
    let [first, second] = [0, 1].map(|_| in_folder(|path| record(path, 20, |_| {})));
    let timelines: Vec<_> = first.timelines.iter().map(String::as_str).collect();
    assert_eq!(timelines, ["sim_time", "slot"]);
    assert_eq!(first, second);
    let other = in_folder(|path| record(path, 20, |slot| slot.flight.x_m += 1e-3));
    assert!(first != other, "a millimetre is seen");
}

#[test]
fn simulated_time_runs_with_the_slots() {
    let found = in_folder(|path| record(path, 3, |_| {}));
    for (_, _, slot, time_ns) in found.cells.keys() {
        assert_eq!(slot.map(|slot| slot * 1_000_000_000), *time_ns); // the letter's slots take 1 s
    }
}

#[test]
fn a_recording_contains_a_legend() {
    let found = in_folder(|path| record(path, 1, |_| {}));
    let seen = |name: &str| found.layout.values().flatten().any(|value| value.contains(name));
    for name in ["Field (3D)", "Top view", "Chase", "Loss and coverage", "Legend", "Events", "Queue fill"] {
        assert!(seen(name), "{name}");
    }
    let page = found.text(legend::PAGE, "TextDocument:text", None);
    for word in ["bar, blue", "transit", "uts", "100 m × 100 m"] {
        assert!(page.contains(word), "{word}: {page}");
    }
    assert!(found.text("__properties/mission", "strategy", None).contains("uts"));
    let start = found.text(events::LOG, "TextLog:text", Some(0));
    assert!(start.contains("start of mission letter"), "{start}");
    let end = found.text(events::LOG, "TextLog:text", Some(1));
    assert!(end.contains("end after slot 1 of 600") && end.contains("first loss, 1 bits"), "{end}");
}

#[test]
fn the_first_loss_is_logged_once() {
    let found = in_folder(|path| record(path, 9, |slot| slot.header.totals.lost_bits /= 16));
    let told = |slot| found.text(events::LOG, "TextLog:text", Some(slot)).contains("first loss");
    assert_eq!((0..=9).filter(|&slot| told(slot)).collect::<Vec<_>>(), [4]); // 4² / 16 = 1 bit
}

#[test]
fn missed_slots_are_marked_and_counted() {
    let found = in_folder(|path| {
        let mut scene = open(path, SENSORS);
        for slot in [0, 1, 2, 6, 7] {
            if slot == 6 {
                scene.log_missed(3..=5).unwrap();
            }
            scene.log_slot(&Slot::new(slot, SENSORS as usize).view()).unwrap();
        }
        scene.close().unwrap();
        Found::read(path)
    });
    assert!(found.text(events::LANE, "StateChange:state", Some(3)).contains("gap"));
    assert!(found.text(events::LANE, "StateChange:state", Some(6)).contains("serve"));
    assert!(found.text(events::LOG, "TextLog:text", Some(3)).contains("slots 3 to 5 missed"));
    assert!(found.text(events::LOG, "TextLog:text", Some(7)).contains("3 slots missed"));
    let missed: Vec<_> = found.curve(curves::MISSED).into_iter().collect();
    assert_eq!(missed, [(0, 0.0), (6, 3.0)]);
    let flown = |slot| found.text(uav::TRAIL, "LineStrips3D:strips", Some(slot)).contains("Float32>");
    assert!(flown(2) && !flown(6) && flown(7), "no straight line across a gap");
    assert!(!found.text(links::LINKS, "LineStrips3D:strips", Some(3)).contains("PrimitiveArray<Float32>"));
}

#[test]
fn states_are_plot_points_in_a_live_view() {
    let states = |live| {
        in_folder(|path| {
            let sinks = Sinks { save: Some(path.to_owned()), live, ..Sinks::default() };
            let mut scene =
                Scene::open(&sinks, &letter(), &sensors(SENSORS), "x", WallClock::Unmeasured, None).unwrap();
            for slot in [0, 1, 2, 6] {
                if slot == 6 {
                    scene.log_missed(3..=5).unwrap();
                }
                let mut slot = Slot::new(slot, SENSORS as usize);
                if slot.slot == 2 {
                    slot.flight.mode = Mode::EnRoute as u32;
                }
                scene.log_slot(&slot.view()).unwrap();
            }
            scene.close().unwrap();
            let found = Found::read(path);
            for state in ["serve", "en-route", "gap"] {
                assert!(found.text(events::LANE, "StateConfiguration:values", None).contains(state), "{state}");
            }
            ["serve", "en-route", events::GAP].map(|name| {
                let entity = format!("{}/{name}", events::STATES);
                let is_selected = found.layout.values().flatten().any(|value| value.contains(&entity));
                assert_eq!(is_selected, live.is_some(), "{entity}");
                found.curve(&entity)
            })
        })
    };
    assert_eq!(states(Some(0)), [[(1, 4.0), (6, 4.0)].into(), [(2, 2.0)].into(), [(3, 0.0)].into()]);
    assert_eq!(states(None), [[].into(), [].into(), [].into()], "a file has the lane");
}

#[test]
fn up_to_two_thousand_sensor_nodes_are_bars() {
    for (count, bars, points) in [(2_000, BTreeSet::from([0]), [].into()), (2_001, [].into(), BTreeSet::from([0]))] {
        let found = in_folder(|path| {
            let mut scene = open(path, count);
            scene.log_slot(&Slot::new(0, count as usize).view()).unwrap();
            scene.close().unwrap();
            Found::read(path)
        });
        assert_eq!(found.slots_of(queues::BARS), bars, "{count}");
        assert_eq!(found.slots_of(queues::POINTS), points, "{count}");
    }
}

#[test]
fn measured_wall_clock_times_are_curves() {
    let found = in_folder(|path| {
        let sinks = Sinks { save: Some(path.to_owned()), ..Sinks::default() };
        let mut scene = Scene::open(&sinks, &letter(), &sensors(SENSORS), "timed", WallClock::Measured, None).unwrap();
        let slot = Slot::new(1, SENSORS as usize);
        let view = skysink_viewer::SlotView { slots_per_s: Some(250.0), plan_ms: Some(0.5), ..slot.view() };
        scene.log_slot(&view).unwrap();
        scene.close().unwrap();
        Found::read(path)
    });
    assert_eq!(found.curve(curves::PACE)[&1], 250.0);
    assert_eq!(found.curve(curves::PLAN_LATENCY)[&1], 0.5);
}

#[test]
fn a_file_contains_all_batches_before_it_is_closed() {
    in_folder(|path| {
        let mut scene = open(path, SENSORS);
        scene.log_slot(&Slot::new(0, SENSORS as usize).view()).unwrap();
        let began = Instant::now();
        while !Found::try_read(path).is_some_and(|found| found.slots_of(uav::UAV).contains(&0)) {
            assert!(began.elapsed() < Duration::from_secs(60), "nothing written");
            std::thread::sleep(Duration::from_millis(50));
        }
        scene.close().unwrap();
    });
}

#[test]
fn a_path_that_cannot_be_written_is_named() {
    let path = Path::new("/nowhere/mission.rrd");
    let sinks = Sinks { save: Some(path.to_owned()), ..Sinks::default() };
    let refusal =
        Scene::open(&sinks, &letter(), &sensors(1), "x", WallClock::Unmeasured, None).err().unwrap().to_string();
    assert!(refusal.starts_with("recording /nowhere/mission.rrd: ") && !refusal.contains('\n'), "{refusal}");
}

#[test]
fn a_port_in_use_is_refused_before_a_file_is_created() {
    in_folder(|path| {
        std::fs::write(path, "precious").unwrap();
        let listener = TcpListener::bind(("127.0.0.1", 0)).unwrap();
        let port = listener.local_addr().unwrap().port();
        let sinks = Sinks { save: Some(path.to_owned()), live: Some(port), ..Sinks::default() };
        let refusal = Scene::open(&sinks, &letter(), &sensors(1), "x", WallClock::Measured, None).err().unwrap();
        assert!(matches!(refusal, SceneError::Port { .. }));
        let line = refusal.to_string();
        assert!(line.contains(&format!("port {port} ")) && !line.contains('\n'), "{line}");
        assert_eq!(std::fs::read_to_string(path).unwrap(), "precious");
    });
}

#[test]
fn a_scene_without_a_destination_is_refused() {
    let refusal =
        Scene::open(&Sinks::default(), &letter(), &sensors(1), "x", WallClock::Unmeasured, None).err().unwrap();
    assert!(matches!(refusal, SceneError::Nowhere));
}

#[test]
fn a_slot_with_another_number_of_queues_is_refused() {
    in_folder(|path| {
        let refusal = open(path, SENSORS).log_slot(&Slot::new(4, 19).view()).unwrap_err().to_string();
        assert_eq!(refusal, "slot 4: 19 queues: expected 20, one per sensor node of the list");
    });
}

#[test]
fn a_live_scene_listens_on_this_machine_and_writes_the_same_file() {
    in_folder(|path| {
        let port = TcpListener::bind(("127.0.0.1", 0)).unwrap().local_addr().unwrap().port();
        let sinks = Sinks { save: Some(path.to_owned()), live: Some(port), ..Sinks::default() };
        let mut scene = Scene::open(&sinks, &letter(), &sensors(SENSORS), "live", WallClock::Unmeasured, None).unwrap();
        let began = Instant::now();
        while TcpStream::connect(("127.0.0.1", port)).is_err() {
            assert!(began.elapsed() < Duration::from_secs(60), "nobody listens at port {port}");
            std::thread::sleep(Duration::from_millis(10));
        }
        scene.log_slot(&Slot::new(0, SENSORS as usize).view()).unwrap();
        scene.close().unwrap();
        assert_eq!(Found::read(path).slots_of(uav::UAV), BTreeSet::from([0]));
    });
}

#[test]
fn the_environment_variable_rerun_is_ignored() {
    let again = Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "recording::a_recording_contains_a_legend"])
        .env("RERUN", "off")
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&again.stdout);
    assert!(again.status.success() && said.contains("1 passed"), "{said}");
}
