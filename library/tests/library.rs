//! The library as it is in the repository: every best known flight is what its file says, and nothing spoilt is
//! accepted.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha12Rng;
use skysink_common::scenario::{Overrides, Setting};
use skysink_common::sensors::SensorList;
use skysink_common::stop::Stop;
use skysink_library::{BestFlight, Claim, FlownFlight, Instance, Library, Measure, ReferenceValue, gap};
use skysink_mission::Mission;
use skysink_mission::folder::Earlier;
use skysink_mission::origin::RunMode;
use skysink_mission::record::RunFolder;
use skysink_mission::tally::Tally;

/// A small instance that many tests fly.
const SMALL: &str = "sks-small-5a";

/// The last line of the best known flight of a fleet.
const LAST_OF_FLEET: &str = "600,1,11.027183926083373,990.3274844389573,150\n";

fn stop() -> Stop {
    Stop::default()
}

fn find(name: &str) -> Instance {
    Library::default().find(name).unwrap()
}

/// Flies an instance by `uts` into the folder `run`.
fn fly(instance: &Instance, seed: u64, run: &Path) {
    let open = Library::default().open(instance.clone()).unwrap();
    let overrides = Overrides { strategy: Some("uts"), seed: Some(seed), ..Overrides::default() };
    let scenario = open.flown_by(overrides).unwrap();
    let list = SensorList::of(&scenario).unwrap();
    let folder = RunFolder::create(Some(run), Earlier::Kept, &scenario, &list, &RunMode::default()).unwrap();
    let mut log = folder.slot_log().unwrap();
    let mut tally = Tally::new(&scenario, &list, &RunMode::default());
    Mission::new(&scenario, &list).unwrap().drive(&mut [&mut log, &mut tally], &stop()).unwrap();
    folder.finish(&log, &mut tally.summary(std::time::Duration::ZERO, log.hash())).unwrap();
}

/// A copy of an instance, with its best known flight, in a library of its own.
fn copy_of(name: &str) -> (tempfile::TempDir, Library) {
    let folder = tempfile::tempdir().unwrap();
    let own = Path::new(env!("CARGO_MANIFEST_DIR"));
    Library::default().copy(&find(name), folder.path()).unwrap();
    fs::create_dir(folder.path().join("best")).unwrap();
    let names = ["instances.toml".to_owned(), format!("best/{name}.toml"), format!("best/{name}.csv.gz")];
    for name in &names {
        fs::copy(own.join(name), folder.path().join(name)).unwrap();
    }
    let library = Library::of(Some(folder.path().to_owned()));
    (folder, library)
}

/// The small instance of a library, with its best known flight.
fn known_in(library: &Library) -> (Instance, FlownFlight) {
    let instance = library.find(SMALL).unwrap();
    let known = library.verify_best(&instance, &stop()).unwrap().unwrap();
    (instance, known)
}

/// The plans of the best known flight of an instance, as text.
fn plans_of(name: &str) -> String {
    text_of(&Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("best/{name}.csv.gz")))
}

fn text_of(compressed: &Path) -> String {
    std::io::read_to_string(flate2::read::GzDecoder::new(fs::File::open(compressed).unwrap())).unwrap()
}

/// Verifies the text of a plan file.
fn verify(text: &str) -> Result<FlownFlight, String> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("plans.csv");
    fs::write(&path, text).unwrap();
    let flown = Library::default().verify(&[path], None, &stop());
    flown.map_err(|error| {
        let error = error.to_string();
        assert_eq!(error.lines().count(), 1, "{error}");
        error
    })
}

