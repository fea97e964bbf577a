//! A run on record: what of it is resumed, replayed and replaced, and what is refused.

use std::fs::{self, OpenOptions};
use std::io::Write as _;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::time::Duration;

use skysink_common::message::{FlightReport, Mode, QueuesHeader, SlotHeader, SolverOutcome, Totals};
use skysink_common::pace::Pace;
use skysink_common::scenario::{Overrides, Scenario};
use skysink_common::sensors::SensorList;
use skysink_common::slot_record::SlotRecord;
use skysink_common::stop::Stop;
use skysink_common::written_file::{Extent, FileChange};
use skysink_mission::drive::SlotSink;
use skysink_mission::figures::Summary;
use skysink_mission::folder::Earlier;
use skysink_mission::origin::{RunMode, SourceFile};
use skysink_mission::record::RunFolder;
use skysink_mission::recorded::RecordedLines;
use skysink_mission::slot_log::SlotLog;
use skysink_mission::summary::EnergyUse;
use skysink_mission::tally::Tally;
use skysink_mission::trace::{RecordedSlot, TraceHash};
use skysink_mission::{Mission, MissionError, Replay};
use skysink_planner::settings;
use tempfile::TempDir;

const SLOTS: u64 = 8;

/// A mission with losses, and a folder to put its run into.
struct Case {
    scenario: Scenario,
    list: SensorList,
    place: TempDir,
}

impl Case {
    fn new() -> Self {
        let text = format!("name = 'x'\nslots = {SLOTS}\n[sensors]\nsampling_bps = [50.0, 9000.0]\n");
        let scenario = Scenario::parse(&text, Path::new("x.toml"), Overrides::default());
        let scenario = scenario.and_then(settings::resolve).unwrap();
        let list = SensorList::of(&scenario).unwrap();
        Self { scenario, list, place: tempfile::tempdir().unwrap() }
    }

    fn out(&self) -> PathBuf {
        self.place.path().join("run")
    }

    fn file(&self, name: &str) -> PathBuf {
        self.out().join(name)
    }

    fn mission(&self) -> Mission {
        Mission::new(&self.scenario, &self.list).unwrap()
    }

    fn create(&self, pace: Option<Pace>, force: bool) -> Result<RunFolder, String> {
        let run_mode = RunMode { pace, ..RunMode::default() };
        let folder =
            RunFolder::create(Some(&self.out()), Earlier::by_force(force), &self.scenario, &self.list, &run_mode);
        folder.map_err(|error| error.to_string())
    }

    /// A run of the first slots on record, in a ring or in one process, with its summary.
    fn flown(self, pace: Option<Pace>, slots: u64) -> Self {
        let folder = self.create(pace, false).unwrap();
        let mut log = folder.slot_log().unwrap();
        let mut tally = Tally::new(&self.scenario, &self.list, folder.run_mode());
        tally.start(&self.mission().header());
        for record in self.mission().take(slots as usize) {
            log.add(&record).unwrap();
            tally.add(&record).unwrap();
        }
        folder.write_summary(&tally.summary(Duration::ZERO, log.hash())).unwrap();
        self
    }

    /// Repeats the first lines of the trace, and says of each whether it was as recorded.
    fn repeated(&self, slots: usize) -> (RunFolder, SlotLog, Vec<bool>) {
        let folder = RunFolder::reopen(&self.out()).unwrap();
        let (mut log, reader) = folder.reopen_slot_log().unwrap();
        let mut lines = RecordedLines::new(&folder, reader, &self.scenario);
        let mut are_same = Vec::new();
        for record in self.mission().take(slots) {
            assert!(lines.next_slot().unwrap().is_some());
            are_same.push(log.repeat(lines.lines(), record.flights(), &record.header).unwrap());
        }
        (folder, log, are_same)
    }

    fn trace(&self) -> String {
        fs::read_to_string(self.file("slots.csv")).unwrap()
    }

