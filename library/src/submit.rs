//! The record of the best known flight of an instance: checked, and replaced by a better flight.

use std::fs::{self, File};
use std::path::Path;

use skysink_common::build::VERSION;
use skysink_common::error::InputError;
use skysink_common::stop::Stop;
use skysink_mission::MissionError;
use skysink_mission::error::FileContext as _;
use skysink_mission::files::{is_unfinished, write_all};

use crate::best::{BestFlight, best_file, hash};
use crate::instance::{Instance, LIBRARY, Library};
use crate::plan_file;
use crate::verify::{FlightSource, FlownFlight};

/// Who found a flight, and at what cost.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Claim {
    /// Who or what found it.
    pub by: String,
    /// What it cost.
    pub cost: String,
}

impl Library {
    /// Flies the best known flight of an instance again, and compares it with what is said of it; `None` without one.
    ///
    /// # Errors
    /// If a file was changed, or on a stop.
    pub fn verify_best(&self, instance: &Instance, stop: &Stop) -> Result<Option<FlownFlight>, MissionError> {
        let Some(best) = self.recorded_best(instance)? else { return Ok(None) };
        let bytes = self.plans_of(instance, &best)?;
        let path = self.path(&best_file(instance, "csv.gz"));
        let refuse = |what: String| InputError::new(LIBRARY, &path, what);
        let flown = self.fly_again(&[FlightSource::plan_file(&path, &bytes)?], Some(&instance.name), stop)?;
        if (flown.measure, flown.value) != (best.measure, best.value) {
            let what = format!("{:?} {}: expected {:?} {}", flown.measure, flown.value, best.measure, best.value);
            return Err(refuse(what).into());
        }
        flown.require_possible(best.bound)?;
        Ok(Some(flown))
    }
}

impl FlownFlight {
    /// Refuses a value that is better than a bound on that of every flight: one of them is wrong.
    fn require_possible(&self, bound: Option<f64>) -> Result<(), InputError> {
        match bound.filter(|bound| self.measure.is_better(self.value, *bound)) {
            Some(bound) => {
                let what = format_args!("value {}: expected none better than its bound, {bound}", self.value);
                Err(InputError::of_argument("instance", &self.open.instance.name, what))
            }
            None => Ok(()),
        }
    }

    /// Makes this flight the best known one of its instance, and returns its record.
    ///
    /// # Errors
    /// If it is not better, the library is that of this build, or a file cannot be written.
    pub fn submit(&self, claim: Claim) -> Result<BestFlight, MissionError> {
        let Self { open, measure, value, .. } = self;
        let library = &open.library;
        let instance = &open.instance;
        let refuse = |what: String| InputError::of_argument("instance", &instance.name, what);
        let folder = library.folder();
        let folder =
            folder.ok_or_else(|| refuse("expected --library DIR, the folder `library` of a checkout".to_owned()))?;
        // One process at a time, so that none replaces a better flight that another has just written.
        let index = library.locked(File::lock)?;
        // Of a flight whose plans are lost nobody can tell whether it is better.
        let known = match library.recorded_best(instance)? {
            Some(known) if library.has_plans(instance, &known)? => Some(known),
            _ => None,
        };
        if let Some(known) = known.as_ref().filter(|known| known.measure != *measure) {
            return Err(refuse(format!("{}: expected {}, as known", measure.label(), known.measure.label())).into());
        }
        if let Some(known) = known.as_ref().filter(|known| !measure.is_better(*value, known.value)) {
            let what =
                format!("{} {value}: expected a better one than {}, the best known", measure.label(), known.value);
            return Err(refuse(what).into());
        }
        let plans = plan_file::write(&instance.name, &self.plans, &open.scenario);
        let bound = match known.and_then(|known| known.bound) {
            None => self.bound()?,
            known => known,
        };
        self.require_possible(bound)?;
        let Claim { by, cost } = claim;
        let best = BestFlight {
            measure: *measure,
            value: *value,
            bound,
            by,
            cost,
            version: VERSION.to_owned(),
            plans: hash(&plans),
        };
        let best_folder = folder.join("best");
        fs::create_dir_all(&best_folder).at(&best_folder)?;
        remove_unfinished(&best_folder, instance)?;
        let text = toml::to_string(&best).expect("plain keys and values");
        let [plans_path, path] = ["csv.gz", "toml"].map(|extension| folder.join(best_file(instance, extension)));
        write_all(&[(plans_path, &plans[..]), (path, text.as_bytes())])?;
        drop(index);
        Ok(best)
    }
}

/// Removes what killed processes have left in the folder `best`.
fn remove_unfinished(best: &Path, instance: &Instance) -> Result<(), MissionError> {
    let is_own =
        |name: &str| name.strip_prefix(&instance.name).is_some_and(|rest| [".csv.gz", ".toml"].contains(&rest));
    for entry in fs::read_dir(best).at(best)?.flatten() {
        if is_unfinished(&entry.file_name().to_string_lossy(), is_own) {
            fs::remove_file(entry.path()).at(&entry.path())?;
        }
    }
    Ok(())
}