#[test]
fn every_best_known_flight_is_what_its_file_says() {
    let library = Library::default();
    let instances = library.instances().unwrap();
    assert!(instances.len() >= 55, "{}", instances.len());
    let left = Mutex::new(instances.iter());
    let check_all = || {
        loop {
            let Some(instance) = left.lock().unwrap().next() else { return };
            let flown = library.verify_best(instance, &stop()).unwrap();
            let flown = flown.unwrap_or_else(|| panic!("{}: expected a best known flight", instance.name));
            let verdict = flown.placement().unwrap();
            assert_eq!((verdict.place, verdict.gap_to_best), (1, Some(0.0)), "{}", instance.name);
            let scenario = &flown.open.scenario;
            assert!(scenario.uav.position_error_m.is_none(), "{}: the trace does not hold waypoints", instance.name);
            assert_eq!(scenario.name, instance.name);
        }
    };
    std::thread::scope(|scope| {
        for _ in 0..std::thread::available_parallelism().map_or(1, usize::from) {
            scope.spawn(check_all);
        }
    });
}

#[test]
fn no_strategy_is_better_than_the_best_known_flight() {
    let library = Library::default();
    let bests: BTreeMap<String, BestFlight> = library
        .instances()
        .unwrap()
        .into_iter()
        .filter_map(|instance| Some((instance.name.clone(), library.best(&instance).unwrap()?)))
        .collect();
    let standings = library.standings().unwrap();
    assert!(!standings.is_empty());
    for ReferenceValue { instance, strategy, version, value } in &standings {
        let best = &bests[instance];
        assert!(!best.measure.is_better(*value, best.value), "{instance}: {strategy} {version}: {value}");
    }
}

#[test]
fn the_best_known_flights_of_small_instances_are_optimal() {
    let library = Library::default();
    let small = library.instances().unwrap().into_iter().filter(|instance| instance.family == "small");
    let bests: Vec<BestFlight> = small.map(|instance| library.best(&instance).unwrap().unwrap()).collect();
    assert!(bests.len() >= 5);
    for best in bests {
        assert_eq!(Some(best.value), best.bound, "{best:?}"); // proven by python/benchmarks/exact.py
    }
}

#[test]
fn a_run_has_the_value_of_its_plan_file() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("run");
    fly(&find(SMALL), 1, &run);
    let library = Library::default();
    let of_run = library.verify(std::slice::from_ref(&run), None, &stop()).unwrap();
    assert_eq!(of_run.by.as_deref(), Some("uts"));
    let twice = library.verify(&[run.clone(), run.clone()], None, &stop()).unwrap_err().to_string();
    assert!(twice.ends_with("it is given twice: expected one flight"), "{twice}");
    let trace = library.verify(&[run.join("slots.csv")], Some(SMALL), &stop()).unwrap();
    assert_eq!((of_run.value, &of_run.plans), (trace.value, &trace.plans));
    let verdict = of_run.placement().unwrap();
    assert!(verdict.place > 1 && verdict.gap_to_best.unwrap() > 0.0, "{verdict:?}");
    let unnamed = library.verify(&[run.join("slots.csv")], None, &stop()).unwrap_err().to_string();
    assert!(unnamed.ends_with("it names no instance: expected a first line `# instance: NAME`, or --instance"));
}

#[test]
fn a_better_flight_takes_the_place_of_the_best_known_one() {
    let (folder, library) = copy_of(SMALL);
    let (instance, known) = known_in(&library);
    let claim = || Claim { by: "somebody".to_owned(), cost: "nothing".to_owned() };
    let again = known.submit(claim()).unwrap_err().to_string();
    assert!(again.contains("expected a better one than"), "{again}");
    let built = Library::default().verify_best(&instance, &stop()).unwrap().unwrap();
    assert!(built.submit(claim()).unwrap_err().to_string().contains("expected"));

    let file = folder.path().join(format!("best/{SMALL}.toml"));
    let best = library.best(&instance).unwrap().unwrap();
    fs::write(&file, fs::read_to_string(&file).unwrap().replace(&format!("value = {}", best.value), "value = 1.0"))
        .unwrap();
    let submitted = known.submit(claim()).unwrap();
    assert_eq!((submitted.value, submitted.bound, &submitted.by[..]), (best.value, best.bound, "somebody"));
    let verified = library.verify_best(&instance, &stop()).unwrap().unwrap();
    let moves = |flown: &FlownFlight| -> Vec<_> {
        let moves = flown.plans.values().flatten().flatten();
        moves.map(|one| (one.position, one.scheduled.clone(), one.mode)).collect()
    };
    assert_eq!(moves(&verified), moves(&known));
    assert_eq!(
        text_of(&folder.path().join(format!("best/{SMALL}.csv.gz"))),
        plans_of(SMALL),
        "without columns of defaults"
    );
}