    fn write_trace(&self, text: &str) {
        fs::write(self.file("slots.csv"), text).unwrap();
    }

    /// The summary of the run, flown again, as JSON.
    fn replayed(&self) -> Result<String, String> {
        let replayed = Replay::open(&self.out()).and_then(|mut replay| {
            replay.drive(&mut [], &Stop::default())?;
            Ok(json(replay.summary()))
        });
        replayed.map_err(|error| error.to_string())
    }

    fn assert_refused(&self, why: &str) {
        let refusal = self.replayed().expect_err("nothing was refused");
        assert!(refusal.contains(why), "{refusal}");
    }
}

fn json(summary: &Summary) -> String {
    serde_json::to_string(summary).unwrap()
}

#[test]
fn a_ring_trace_is_replayed_only_if_its_check_value_matches() {
    let case = Case::new().flown(Some(Pace::Max), 5);
    let (_, log, are_same) = case.repeated(5);
    assert_eq!((are_same, log.last_checked(), log.was_checked()), (vec![true; 5], Some(5), true));
    drop(log);
    let mut check = fs::read(case.file("slots.check")).unwrap();
    check[8] ^= 1; // the first byte of the hash
    fs::write(case.file("slots.check"), check).unwrap();
    assert_eq!(case.repeated(5).2, [true, true, true, true, false], "it is of slot 5 alone");
}

#[test]
fn a_check_value_may_lag_the_trace_by_one_slot() {
    let case = Case::new().flown(Some(Pace::Max), 5);
    let before = fs::read(case.file("slots.check")).unwrap();
    for (slot, was_checked) in [(4, true), (3, false)] {
        fs::write(case.file("slots.check"), [&[slot][..], &before[1..]].concat()).unwrap();
        assert_eq!(case.repeated(5).1.was_checked(), was_checked, "of slot {slot}");
    }
}

#[test]
fn slots_that_were_not_replayed_are_cut_and_flown_again_on_resume() {
    let case = Case::new().flown(Some(Pace::Max), 5);
    let whole = case.trace();
    let (_folder, mut log, _) = case.repeated(3);
    log.resume().unwrap();
    let kept: String = whole.split_inclusive('\n').take(4).collect();
    assert_eq!(case.trace(), kept, "the header and three slots");
    for record in case.mission().take(5).skip(3) {
        log.add(&record).unwrap();
    }
    assert_eq!(case.trace(), whole);
    let first = Case::new().flown(Some(Pace::Max), 5);
    assert_eq!(log.hash(), first.repeated(5).1.hash());
}

#[test]
fn a_truncated_header_is_rewritten() {
    let case = Case::new().flown(Some(Pace::Max), 5);
    let header: String = case.trace().split_inclusive('\n').take(1).collect();
    case.write_trace(&header[..20]);
    let (_folder, mut log, _) = case.repeated(0);
    log.resume().unwrap();
    assert_eq!(case.trace(), header);
}

#[test]
fn an_unmodified_run_is_replayed_to_its_end() {
    let case = Case::new().flown(None, SLOTS);
    let written = RunFolder::open_to_read(&case.out()).unwrap().summary().unwrap();
    assert!(written.loss_rate > 0.0 && written.complete);
    assert_eq!(case.replayed(), Ok(json(&written)));
}

