//! What a bridge knows of its vehicles, in files of the ring, for the bridge after it and for the launcher.

use std::path::{Path, PathBuf};

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use skysink_common::error::InputError;
use skysink_ring::folder::record_path;
use skysink_ring::role::Role;

use crate::control::{Fate, History};
use crate::link::ChosenVehicle;

/// The file of the ring with what is known of the vehicles.
const VEHICLES: &str = "vehicles.json";

/// The file of the ring that is there once a vehicle was taken over: such a run is not to be resumed.
pub const TAKEN_OVER: &str = "taken-over.json";

/// The file of the run folder with how far the missions of its vehicles have come, once one has ended before the last slot:
/// a run that is resumed leaves those.
const ENDED: &str = "vehicles.json";

/// How far the missions of the vehicles of the run in a folder have come, by UAV; none if all go on.
///
/// # Errors
/// If the file cannot be read.
pub fn ended_in(run: &Path) -> Result<Vec<Fate>, InputError> {
    let expected = "expected how far the vehicles have come, as the bridge has written it";
    read(&run.join(ENDED)).ok_or_else(|| InputError::new("run folder", &run.join(ENDED), expected))
}

/// What is known of a vehicle.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct SavedVehicle {
    /// Which one it is, once that is chosen.
    pub chosen: Option<ChosenVehicle>,
    /// What was done with it.
    pub history: History,
}

/// What was saved.
#[derive(Debug)]
pub struct SavedVehicles {
    folder: PathBuf,
    /// The folder of the run, if it is on this host.
    run: Option<PathBuf>,
    ended: Vec<Fate>,
    /// By UAV.
    vehicles: Vec<SavedVehicle>,
    /// Whether the bridge before has chosen a vehicle.
    has_chosen_before: bool,
    /// The numbers of the vehicles that were taken over, from 1.
    taken_over: Vec<usize>,
    /// The files of which it was said that they cannot be written.
    said: Vec<PathBuf>,
    /// Whether it saves for the first time how far the missions have come in a run that begins, or is resumed.
    begins_run: bool,
}

impl SavedVehicles {
    /// What the bridge before has saved of its `uavs` vehicles in the folder of the ring, if this one `is_restarted`. If
    /// that cannot be read, which is said, none is armed: they may have been.
    #[must_use]
    pub fn of(folder: &Path, is_restarted: bool, uavs: usize) -> Self {
        let (mut vehicles, mut taken_over) = (Vec::<SavedVehicle>::new(), Vec::<usize>::new());
        if is_restarted {
            taken_over = read(&folder.join(TAKEN_OVER)).unwrap_or_default();
            vehicles = read(&folder.join(VEHICLES)).unwrap_or_else(|| {
                Role::FlightSim
                    .log(format_args!("{VEHICLES} cannot be read: no vehicle is armed, as the bridge before may have"));
                vec![UNKNOWN; uavs]
            });
        }
        for (vehicle, number) in vehicles.iter_mut().zip(1..) {
            if matches!(vehicle.history.fate, Fate::Open | Fate::Returns) && taken_over.contains(&number) {
                vehicle.history.fate = Fate::Left; // only that could be written
            }
        }
        let has_chosen_before = vehicles.iter().any(|vehicle| vehicle.chosen.is_some());
        let begins_run = !is_restarted || vehicles.is_empty(); // then the bridge before has not polled
        let run = record_path(folder);
        let ended = run.as_deref().and_then(|run| ended_in(run).ok()).unwrap_or_default();
        Self {
            folder: folder.to_owned(),
            run,
            ended,
            vehicles,
            has_chosen_before,
            taken_over,
            said: Vec::new(),
            begins_run,
        }
    }

    /// The vehicles, by UAV; none before they are saved.
    pub fn vehicles(&self) -> &[SavedVehicle] {
        &self.vehicles
    }

    /// Whether the bridge before has chosen a vehicle.
    pub fn has_chosen_before(&self) -> bool {
        self.has_chosen_before
    }

    /// Saves what the bridge after this one has to know. Returns whether that is saved.
    pub fn save(&mut self, vehicles: Vec<SavedVehicle>) -> bool {
        let is_saved = vehicles == self.vehicles
            || self.write(&self.folder.join(VEHICLES), &vehicles, ": no vehicle is armed meanwhile");
        if is_saved {
            self.vehicles = vehicles;
        }
        is_saved
    }