#[test]
fn a_flight_of_which_no_better_one_can_be_is_submitted_with_its_bound_and_no_value_beyond_a_bound_is_believed() {
    let (folder, library) = copy_of(SMALL);
    let (instance, known) = known_in(&library);
    let file = folder.path().join(format!("best/{SMALL}.toml"));
    let text = fs::read_to_string(&file).unwrap();
    fs::write(&file, text.replace("bound = 0.", "bound = 0.9")).unwrap();
    let error = library.verify_best(&instance, &stop()).unwrap_err().to_string();
    assert!(
        error.contains(&format!("{SMALL}: value 0.1")) && error.contains("expected none better than its bound, 0.9")
    );
    fs::remove_dir_all(folder.path().join("best")).unwrap();
    let first = known.submit(Claim { by: "somebody".to_owned(), cost: "nothing".to_owned() }).unwrap();
    let bound = first.bound.unwrap();
    assert!((0.0..=known.value).contains(&bound), "{first:?}");
}

#[test]
fn a_library_that_cannot_be_read_is_not_an_empty_one() {
    let (folder, library) = copy_of(SMALL);
    let instance = library.find(SMALL).unwrap();
    let best = folder.path().join("best");
    fs::remove_dir_all(&best).unwrap();
    assert_eq!(library.best(&instance).unwrap(), None);
    fs::write(&best, "a file in the place of a folder").unwrap();
    let error = library.best(&instance).unwrap_err().to_string();
    assert!(error.contains(&format!("best/{SMALL}.toml")), "{error}");
    fs::remove_file(&best).unwrap();
    fs::remove_file(folder.path().join("instances.toml")).unwrap();
    let error = library.best(&instance).unwrap_err().to_string();
    assert!(error.contains("instances.toml"), "it is the lock: {error}");
}

#[test]
fn a_record_whose_plans_are_lost_is_noticed_and_replaced_and_nothing_is_left_beside_it() {
    let (folder, library) = copy_of(SMALL);
    let (instance, known) = known_in(&library);
    let best = folder.path().join("best");
    // As after two renames of which a killed process has done one.
    fs::write(best.join(format!("{SMALL}.csv.gz")), "those of another flight").unwrap();
    fs::write(best.join(format!(".{SMALL}.toml.abcdef.new")), "").unwrap();
    let torn = library.best(&instance).unwrap_err().to_string();
    assert!(torn.contains("hash ") && torn.contains(&format!("of best/{SMALL}.toml")), "{torn}");
    known.submit(Claim { by: "somebody".to_owned(), cost: "nothing".to_owned() }).unwrap();
    assert_eq!(library.verify_best(&instance, &stop()).unwrap().unwrap().value, known.value);
    assert_eq!(fs::read_dir(best).unwrap().count(), 2);
}

#[test]
fn a_run_whose_trace_was_replaced_is_not_credited_to_its_strategy() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("run");
    fly(&find(SMALL), 1, &run);
    fs::write(run.join("slots.csv"), plans_of(SMALL)).unwrap();
    let flown = Library::default().verify(&[run], None, &stop()).unwrap();
    assert_eq!(flown.by, None);
}

