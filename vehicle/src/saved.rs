//! What a bridge knows of its vehicles, in files of the ring, for the bridge after it and for the launcher.

use std::io;
use std::path::{Path, PathBuf};

use serde::Serialize;
use serde::de::DeserializeOwned;
use skysink_ring::role::Role;

use crate::link::ChosenVehicle;

/// The file of the ring with the vehicles that are chosen.
const CHOSEN: &str = "vehicles.json";

/// The file of the ring that is there once a vehicle was taken over.
pub const TAKEN_OVER: &str = "taken-over.json";

/// What was saved of the vehicles.
#[derive(Debug)]
pub struct SavedVehicles {
    folder: PathBuf,
    /// The vehicles that are chosen, by UAV.
    chosen: Vec<Option<ChosenVehicle>>,
    /// Whether that was saved by this bridge.
    is_new: bool,
    /// The numbers of the vehicles that were taken over, from 1.
    taken_over: Vec<usize>,
    /// Whether it was said that a file cannot be written.
    has_said: bool,
}

impl SavedVehicles {
    /// What the bridge before has saved in the folder of the ring, if this one `is_restarted`.
    #[must_use]
    pub fn of(folder: &Path, is_restarted: bool) -> Self {
        let folder = folder.to_owned();
        let mut saved = Self { folder, chosen: Vec::new(), is_new: true, taken_over: Vec::new(), has_said: false };
        if is_restarted {
            (saved.chosen, saved.taken_over) = (saved.read(CHOSEN), saved.read(TAKEN_OVER));
        }
        saved
    }

    /// The vehicles that are chosen, by UAV.
    pub fn chosen(&self) -> &[Option<ChosenVehicle>] {
        &self.chosen
    }

    /// The numbers of the vehicles, from 0, that have been armed by an order.
    pub fn armed(&self) -> impl Iterator<Item = usize> {
        let was_armed = |vehicle: &Option<ChosenVehicle>| vehicle.is_some_and(|vehicle| vehicle.was_armed);
        self.chosen.iter().enumerate().filter(move |(_, vehicle)| was_armed(vehicle)).map(|(uav, _)| uav)
    }

    /// The numbers of the vehicles, from 0, that were taken over.
    pub fn taken_over(&self) -> impl Iterator<Item = usize> {
        self.taken_over.iter().filter_map(|number| number.checked_sub(1))
    }

    /// Saves which vehicles are chosen, and have been armed, for the bridge after this one. Returns whether that is saved.
    pub fn save_chosen(&mut self, chosen: Vec<Option<ChosenVehicle>>) -> bool {
        let is_saved = !self.is_new && chosen == self.chosen || self.write(CHOSEN, &chosen);
        if is_saved {
            self.chosen = chosen;
            self.is_new = false;
        }
        is_saved
    }

    /// Saves which vehicles were taken over, by their numbers from 1, for the bridge after this one, and for the launcher:
    /// such a run is not to be resumed.
    pub fn save_taken_over(&mut self, numbers: &[usize]) {
        let mut taken_over = self.taken_over.clone();
        taken_over.extend(numbers.iter().filter(|number| !self.taken_over.contains(number)));
        if taken_over.len() > self.taken_over.len() && self.write(TAKEN_OVER, &taken_over) {
            self.taken_over = taken_over;
        }
    }

    /// The content of a file; empty if there is none, or another.
    fn read<T: DeserializeOwned + Default>(&self, name: &str) -> T {
        let text = std::fs::read_to_string(self.folder.join(name)).unwrap_or_default();
        serde_json::from_str(&text).unwrap_or_default()
    }

    /// Writes a file whole or, if that fails, not at all, and says so once. Returns whether it was written.
    fn write(&mut self, name: &str, content: &impl Serialize) -> bool {
        let path = self.folder.join(name);
        let new = path.with_extension("new");
        let text = serde_json::to_string(content).expect("numbers and addresses are JSON");
        let written: io::Result<()> = std::fs::write(&new, text).and_then(|()| std::fs::rename(&new, &path));
        if let Err(error) = &written
            && !std::mem::replace(&mut self.has_said, true)
        {
            Role::FlightSim.log(format_args!("{name} cannot be written: {error}: no vehicle is armed meanwhile"));
        }
        written.is_ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_saved_is_known_to_the_next_bridge_and_what_is_not_is_told() {
        let folder = tempfile::tempdir().unwrap();
        let vehicle = |was_armed| Some(ChosenVehicle { system: 3, address: None, was_armed });
        let mut saved = SavedVehicles::of(folder.path(), false);
        assert!(
            saved.save_chosen(vec![vehicle(false), None]) && saved.save_chosen(vec![vehicle(false), vehicle(true)])
        );
        saved.save_taken_over(&[1]);
        saved.save_taken_over(&[2]);
        let of_next = |is_restarted| {
            let next = SavedVehicles::of(folder.path(), is_restarted);
            (next.chosen().len(), next.armed().collect::<Vec<_>>(), next.taken_over().collect::<Vec<_>>())
        };
        assert_eq!(of_next(true), (2, vec![1], vec![0, 1]));
        assert_eq!(of_next(false), (0, vec![], vec![]), "a new run begins anew");

        let mut lost = SavedVehicles::of(&folder.path().join("none"), true);
        assert!(!lost.save_chosen(vec![]) && !lost.save_chosen(vec![]), "it is tried again");
        std::fs::create_dir(folder.path().join("none")).unwrap();
        assert!(lost.save_chosen(vec![]));
    }
}
