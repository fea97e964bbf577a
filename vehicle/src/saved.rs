//! What a bridge knows of its vehicles, in a file of the ring for the bridge after it, and in the run folder for a run
//! that is resumed.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use serde::{Deserialize, Serialize};
use skysink_common::error::InputError;
use skysink_ring::folder::record_path;
use skysink_ring::role::Role;

use crate::identity::ChosenVehicle;
use crate::table::State;

/// The file.
const VEHICLES: &str = "vehicles.json";

/// Time after which a file that could not be written is tried again, if nothing is new.
const RETRY: Duration = Duration::from_secs(1);

/// What is known of a vehicle.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct SavedVehicle {
    /// Which one it is, once that is chosen.
    pub chosen: Option<ChosenVehicle>,
    /// The state of its mission.
    pub state: State,
    /// The altitude of its home above sea [m], as it was when it was armed.
    pub home_m: Option<f64>,
    /// Whether it was believed disarmed before take-off, or was flown, in this run.
    #[serde(default)]
    pub was_down: bool,
    /// Whether a bridge of this run has flown it, or somebody has taken it over in this run.
    pub was_flown: bool,
}

impl SavedVehicle {
    /// What a run that resumes this one knows of it when it begins.
    #[must_use]
    pub fn resumed(self) -> Self {
        let state = self.state.resumed();
        let was_down = self.was_down && !matches!(state, State::Check { .. });
        Self { state, was_down, was_flown: false, ..self }
    }
}

/// A vehicle of which nothing is known any more: it may have been armed.
const UNKNOWN: SavedVehicle =
    SavedVehicle { chosen: None, state: State::Silent, home_m: None, was_down: true, was_flown: true };

/// Whether a vehicle of the run in the folder `run` is flown by others, or none flies any more: it is not to be
/// resumed.
#[must_use]
pub fn is_over(run: &Path) -> bool {
    let vehicles = read(&run.join(VEHICLES)).unwrap_or_default();
    let is = |wanted: State| move |vehicle: &SavedVehicle| vehicle.state == wanted;
    vehicles.iter().any(is(State::HandsOff)) || !vehicles.is_empty() && vehicles.iter().all(is(State::Done))
}

/// Notes in the ring in `folder`, before its first bridge begins, that nothing is saved: a bridge that finds nothing at
/// all has lost it.
///
/// # Errors
/// If it cannot be written.
pub fn begin(folder: &Path) -> Result<(), InputError> {
    let path = folder.join(VEHICLES);
    write(&path, &[])
        .map_err(|error| InputError::new("ring folder", &path, format_args!("it cannot be written: {error}")))
}

/// Hands what the run in the folder `run` has saved to the ring in `folder`, which resumes it.
///
/// # Errors
/// If it cannot be read, or not be written.
pub fn resume(run: &Path, folder: &Path) -> Result<(), InputError> {
    let path = run.join(VEHICLES);
    let refused = |expected: &str| InputError::new("run folder", &path, expected);
    let mut vehicles =
        read(&path).ok_or_else(|| refused("expected the states of its vehicles, as the bridge has written them"))?;
    if vehicles.is_empty() {
        return Ok(());
    }
    if vehicles.iter().all(|vehicle| matches!(vehicle.state, State::HandsOff | State::Done)) {
        return Err(refused("its vehicles have landed, or were flown by others: expected a new run"));
    }
    vehicles.iter_mut().for_each(|vehicle| *vehicle = vehicle.resumed());
    write(&folder.join(VEHICLES), &vehicles)
        .map_err(|error| refused(&format!("it cannot be handed to the ring: {error}")))
}

/// What was saved.
#[derive(Debug)]
pub struct SavedVehicles {
    folder: PathBuf,
    /// The folder of the run, if it is on this host.
    run: Option<PathBuf>,
    /// By UAV, in the ring and in the folder of the run.
    vehicles: Vec<SavedVehicle>,
    in_run: Vec<SavedVehicle>,
    /// By UAV, [`SavedVehicle::was_flown`], whatever could be written.
    were_flown: Vec<bool>,
    /// Whether something was saved that cannot be read.
    is_lost: bool,
    /// When a file could not be written last.
    failed: Option<Instant>,
    /// The files of which it was said that they cannot be written.
    said: Vec<PathBuf>,
}