#[test]
fn impossible_values_of_a_library_are_refused_by_file_and_key() {
    let best = format!("best/{SMALL}.toml");
    let standings = "standings.csv".to_owned();
    let index = "instances.toml".to_owned();
    let heading = format!("[{SMALL}]");
    let with = |key: &str| format!("{heading}\n{key}");
    for (file, from, to, says) in [
        (&index, &heading, with("seeds = 0"), "seeds = 0: expected 1 to 1000"),
        (&index, &heading, with("seeds = 1000000000"), "seeds = 1000000000: expected 1 to 1000"),
        (&index, &heading, "['../other']".to_owned(), "[../other]: expected 1 to 100 of A-Z"),
        (&best, &"value = ".to_owned(), "value = nan #".to_owned(), "value or bound: expected finite numbers"),
        (&best, &"bound = ".to_owned(), "bound = inf #".to_owned(), "value or bound: expected finite numbers"),
        (&best, &"\"loss_rate\"".to_owned(), "\"score\"".to_owned(), "measure score: expected η"),
        (&standings, &format!("{SMALL},uts,x,1"), format!("{SMALL},uts,x,nan"), "expected a finite number"),
        (
            &standings,
            &format!("{SMALL},uts,x,1"),
            "a,b".to_owned(),
            "expected instance, strategy, version, and a value",
        ),
    ] {
        let (folder, library) = copy_of(SMALL);
        let path = folder.path().join(file);
        let text = fs::read_to_string(&path).unwrap_or(format!("instance,strategy,version,value\n{SMALL},uts,x,1\n"));
        fs::write(&path, text.replacen(from, &to, 1)).unwrap();
        let plans = folder.path().join("mine.csv");
        fs::write(&plans, plans_of(SMALL)).unwrap();
        let placed = library.verify(&[plans], Some(SMALL), &stop()).and_then(|flown| flown.placement());
        let error = placed.unwrap_err().to_string();
        assert!(error.contains(says) && error.contains(file), "{file}: {error}");
    }
}

#[test]
fn a_pipe_in_a_library_is_refused_and_a_copy_is_whole_or_not_at_all() {
    let (folder, library) = copy_of(SMALL);
    let instance = library.find(SMALL).unwrap();
    let to = folder.path().join("to");
    fs::create_dir(&to).unwrap();
    fs::write(to.join(format!("{SMALL}.toml")), "mine").unwrap();
    let error = library.copy(&instance, &to).unwrap_err().to_string();
    assert!(error.contains("it exists, with another content"), "{error}");
    assert_eq!(fs::read_dir(&to).unwrap().count(), 1);
    let make_pipe = |path: &Path| assert!(std::process::Command::new("mkfifo").arg(path).status().unwrap().success());
    fs::remove_file(to.join(format!("{SMALL}.toml"))).unwrap();
    make_pipe(&to.join(format!("{SMALL}.toml")));
    let error = library.copy(&instance, &to).unwrap_err().to_string();
    assert!(error.ends_with("it is no regular file"), "{error}");
    let index = folder.path().join("instances.toml");
    fs::remove_file(&index).unwrap();
    make_pipe(&index);
    let error = library.instances().unwrap_err().to_string();
    assert!(error.ends_with("it is a pipe or a device: expected a regular file"), "{error}");
}

#[test]
fn a_spoilt_byte_of_a_best_known_flight_is_refused() {
    let (folder, library) = copy_of(SMALL);
    let instance = library.find(SMALL).unwrap();
    let path = folder.path().join(format!("best/{SMALL}.csv.gz"));
    let whole = fs::read(&path).unwrap();
    let mut random = ChaCha12Rng::seed_from_u64(60);
    for _ in 0..100 {
        let mut bytes = whole.clone();
        let at = random.random_range(0..bytes.len());
        bytes[at] ^= 1 << random.random_range(0..8);
        fs::write(&path, bytes).unwrap();
        let error = library.verify_best(&instance, &stop()).unwrap_err().to_string();
        assert!(error.contains(&format!("best/{SMALL}.csv.gz")) && error.lines().count() == 1, "{error}");
    }
}

