//! The library: named instances, fixed in every bit, with the best known flight and a bound for each, and the check of
//! any flight by anyone.
//!
//! | file | contents |
//! |---|---|
//! | `instances.toml` | a table for each instance: what it is, its family, its seeds |
//! | `NAME.toml`, `NAME.csv`, ... | the scenario of an instance, without a strategy, and its lists |
//! | `best/NAME.toml` | the [`BestFlight`]: value, bound, who found it |
//! | `best/NAME.csv.gz` | its plans |
//! | `standings.csv` | what strategies of Skysink reach, by version |

mod best;
mod instance;
mod plan_file;
mod submit;
mod verify;

pub use best::{BestFlight, ListedInstance, Measure, ReferenceValue, gap};
pub use instance::{Instance, Library, OpenInstance};
pub use plan_file::{PlannedFlight, PlannedMove};
pub use submit::Claim;
pub use verify::{FlownFlight, NamedValue, Placement};