impl SavedVehicles {
    /// What the bridge before, or the run before, has saved of its `uavs` vehicles in the folder of the ring; nothing
    /// for the first bridge of a run, which `is_restarted` is not. If that cannot be read, or is gone, which is said,
    /// none is armed: they may have been.
    #[must_use]
    pub fn of(folder: &Path, uavs: usize, is_restarted: bool) -> Self {
        let path = folder.join(VEHICLES);
        let is_gone = is_restarted && !path.exists();
        if !is_restarted && !path.exists() {
            let _ = begin(folder); // of a ring whose launcher is on another host, or starts no bridge
        }
        let vehicles =
            read(&path).filter(|_| !is_gone).filter(|vehicles| vehicles.is_empty() || vehicles.len() == uavs);
        let is_lost = vehicles.is_none();
        let vehicles = vehicles.unwrap_or_else(|| {
            let line = format_args!("{VEHICLES} cannot be read: no vehicle is armed, as the bridge before may have");
            Role::FlightSim.log(line);
            vec![UNKNOWN; uavs]
        });
        let run = record_path(folder);
        let in_run = run.as_ref().and_then(|run| read(&run.join(VEHICLES))).unwrap_or_default();
        let mut were_flown: Vec<bool> = vehicles.iter().map(|vehicle| vehicle.was_flown).collect();
        were_flown.resize(uavs, false);
        Self { folder: folder.to_owned(), run, vehicles, in_run, were_flown, is_lost, failed: None, said: Vec::new() }
    }

    /// Whether something was saved that cannot be read: a vehicle may have been armed.
    pub fn is_lost(&self) -> bool {
        self.is_lost
    }

    /// The vehicles, by UAV; none before they are saved.
    pub fn vehicles(&self) -> &[SavedVehicle] {
        &self.vehicles
    }

    /// Saves what the bridge after this one has to know, before the commands of a transition are sent; the run folder
    /// keeps what it has of vehicles that an earlier run has flown, and no bridge of this one. Returns whether it is
    /// saved for the next bridge.
    pub fn save(&mut self, mut vehicles: Vec<SavedVehicle>) -> bool {
        let may_retry = self.failed.is_none_or(|failed| failed.elapsed() >= RETRY);
        for (uav, vehicle) in vehicles.iter_mut().enumerate() {
            vehicle.was_flown |= self.were_flown[uav]
                || match vehicle.state {
                    State::Arm { was_armed } => was_armed,
                    State::Climb | State::Fly { .. } | State::Home { .. } => true,
                    // Else it was found so, as after a resumption that came too early.
                    State::HandsOff => vehicle.was_down,
                    _ => false,
                };
            self.were_flown[uav] = vehicle.was_flown;
        }
        if let Some(run) = &self.run {
            let kept = |(uav, vehicle): (usize, &SavedVehicle)| match self.in_run.get(uav) {
                Some(before) if before.was_flown && !vehicle.was_flown => *before,
                Some(before) if self.is_lost && vehicle.state == State::Silent => *before, // it may know more
                _ => *vehicle,
            };
            let in_run: Vec<SavedVehicle> = vehicles.iter().enumerate().map(kept).collect();
            let path = run.join(VEHICLES);
            let is_tried = may_retry || vehicles != self.vehicles;
            let is_new = is_tried && in_run != self.in_run && vehicles.iter().any(|vehicle| vehicle.was_flown);
            if is_new && self.write(&path, &in_run, ": --resume would fly its vehicles as they were before") {
                self.in_run = in_run;
            }
        }
        if vehicles == self.vehicles {
            return true;
        }
        let is_saved = self.write(&self.folder.join(VEHICLES), &vehicles, ": no vehicle is armed meanwhile");
        if is_saved {
            self.vehicles = vehicles;
        }
        is_saved
    }

    /// Writes a file whole or, if that fails, not at all, which is said once, with what `follows`. Returns whether it
    /// was written.
    fn write(&mut self, path: &Path, vehicles: &[SavedVehicle], follows: &str) -> bool {
        let written = write(path, vehicles);
        if written.is_err() {
            self.failed = Some(Instant::now());
        }
        if let Err(error) = &written
            && !self.said.iter().any(|said| said == path)
        {
            self.said.push(path.to_owned());
            Role::FlightSim.log(format_args!("{} cannot be written: {error}{follows}", path.display()));
        }
        written.is_ok()
    }
}