/// A line in a plan file changed at random: refused, or another flight that can be flown.
#[test]
fn a_spoilt_plan_file_is_refused_or_another_flight() {
    let text = plans_of(SMALL);
    let known = verify(&text).unwrap();
    let lines: Vec<&str> = text.lines().collect();
    let mut random = ChaCha12Rng::seed_from_u64(61);
    let mut refused = 0;
    for _ in 0..200 {
        let at = random.random_range(1..lines.len());
        let mut changed: Vec<String> = lines.iter().map(|line| (*line).to_owned()).collect();
        match random.random_range(0..5) {
            0 => drop(changed.remove(at)),
            1 => changed.insert(at, changed[at].clone()),
            2 => changed[at].push_str(" 99999"),
            3 => changed[at] = changed[at].replacen(',', ",1", 2),
            _ => {
                let half = changed[at].len() / 2;
                changed[at].truncate(half);
            }
        }
        match verify(&(changed.join("\n") + "\n")) {
            Err(_) => refused += 1,
            Ok(flown) => assert!(flown.plans != known.plans || flown.value == known.value),
        }
    }
    assert!(refused >= 190, "{refused}");
}

#[test]
fn a_refusal_says_what_is_expected_of_the_plan() {
    // The instance, what is replaced in its best known flight by what, and the end of the refusal.
    let cases = [
        (SMALL, "2,25,45,0\n", "2,85,45,0\n", "in the area, outside of zones"),
        (SMALL, "2,25,45,0\n", "2,25,45.5,0\n", "away: expected one that a slot reaches"),
        (SMALL, "2,25,45,0\n", "2,25,45,5\n", "sensor node 5: expected a number from 0 to 4"),
        (SMALL, "2,25,45,0\n", "2,25,45,0 1\n", "2 sensor nodes are scheduled: expected at most 1 at once"),
        (SMALL, "2,25,45,0\n", "2,25,45,3\n", "is not served: expected one in range that no other UAV serves"),
        (SMALL, "2,25,45,0\n", "2.5,25,45,0\n", "expected a whole number as slot"),
        (SMALL, "2,25,45,0\n", "2,25,north,0\n", "expected a number as y_m"),
        (SMALL, "2,25,45,0\n", "2,25,nan,0\n", "expected a position of finite numbers"),
        (SMALL, "2,25,45,0\n", "2,25,45,2 0\n", "from 0 on, ascending, separated by spaces"),
        (SMALL, "2,25,45,0\n", "3,25,45,0\n", "expected slot 2"),
        (SMALL, "30,5,5,\n", "31,5,5,\n", "expected slot 30"),
        (SMALL, "30,5,5,\n", "30,5,5,\n31,5,5,\n", "expected the end, after 30 slots"),
        (SMALL, "30,5,5,\n", "", "it ends in slot 29 of seed 1: expected 30 slots of each UAV"),
        ("sks-1000-200-fleet2", LAST_OF_FLEET, "", "slot 600 of seed 1 before UAV 1: expected 600 slots of each UAV"),
        ("sks-1000-200-fleet2", "\n1,1,", "\n2,1,", "expected slot 1 of UAV 1"),
        ("sks-1000-200-fleet2", "slot,uav,", "slot,refused,", "column uav is missing"),
        ("sks-1000-200-fleet2", "\n1,1,", "\n1,2,", "expected uav 0 to 1"),
        ("sks-600-100-3d-urban", "y_m,z_m,", "y_m,refused,", "column z_m is missing"),
    ];
    for (name, found, put, expected) in cases {
        let plans = plans_of(name);
        assert!(plans.contains(found), "{name}: {found}");
        let refusal = verify(&plans.replacen(found, put, 1)).unwrap_err();
        assert!(refusal.contains(expected), "{refusal}");
    }
}