/// The summaries, as JSON, of a mission over `rows` of a list whose flights another flight-sim has reported, as written
/// and as added up again. It has flown over links by `others` of the keys.
fn reported(keys: &str, others: &str, rows: &str) -> [String; 2] {
    let of = |keys: &str| {
        let text = format!("name = 'x'\nslots = 60\narea.side_m = 60.0\nsensors.file = 'l.csv'\n{keys}");
        let scenario = Scenario::parse(&text, Path::new("x.toml"), Overrides::default());
        scenario.and_then(settings::resolve).unwrap()
    };
    let [scenario, flown] = [of(keys), of(&(keys.to_owned() + others))];
    let list = SensorList::parse(rows, Path::new("l.csv"), &scenario).unwrap();
    let place = tempfile::tempdir().unwrap();
    let out = place.path().join("run");
    let mode = RunMode { external: vec!["flight-sim".to_owned()], ..RunMode::default() };
    let folder = RunFolder::create(Some(&out), Earlier::Kept, &scenario, &list, &mode).unwrap();
    let mut log = folder.slot_log().unwrap();
    let mut tally = Tally::new(&scenario, &list, &mode);
    let mission = Mission::new(&flown, &list).unwrap();
    tally.start(&mission.header());
    for record in mission {
        log.add(&record).unwrap();
        tally.add(&record).unwrap();
    }
    folder.write_summary(&tally.summary(Duration::ZERO, log.hash())).unwrap();
    drop((log, folder));
    let mut replay = Replay::open(&out).unwrap();
    let written = json(replay.summary());
    replay.add_up(&Stop::default()).unwrap();
    [written, json(replay.summary())]
}

#[test]
fn reported_flights_are_added_up_to_every_figure_of_the_run() {
    const ROWS: &str = "x_m,y_m,queue_bits,sampling_bps\n10,10,9000,900\n50,12,0,400\n30,55,200,2000\n8,48,29000,0\n";
    let weighted = ROWS.replace("bps\n", "bps,weight\n").replace("900\n", "900,5\n");
    let weighted = weighted.replace("400\n", "400,1\n").replace("2000\n", "2000,1\n").replace(",0\n", ",0,1\n");
    let initial = ROWS.replace(",900\n", ",0\n").replace(",400\n", ",0\n").replace(",2000\n", ",0\n");
    let energy =
        "sensors.energy = { capacity_j = 2.0, sleep_w = 0.04, harvest_w = 0.005, tx_w = 20.0, wake_j = 0.01 }\n";
    let cases: [(&str, &str, &str); 9] = [
        ("planner.strategy = 'edf'\n", ROWS, "lost_bits"),
        ("planner.strategy = 'edf'\n", &weighted, "weighted_loss_rate"),
        ("planner.strategy = 'horizon'\nplanner.objective = 'collect'\n", &initial, "score"),
        ("planner.strategy = 'horizon'\nplanner.objective = 'age'\n", ROWS, "objective"),
        (energy, ROWS, "node_energy"),
        (&format!("{energy}sensors.expiry_s = 9.0\n"), ROWS, "expired_bits"),
        ("link.duty_cycle = 2e-5\nlink.setup_s = 0.02\nlink.sharing = 'equal'\n", ROWS, "refused_duty"),
        ("uav.count = 2\nuav.separation_m = 5.0\nuav.starts_m = [[5, 5], [50, 50]]\n", ROWS, "fleet"),
        ("uav.battery.capacity_j = 9000.0\nuav.must_land = true\nbase.charge_w = 500.0\n", ROWS, "energy"),
    ];
    for (keys, rows, figure) in cases {
        for others in ["", "link.bandwidth_hz = 3e4\n"] {
            let [written, again] = reported(keys, others, rows);
            assert!(written.contains(&format!("\"{figure}\":")), "{keys}: {written}");
            assert_eq!(again, written, "{keys}{others}");
        }
    }
}

#[test]
fn extra_missing_and_reordered_lines_are_refused() {
    let case = Case::new().flown(None, SLOTS);
    let whole = case.trace();
    let lines: Vec<&str> = whole.split_inclusive('\n').collect();
    let more = lines[SLOTS as usize].replacen('8', "9", 1);
    case.write_trace(&format!("{whole}{more}"));
    case.assert_refused("expected the end, after 8 slots");
    case.write_trace(&[&lines[..3], &lines[4..]].concat().concat());
    case.assert_refused("slot 4: expected slot 3");
    case.write_trace(&lines[..SLOTS as usize].concat());
    case.assert_refused("expected 8 slots of hash");
    case.write_trace(whole.trim_end());
    case.assert_refused("7 slots of hash");
}