/// Writes a file whole, or not at all.
fn write(path: &Path, vehicles: &[SavedVehicle]) -> std::io::Result<()> {
    let new = path.with_file_name(format!(".{VEHICLES}.new"));
    let text = serde_json::to_string(vehicles).expect("states and addresses are JSON");
    std::fs::write(&new, text).and_then(|()| std::fs::rename(&new, path))
}

/// The content of a file, empty if there is none; `None` if it cannot be read.
fn read(path: &Path) -> Option<Vec<SavedVehicle>> {
    let Ok(file) = std::fs::symlink_metadata(path) else { return Some(Vec::new()) };
    let text = if file.is_file() { std::fs::read_to_string(path).ok() } else { None };
    serde_json::from_str(&text?).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn vehicle(state: State) -> SavedVehicle {
        let chosen = Some(ChosenVehicle { system: 3, address: Some(([127, 0, 0, 1], 14550).into()) });
        SavedVehicle { chosen, state, home_m: Some(488.3), was_down: true, was_flown: state.is_flown() }
    }

    const FLY: State = State::Fly { has_begun: true };
    const CHECK: State = State::Check { may_fly_on: false };
    const MAY_FLY_ON: State = State::Check { may_fly_on: true };

    #[test]
    fn what_is_saved_is_known_to_the_next_bridge_and_what_is_not_is_tried_again() {
        let folder = tempfile::tempdir().unwrap();
        let vehicles = vec![vehicle(FLY), vehicle(State::Home { was_seen: true })];
        let mut saved = SavedVehicles::of(folder.path(), 2, false);
        assert!(saved.vehicles().is_empty() && saved.save(vehicles.clone()));
        assert_eq!(SavedVehicles::of(folder.path(), 2, true).vehicles(), vehicles);
        assert_eq!(SavedVehicles::of(folder.path(), 3, true).vehicles(), [UNKNOWN; 3], "of another run");

        let mut lost = SavedVehicles::of(&folder.path().join("none"), 2, false);
        assert!(!lost.save(vehicles.clone()) && !lost.save(vehicles.clone()));
        std::fs::create_dir(folder.path().join("none")).unwrap();
        assert!(lost.save(vehicles));
    }

    #[test]
    fn the_run_folder_keeps_what_it_has_of_vehicles_that_were_not_armed_since() {
        let [ring, run] = [0; 2].map(|_| tempfile::tempdir().unwrap());
        std::fs::write(ring.path().join("record"), run.path().to_str().unwrap()).unwrap();
        let in_run =
            || read(&run.path().join(VEHICLES)).unwrap().iter().map(|vehicle| vehicle.state).collect::<Vec<_>>();
        let save = |states: [State; 2]| {
            let mut saved = SavedVehicles::of(ring.path(), 2, false);
            let vehicle = |state| SavedVehicle { was_flown: false, was_down: false, ..vehicle(state) };
            assert!(saved.save(states.map(vehicle).to_vec()));
        };
        let begin_again = || std::fs::remove_file(ring.path().join(VEHICLES)).unwrap();
        save([CHECK, State::HandsOff]);
        assert_eq!(in_run(), [], "a run in which nothing was flown");
        begin_again();
        save([FLY, CHECK]);
        assert_eq!(in_run(), [FLY, CHECK]);
        save([FLY, State::HandsOff]);
        assert_eq!(in_run(), [FLY, State::HandsOff], "its pilot has taken it before the take-off");
        save([State::Home { was_seen: true }, FLY]);
        begin_again();
        save([CHECK, State::Arm { was_armed: false }]);
        save([State::HandsOff, State::Done]); // resumed too early; it refuses to be armed
        save([State::HandsOff, CHECK]);
        assert_eq!(in_run(), [State::Home { was_seen: true }, FLY]);
        assert!(!is_over(run.path()));

        let next = tempfile::tempdir().unwrap();
        resume(run.path(), next.path()).unwrap();
        let resumed = SavedVehicles::of(next.path(), 2, false);
        // Whichever bridge is the first to save: the one before it may have been killed.
        assert_eq!(resumed.vehicles().iter().map(|of| of.state).collect::<Vec<_>>(), [CHECK, MAY_FLY_ON]);
        assert!(resumed.vehicles().iter().all(|of| !of.was_down && !of.was_flown));
        std::fs::write(run.path().join(VEHICLES), "[1]").unwrap();
        assert!(
            resume(run.path(), next.path()).unwrap_err().to_string().contains("expected the states of its vehicles")
        );
    }

    #[test]
    fn a_run_folder_that_could_not_be_written_is_written_later() {
        let ring = tempfile::tempdir().unwrap();
        let run = ring.path().join("run");
        std::fs::write(ring.path().join("record"), run.to_str().unwrap()).unwrap();
        let mut saved = SavedVehicles::of(ring.path(), 1, false);
        let pilot = vec![SavedVehicle { was_flown: true, ..vehicle(State::HandsOff) }];
        assert!(saved.save(pilot.clone()) && !run.join(VEHICLES).exists());
        std::fs::create_dir(&run).unwrap();
        assert!(saved.save(pilot.clone()) && !run.join(VEHICLES).exists(), "not at each poll");
        std::thread::sleep(RETRY);
        assert!(saved.save(pilot.clone()));
        assert_eq!(read(&run.join(VEHICLES)).unwrap(), pilot);
    }

    #[test]
    fn of_a_vehicle_with_a_pilot_it_is_known_that_it_was_down() {
        assert!(
            vehicle(State::HandsOff).resumed().was_down && !vehicle(State::Home { was_seen: true }).resumed().was_down
        );
    }

    #[test]
    fn a_vehicle_that_was_taken_over_in_its_start_is_left_alone_by_the_next_run() {
        for before in [CHECK, State::Arm { was_armed: false }, State::Silent] {
            let [ring, run] = [0; 2].map(|_| tempfile::tempdir().unwrap());
            std::fs::write(ring.path().join("record"), run.path().to_str().unwrap()).unwrap();
            let mut saved = SavedVehicles::of(ring.path(), 1, false);
            for state in [before, State::HandsOff] {
                assert!(saved.save(vec![SavedVehicle { was_flown: false, ..vehicle(state) }]));
            }
            assert!(is_over(run.path()), "{before:?}");
        }
    }

    #[test]
    fn a_vehicle_that_was_armed_and_is_off_again_is_not_armed_by_the_next_run() {
        let [ring, run] = [0; 2].map(|_| tempfile::tempdir().unwrap());
        std::fs::write(ring.path().join("record"), run.path().to_str().unwrap()).unwrap();
        let mut saved = SavedVehicles::of(ring.path(), 1, false);
        let folder = saved.folder.clone();
        for (state, is_full) in [(CHECK, false), (State::Arm { was_armed: true }, true), (State::Done, true)] {
            saved.folder = if is_full { folder.join("full") } else { folder.clone() }; // nothing can be written to the ring
            saved.save(vec![SavedVehicle { was_flown: false, ..vehicle(state) }]);
        }
        assert!(is_over(run.path()));
    }

    #[test]
    fn a_run_is_over_for_its_vehicles_if_others_fly_one_or_none_flies() {
        let folder = tempfile::tempdir().unwrap();
        assert!(!is_over(folder.path()));
        for (states, expected) in [
            ([FLY, State::Done], false),
            ([FLY, State::HandsOff], true),
            ([State::Done, State::Done], true),
            ([State::Silent, State::Done], false),
        ] {
            write(&folder.path().join(VEHICLES), &states.map(vehicle)).unwrap();
            assert_eq!(is_over(folder.path()), expected, "{states:?}");
        }
    }

    #[test]
    fn vehicles_of_which_the_file_cannot_be_read_are_left_to_their_failsafe() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join(VEHICLES);
        assert_eq!(SavedVehicles::of(folder.path(), 2, true).vehicles(), [UNKNOWN; 2], "it is gone");
        begin(folder.path()).unwrap();
        assert!(
            SavedVehicles::of(folder.path(), 2, true).vehicles().is_empty(),
            "the first was killed before it began"
        );
        std::fs::remove_file(&file).unwrap();
        assert!(SavedVehicles::of(folder.path(), 2, false).vehicles().is_empty());
        assert!(SavedVehicles::of(folder.path(), 2, true).vehicles().is_empty(), "the first bridge has begun");
        for text in ["", "[", "{}", "\0"] {
            std::fs::write(&file, text).unwrap();
            let saved = [true, false].map(|is_restarted| SavedVehicles::of(folder.path(), 2, is_restarted));
            assert!(saved.iter().all(|saved| saved.is_lost() && saved.vehicles() == [UNKNOWN; 2]), "{text:?}");
        }
        std::fs::remove_file(&file).unwrap();
        std::os::unix::fs::symlink("/dev/zero", &file).unwrap();
        assert_eq!(SavedVehicles::of(folder.path(), 2, true).vehicles(), [UNKNOWN; 2], "a link to a device");
    }
}