    /// Saves that the vehicles of these numbers, from 1, were taken over.
    pub fn save_taken_over(&mut self, numbers: Vec<usize>) {
        let mut taken_over = self.taken_over.clone();
        taken_over.extend(numbers.iter().filter(|number| !self.taken_over.contains(number)));
        if taken_over.len() > self.taken_over.len() && self.write(&self.folder.join(TAKEN_OVER), &taken_over, "") {
            self.taken_over = taken_over;
        }
    }

    /// Saves in the folder of the run which vehicles were taken over or given up, and, if the mission `has_begun`, which have
    /// ended it, as `is_end` says, by number from 0: none that has ended begins again, but one that returned before the run
    /// was resumed does, and one that does not begin may begin when it is.
    pub fn save_ended(
        &mut self,
        fates: impl Iterator<Item = Fate>,
        has_begun: bool,
        is_end: impl Fn(usize, Fate) -> bool,
    ) {
        let is_kept = |uav, fate| matches!(fate, Fate::Left | Fate::Abandoned) || has_begun && is_end(uav, fate);
        let kept = fates.enumerate().map(|(uav, fate)| if is_kept(uav, fate) { fate } else { Fate::Open });
        let mut fates: Vec<Fate> = kept.collect();
        let begins_run = std::mem::take(&mut self.begins_run);
        for (now, before) in fates.iter_mut().zip(&self.ended) {
            if *now == Fate::Open && !(begins_run && *before == Fate::Returns) {
                *now = *before;
            }
        }
        if let Some(run) = &self.run
            && fates != self.ended
            && (!self.ended.is_empty() || fates.iter().any(|fate| *fate != Fate::Open))
            && self.write(&run.join(ENDED), &fates, ": --resume would fly its vehicles again")
        {
            self.ended = fates;
        }
    }

    /// Writes a file whole or, if that fails, not at all, which is said once, with what `follows`. Returns whether it was
    /// written.
    fn write(&mut self, path: &Path, content: &impl Serialize, follows: &str) -> bool {
        let name = path.file_name().unwrap_or_default().display();
        let new = path.with_file_name(format!(".{name}.new"));
        let text = serde_json::to_string(content).expect("numbers and addresses are JSON");
        let written = std::fs::write(&new, text).and_then(|()| std::fs::rename(&new, path));
        if let Err(error) = &written
            && !self.said.iter().any(|said| said == path)
        {
            self.said.push(path.to_owned());
            Role::FlightSim.log(format_args!("{name} cannot be written: {error}{follows}"));
        }
        written.is_ok()
    }
}

/// A vehicle of which nothing is known any more: it may have been armed.
const UNKNOWN: SavedVehicle = SavedVehicle {
    chosen: None,
    history: History { was_armed: true, was_down: false, has_seen_return: false, fate: Fate::Open },
};