#[test]
fn a_verified_flight_is_placed_between_others() {
    let (folder, library) = copy_of(SMALL);
    let rows = |values: [f64; 3]| {
        let row = |(name, value): (&str, f64)| format!("{SMALL},{name},0.1.0,{value}\n");
        ["gfs", "tour", "uts"].into_iter().zip(values).map(row).collect::<String>()
    };
    let run = folder.path().join("run");
    fly(&find(SMALL), 1, &run);
    let value = Library::default().verify(std::slice::from_ref(&run), None, &stop()).unwrap().value;
    let text = "instance,strategy,version,value\n".to_owned() + &rows([value + 0.1, value - 1e-3, value]);
    fs::write(folder.path().join("standings.csv"), text).unwrap();
    let placed = library.verify(&[run], None, &stop()).unwrap().placement().unwrap();
    assert_eq!((placed.place, placed.of), (3, 5));
    assert_eq!(placed.ahead.unwrap().by, "tour");
    assert_eq!(placed.behind.unwrap().by, "gfs", "an equal one is not worse");
}

#[test]
fn a_scenario_that_differs_in_a_key_is_refused_and_the_key_named() {
    let open = Library::default().open(find(SMALL)).unwrap();
    for (key, value) in [
        ("slots", "20"),
        ("link.bandwidth_hz", "4e6"),
        ("uav.max_speed_mps", "29.9"),
        ("sensors.capacity_bits", "30001"),
        ("planner.objective", "\"age\""),
        ("name", "\"other\""),
        ("sensors.deadline_s", "5"),
    ] {
        let setting: Setting = format!("{key}={value}").parse().unwrap();
        let error = open.flown_by(Overrides { keys: vec![setting], ..Overrides::default() }).unwrap_err().to_string();
        assert!(error.contains(&format!("{key} = ")) && error.contains(&format!("as in {SMALL}")), "{error}");
    }
    let setting: Setting = "sensors.deadline_s=5".parse().unwrap();
    let error = open.flown_by(Overrides { keys: vec![setting], ..Overrides::default() }).unwrap_err().to_string();
    assert!(error.ends_with(&format!("sensors.deadline_s = 5.0: expected no such key, as in {SMALL}")), "{error}");
    let free = ["planner.strategy=\"horizon\"", "planner.horizon.iterations=5", "seed=7"];
    let keys = free.map(|setting| setting.parse().unwrap()).to_vec();
    open.flown_by(Overrides { keys, ..Overrides::default() }).unwrap();
}

#[test]
fn a_run_with_another_list_or_the_plans_of_another_instance_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let instance = find(SMALL);
    let copied = Library::default().copy(&instance, folder.path()).unwrap();
    let list = folder.path().join(format!("{SMALL}.csv"));
    let text = fs::read_to_string(&list).unwrap();
    let row = text.lines().nth(2).unwrap();
    let changed = format!("{}1{}", &row[..row.find(',').unwrap()], &row[row.find(',').unwrap()..]);
    fs::write(&list, text.replacen(row, &changed, 1)).unwrap();
    let scenario = skysink_common::scenario::Scenario::read(&copied, Overrides::default());
    let scenario = scenario.and_then(skysink_planner::settings::resolve).unwrap();
    let changed = SensorList::of(&scenario).unwrap();
    let open = Library::default().open(instance.clone()).unwrap();
    let error = open.require_same(&scenario, &changed, &copied).unwrap_err().to_string();
    assert!(error.contains("sensors.csv line 3") && error.contains(SMALL), "{error}");
    let again = Library::default().copy(&instance, folder.path()).unwrap_err().to_string();
    assert!(again.ends_with("it exists, with another content"), "{again}");

    let other = Library::default().instances().unwrap().into_iter().find(|other| other.family == "paper").unwrap();
    let plans = plans_of(SMALL).replace(SMALL, &other.name);
    assert!(verify(&plans).is_err());
    let path = folder.path().join("plans.csv");
    fs::write(&path, plans_of(SMALL)).unwrap();
    let unknown = Library::default().verify(std::slice::from_ref(&path), Some("sks-none"), &stop()).unwrap_err();
    assert!(unknown.to_string().contains("sks-none: expected an instance"), "{unknown}");
    let none = Library::default().verify(&[], None, &stop()).unwrap_err().to_string();
    assert!(none.contains("flights none: expected a run folder or a plan file"), "{none}");
    let error = Library::default().verify(&[path], Some(&other.name), &stop()).unwrap_err().to_string();
    assert!(error.ends_with(&format!("it is of the instance {SMALL}: expected {}", other.name)), "{error}");
}

