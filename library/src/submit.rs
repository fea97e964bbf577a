//! The record of the best known flight of an instance: checked, and replaced by a better flight.

use std::fs;

use skysink_common::build::VERSION;
use skysink_common::error::InputError;
use skysink_common::stop::Stop;
use skysink_mission::MissionError;
use skysink_mission::error::FileContext as _;
use skysink_mission::files::write_whole;
use xxhash_rust::xxh3::xxh3_64;

use crate::best::{BestFlight, best_file};
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
        let Some(best) = self.best(instance)? else { return Ok(None) };
        let name = best_file(instance, "csv.gz");
        let path = self.path(&name);
        let refuse = |what: String| InputError::new(LIBRARY, &path, what);
        let bytes = self.read(&name)?.ok_or_else(|| refuse("it is missing".to_owned()))?;
        if hash(&bytes) != best.plans {
            return Err(refuse(format!(
                "hash {}: expected {}, of best/{}.toml",
                hash(&bytes),
                best.plans,
                instance.name
            ))
            .into());
        }
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
        let (library, instance) = (&open.library, &open.instance);
        let refuse = |what: String| InputError::of_argument("instance", &instance.name, what);
        let folder = library.folder();
        let folder =
            folder.ok_or_else(|| refuse("expected --library DIR, the folder `library` of a checkout".to_owned()))?;
        let known = library.best(instance)?;
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
        write_whole(&folder.join(best_file(instance, "csv.gz")), &plans)?;
        let text = toml::to_string(&best).expect("plain keys and values");
        write_whole(&folder.join(best_file(instance, "toml")), text.as_bytes())?;
        Ok(best)
    }
}

/// XXH3 of bytes, as 16 hexadecimal digits.
fn hash(bytes: &[u8]) -> String {
    format!("{:016x}", xxh3_64(bytes))
}