/// The content of a file, empty if there is none; `None` if it cannot be read.
fn read<T: DeserializeOwned + Default>(path: &Path) -> Option<T> {
    let Ok(file) = std::fs::symlink_metadata(path) else { return Some(T::default()) };
    let text = if file.is_file() { std::fs::read_to_string(path).ok() } else { None };
    serde_json::from_str(&text?).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_saved_is_known_to_the_next_bridge_and_what_is_not_is_tried_again() {
        let folder = tempfile::tempdir().unwrap();
        let chosen = Some(ChosenVehicle { system: 3, address: Some(([127, 0, 0, 1], 14550).into()) });
        let of = |was_armed, fate| SavedVehicle {
            chosen,
            history: History { was_armed, was_down: !was_armed, has_seen_return: was_armed, fate },
        };
        let fates = [Fate::Open, Fate::Returns, Fate::Ended, Fate::Left, Fate::Abandoned];
        let vehicles: Vec<_> = fates.into_iter().flat_map(|fate| [of(false, fate), of(true, fate)]).collect();
        let mut saved = SavedVehicles::of(folder.path(), false, 2);
        assert!(!saved.has_chosen_before() && saved.save(Vec::new()) && saved.save(vehicles.clone()));
        saved.save_taken_over(vec![1]);
        saved.save_taken_over(vec![2, 4, 5]);
        let next = SavedVehicles::of(folder.path(), true, 2);
        let mut expected = vehicles.clone();
        [0, 1, 3].into_iter().for_each(|taken| expected[taken].history.fate = Fate::Left); // but for the fifth, which has landed since
        assert_eq!((next.vehicles(), next.has_chosen_before()), (&*expected, true));
        assert_eq!(next.taken_over, [1, 2, 4, 5]);
        assert!(SavedVehicles::of(folder.path(), false, 2).vehicles().is_empty(), "a new run begins anew");

        let mut lost = SavedVehicles::of(&folder.path().join("none"), true, 2);
        assert!(!lost.save(vehicles.clone()) && !lost.save(vehicles.clone()));
        std::fs::create_dir(folder.path().join("none")).unwrap();
        assert!(lost.save(vehicles));
    }

    #[test]
    fn what_has_ended_in_a_run_stays_so_in_its_folder() {
        let [ring, run] = [0; 2].map(|_| tempfile::tempdir().unwrap());
        std::fs::write(ring.path().join("record"), run.path().to_str().unwrap()).unwrap();
        let save = |is_restarted: bool, has_begun: bool, polls: &[[Fate; 3]]| {
            let mut saved = SavedVehicles::of(ring.path(), is_restarted, 3);
            assert!(saved.save(vec![UNKNOWN; 3]));
            let is_end = |_, fate| matches!(fate, Fate::Ended | Fate::Returns);
            polls.iter().for_each(|fates| saved.save_ended(fates.iter().copied(), has_begun, is_end));
            ended_in(run.path()).unwrap()
        };
        let saved_by = |polls: &[[Fate; 3]]| save(false, true, polls);
        assert_eq!(saved_by(&[[Fate::Open; 3]]), []);
        assert_eq!(saved_by(&[[Fate::Returns, Fate::Open, Fate::Open]]), [Fate::Returns, Fate::Open, Fate::Open]);
        for has_begun in [false, true] {
            let next = save(true, has_begun, &[[Fate::Returns, Fate::Open, Fate::Open], [Fate::Open; 3]]);
            assert_eq!(next, [Fate::Returns, Fate::Open, Fate::Open], "a bridge that is restarted does not forget it");
        }
        assert_eq!(saved_by(&[[Fate::Open; 3]]), [Fate::Open; 3], "it flies again");
        save(false, true, &[[Fate::Returns, Fate::Open, Fate::Open]]);
        std::fs::remove_file(ring.path().join(VEHICLES)).unwrap(); // the first bridge of a run died before it polled
        let mut saved = SavedVehicles::of(ring.path(), true, 3);
        saved.save_ended([Fate::Open; 3].into_iter(), true, |_, _| true);
        assert_eq!(ended_in(run.path()).unwrap(), [Fate::Open; 3], "it flies again");
        let returns = [Fate::Returns, Fate::Ended, Fate::Open];
        assert_eq!(save(false, false, &[returns]), [Fate::Open; 3], "before its mission");
        assert_eq!(saved_by(&[[Fate::Ended, Fate::Left, Fate::Open]]), [Fate::Ended, Fate::Left, Fate::Open]);
        // A run that is resumed does not know them as well.
        let next = [[Fate::Open, Fate::Abandoned, Fate::Open], [Fate::Open, Fate::Open, Fate::Returns]];
        assert_eq!(saved_by(&next), [Fate::Ended, Fate::Abandoned, Fate::Returns]);
        assert_eq!(saved_by(&[[Fate::Open, Fate::Open, Fate::Ended]]), [Fate::Ended, Fate::Abandoned, Fate::Ended]);
    }

    #[test]
    fn vehicles_of_which_the_file_cannot_be_read_may_have_been_armed() {
        let folder = tempfile::tempdir().unwrap();
        let was_armed = || {
            let saved = SavedVehicles::of(folder.path(), true, 2);
            saved.vehicles().iter().map(|vehicle| vehicle.history.was_armed).collect::<Vec<_>>()
        };
        assert!(was_armed().is_empty(), "the bridge before has not begun");
        let file = folder.path().join(VEHICLES);
        for text in ["", "[", "{}", "\0"] {
            std::fs::write(&file, text).unwrap();
            assert_eq!(was_armed(), [true; 2], "{text:?}");
        }
        std::fs::remove_file(&file).unwrap();
        std::os::unix::fs::symlink("/dev/zero", &file).unwrap();
        assert_eq!(was_armed(), [true; 2], "a link to a device");
    }
}