#[test]
fn a_flight_that_does_not_land_where_it_has_to_is_refused() {
    let name = "sks-1000-80-collect"; // it has no battery
    let text = plans_of(name);
    verify(&text).unwrap();
    // It stays where it was halfway.
    let lines: Vec<&str> = text.lines().collect();
    let head = &lines[..2];
    let halfway = &lines[2..lines.len() / 2];
    let last: Vec<&str> = halfway.last().unwrap().split(',').collect();
    let stays = |slot: usize| {
        let cells = lines[1].split(',').zip(&last).map(|(column, cell)| match column {
            "slot" => slot.to_string(),
            "scheduled" => String::new(),
            "mode" => "fly".to_owned(),
            _ => (*cell).to_owned(),
        });
        cells.collect::<Vec<_>>().join(",")
    };
    let rest = (halfway.len() + 1..=lines.len() - 2).map(stays);
    let changed: Vec<String> = head.iter().chain(halfway).map(|line| (*line).to_owned()).chain(rest).collect();
    let error = verify(&(changed.join("\n") + "\n")).unwrap_err();
    assert!(error.contains("expected it in the base"), "{error}");
}

#[test]
fn a_policy_instance_is_flown_with_each_of_its_seeds() {
    let policies = Library::default().instances().unwrap().into_iter().filter(|instance| instance.seeds > 1);
    let instance = policies.min_by_key(|instance| instance.name.len()).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let runs: Vec<PathBuf> = (1..=instance.seeds).map(|seed| folder.path().join(seed.to_string())).collect();
    (1..).zip(&runs).for_each(|(seed, run)| fly(&instance, seed, run));
    let library = Library::default();
    let flown = library.verify(&runs, None, &stop()).unwrap();
    assert_eq!(flown.plans.len() as u64, instance.seeds);
    let reversed: Vec<PathBuf> = runs.iter().rev().cloned().collect();
    assert_eq!(library.verify(&reversed, None, &stop()).unwrap().value.to_bits(), flown.value.to_bits());
    let means = [&runs[..10], &runs[10..]].map(|part| library.verify(part, None, &stop()).unwrap_err().to_string());
    assert!(means[0].contains("seed 11 is missing: expected seeds 1 to 20"), "{}", means[0]);
    let twice: Vec<PathBuf> = runs.iter().chain(&runs[..1]).cloned().collect();
    let error = library.verify(&twice, None, &stop()).unwrap_err().to_string();
    assert!(error.ends_with("seed 1: it is given twice: expected one flight for each seed"), "{error}");
}

#[test]
fn a_gap_is_the_fraction_that_separates_a_value_from_a_reference() {
    assert_eq!(gap(Measure::LossRate, 0.2, 0.1), 0.5);
    assert_eq!(gap(Measure::LossRate, 0.2, 0.0), 1.0);
    assert_eq!(gap(Measure::Objective, 0.0, 0.0), 0.0);
    assert_eq!(gap(Measure::Score, 150.0, 200.0), 0.25);
    assert!(gap(Measure::Score, 200.0, 150.0) < 0.0 && gap(Measure::LossRate, 0.1, 0.2) < 0.0);
}