#[test]
fn a_changed_line_is_refused_by_its_number() {
    let case = Case::new().flown(None, SLOTS);
    let whole = case.trace();
    let lines: Vec<&str> = whole.split_inclusive('\n').collect();
    let mut columns: Vec<String> = lines[2].split(',').map(str::to_owned).collect();
    columns[8] = (columns[8].parse::<u64>().unwrap() + 1).to_string(); // bits queued
    let changed = columns.join(",");
    case.write_trace(&[&lines[..2], &[&changed[..]], &lines[3..]].concat().concat());
    case.assert_refused("line 3");
}

#[test]
fn a_modified_summary_is_refused() {
    let case = Case::new().flown(None, SLOTS);
    let path = case.file("summary.json");
    let whole = fs::read(&path).unwrap();
    let cut = (0..whole.len()).step_by(7).map(|length| whole[..length].to_vec());
    let flipped = (0..whole.len()).map(|at| {
        let mut bytes = whole.clone();
        bytes[at] ^= 1;
        bytes
    });
    let text = std::str::from_utf8(&whole).unwrap();
    let unchecked = text.rsplit_once(",\n  \"check\"").unwrap().0.to_owned() + "\n}\n";
    for bytes in cut.chain(flipped).chain([unchecked.into_bytes(), [&whole[..], b"\n"].concat()]) {
        fs::write(&path, &bytes).unwrap();
        case.assert_refused("summary.json: it was modified");
        assert!(!RunFolder::open_to_read(&case.out()).unwrap().is_complete());
    }
}

#[test]
fn figures_are_recomputed_from_the_trace_where_it_holds_them() {
    let case = Case::new().flown(None, SLOTS);
    let folder = RunFolder::reopen(&case.out()).unwrap();
    let written = folder.summary().unwrap();
    let version = "0.0.1".into();
    let build = "of the program that flew".into();
    let measured = Summary { restarts: 3, solver_fallbacks: 2, version, build, ..written.clone() };
    let energy = Some(EnergyUse::default());
    let forged = Summary { loss_rate: 0.5, held_slots: 7, lost_bits: 2, mean_served: 9.0, energy, ..measured.clone() };
    folder.write_summary(&forged).unwrap(); // with a valid check value
    drop(folder);
    assert_eq!(case.replayed(), Ok(json(&measured)));
}

#[test]
fn force_removes_only_sources_that_a_run_has_written() {
    let case = Case::new();
    let create = |names: &[&str]| {
        let source = |name: &&str| SourceFile { name: (*name).to_owned(), bytes: name.as_bytes().to_vec() };
        let mode = RunMode { sources: names.iter().map(source).collect(), ..RunMode::default() };
        let made = RunFolder::create(Some(&case.out()), Earlier::Replaced, &case.scenario, &case.list, &mode);
        made.map(drop).map_err(|error| error.to_string())
    };
    create(&["strategy.py", "strategy.near.py"]).unwrap();
    fs::write(case.file("strategy.mine.py"), "mine").unwrap();
    create(&["strategy.py"]).unwrap();
    assert!(!case.file("strategy.near.py").exists() && case.file("strategy.py").exists());
    assert_eq!(fs::read_to_string(case.file("strategy.mine.py")).unwrap(), "mine");
    let refusal = create(&["strategy.mine.py"]).unwrap_err();
    assert!(refusal.contains("strategy.mine.py: expected a file of a run"), "{refusal}");
    assert!(case.file("strategy.py").exists() && case.file("run.toml").exists(), "nothing was removed");
    assert_eq!(fs::read_to_string(case.file("strategy.mine.py")).unwrap(), "mine");
    create(&[]).unwrap();
    assert!(!case.file("strategy.py").exists() && case.file("strategy.mine.py").exists());
}

/// Changes a file of a run.
type Change<'a> = &'a dyn Fn(&Case);

/// Flies on for some slots after `change`, and returns the error of the trace, at the latest at its end.
fn error_after(change: impl Fn(&Case)) -> Option<MissionError> {
    let case = Case::new();
    let folder = case.create(Some(Pace::Max), false).unwrap();
    let mut log = folder.slot_log().unwrap();
    for record in case.mission() {
        log.add(&record).unwrap();
        if record.slot() == 5 {
            change(&case);
        }
    }
    log.compare(Extent::Full).err()
}

#[test]
fn a_file_of_a_run_that_another_process_changes_is_named() {
    assert!(error_after(|_| ()).is_none());
    let edit = |name: &'static str| move |case: &Case| fs::write(case.file(name), fs::read(case.file(name)).unwrap());
    assert!(error_after(|case| edit("sensors.csv")(case).unwrap()).is_none(), "the same bytes");
    for name in ["slots.csv", "slots.check", "scenario.toml", "sensors.csv", "run.toml"] {
        let path = |case: &Case| case.file(name);
        let flip = |case: &Case| {
            let mut bytes = fs::read(path(case)).unwrap();
            bytes[10] ^= 1;
            OpenOptions::new().write(true).open(path(case)).unwrap().write_all(&bytes).unwrap();
        };
        let changes: [(&str, Change); 5] = [
            ("deleted or moved", &|case| fs::remove_file(path(case)).unwrap()),
            ("replaced", &|case| {
                fs::rename(path(case), case.file("aside")).unwrap();
                symlink(case.file("aside"), path(case)).unwrap();
            }),
            ("truncated or extended", &|case| {
                OpenOptions::new().write(true).open(path(case)).unwrap().set_len(1000).unwrap();
            }),
            ("deleted or moved", &|case| fs::rename(case.out(), case.out().with_extension("moved")).unwrap()),
            ("overwritten", &flip),
        ];
        for (says, change) in changes {
            if (name, says) == ("slots.check", "overwritten") {
                continue; // each slot writes all of it
            }
            let error = error_after(change).expect("nothing was noticed");
            let MissionError::File { path, source } = &error else { panic!("{error}") };
            assert!(FileChange::is_cause_of(source) && error.to_string().contains(says), "{name}: {error}");
            let is_folder = path.file_name().unwrap() == "slots.csv" && says == "deleted or moved";
            assert!(path.ends_with(name) || is_folder, "{name}: {error}");
            assert_eq!(error.exit_code(), 1);
        }
    }
}

#[test]
fn a_change_is_noticed_while_the_run_is_flown() {
    let case = Case::new();
    let folder = case.create(Some(Pace::Max), false).unwrap();
    let mut log = folder.slot_log().unwrap();
    let mut records = case.mission();
    log.add(&records.next().unwrap()).unwrap();
    fs::remove_file(case.file("slots.csv")).unwrap();
    std::thread::sleep(Duration::from_millis(1001)); // the time between two comparisons
    let error = log.add(&records.next().unwrap()).unwrap_err().to_string();
    assert!(error.ends_with("run/slots.csv: it was deleted or moved during the run"), "{error}");
}

#[test]
fn the_hash_of_a_trace_depends_on_all_of_its_lines() {
    let header = |slot| QueuesHeader { head: SlotHeader { slot, ..SlotHeader::default() }, ..QueuesHeader::default() };
    let hash = |slots: &[u64]| {
        let mut trace = TraceHash::default();
        for &slot in slots {
            trace.write(&[FlightReport::at([1.0, 2.0, 3.0], Mode::Hold)], &header(slot)).unwrap();
            trace.chain();
        }
        trace.value()
    };
    assert_ne!(hash(&[1, 3]), hash(&[2, 3]));
    let unbalanced = QueuesHeader { totals: Totals { lost_bits: 1, ..Totals::default() }, ..header(1) };
    assert!(TraceHash::default().write(&[FlightReport::at([0.0; 3], Mode::Hold)], &unbalanced).is_err());
}

#[test]
fn recorded_positions_are_finite() {
    let parsed = |x_m: &str| RecordedSlot::parse(format!("1,0,{x_m},2,20,3 4,5,6,7,serve,0\n").as_bytes());
    assert_eq!(parsed("1.5").unwrap().position.x, 1.5);
    for x_m in ["inf", "NaN", "-inf"] {
        assert_eq!(parsed(x_m), None, "{x_m}");
    }
}

#[test]
fn a_replaced_run_leaves_no_files() {
    let case = Case::new().flown(Some(Pace::Max), SLOTS);
    let folder = case.create(None, true).unwrap();
    assert_eq!(case.trace(), "");
    assert!(!case.file("summary.json").exists() && !case.file("slots.check").exists());
    drop(folder);
    let case = Case::new().flown(None, SLOTS);
    fs::write(case.file("sweep.json"), "{}").unwrap();
    let error = case.create(None, true).unwrap_err();
    assert!(error.contains("something else than a run"), "{error}");
    assert_eq!(case.trace().lines().count(), SLOTS as usize + 1);
}

#[test]
fn a_run_in_progress_is_not_replaced_resumed_or_read() {
    let case = Case::new().flown(Some(Pace::Max), 5);
    let _folder = RunFolder::reopen(&case.out()).unwrap();
    let errors = [
        case.create(None, true).map(drop),
        RunFolder::reopen(&case.out()).map(drop).map_err(|error| error.to_string()),
        RunFolder::open_to_read(&case.out()).map(drop).map_err(|error| error.to_string()),
    ];
    for error in errors {
        let error = error.unwrap_err();
        assert!(error.contains("a run is writing it"), "{error}");
    }
    assert_eq!(case.trace().lines().count(), 6, "nothing was changed");
}

#[test]
fn a_run_is_complete_once_its_summary_says_so() {
    for (slots, is_complete) in [(5, false), (SLOTS, true)] {
        let case = Case::new().flown(None, slots);
        assert_eq!(RunFolder::open_to_read(&case.out()).unwrap().is_complete(), is_complete, "{slots} slots");
        fs::remove_file(case.file("summary.json")).unwrap();
        assert!(!RunFolder::open_to_read(&case.out()).unwrap().is_complete(), "no summary");
    }
}

#[test]
fn a_trace_that_is_a_link_is_not_written() {
    let case = Case::new();
    fs::create_dir(case.out()).unwrap();
    let victim = case.place.path().join("victim");
    OpenOptions::new().create(true).append(true).open(&victim).unwrap().write_all(b"mine").unwrap();
    symlink(&victim, case.file("slots.csv")).unwrap();
    assert!(case.create(None, true).is_err());
    assert_eq!(fs::read(&victim).unwrap(), b"mine");
}

#[test]
fn solver_fallbacks_are_counted_except_in_a_resumed_run() {
    let case = Case::new();
    let mut tally = Tally::new(&case.scenario, &case.list, &RunMode::default());
    let mut records: Vec<SlotRecord> = case.mission().collect();
    for record in &mut records {
        let mut plans = record.plans().clone();
        for plan in plans.iter_mut().flatten() {
            plan.solver = SolverOutcome::Fallback as u32;
            plan.plan_ns = 0; // an external planner may not measure it
        }
        record.begin(&plans);
    }
    let fallbacks = |tally: &Tally| tally.summary(Duration::ZERO, 0).solver_fallbacks;
    records[..3].iter().for_each(|record| tally.add(record).unwrap());
    assert_eq!(fallbacks(&tally), 3);
    tally.resume();
    records[3..5].iter().for_each(|record| tally.add(record).unwrap());
    assert_eq!(fallbacks(&tally), 2);
}
