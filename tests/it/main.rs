//! The executables, as a user runs them.

mod agreement;
mod arrivals;
mod changes;
mod channel_map;
mod channel_table;
mod check;
mod cli;
#[cfg(feature = "lab")]
mod compare;
#[cfg(all(feature = "lab", feature = "viewer"))]
mod docs;
mod examples;
mod export;
mod external;
mod farm;
mod fixtures;
mod fleet;
mod folders;
#[cfg(feature = "lab")]
mod foreign_lists;
#[cfg(feature = "lab")]
mod foreign_zones;
mod help;
mod hosts;
mod imports;
mod invariants;
mod keys;
#[cfg(feature = "lab")]
mod least_fleet;
#[cfg(feature = "lab")]
mod library;
mod motion;
mod names;
mod new;
mod nodes;
mod objectives;
mod optimize;
#[cfg(feature = "lab")]
mod outcomes;
mod plot;
mod presets;
#[cfg(feature = "viewer")]
mod recording;
mod refusals;
mod release;
mod replay;
mod report;
mod reproduce;
mod resume;
mod ring;
mod settings;
#[path = "../support/mod.rs"]
mod support;
#[cfg(feature = "lab")]
mod surveys;
#[cfg(feature = "lab")]
mod sweep;
#[cfg(feature = "lab")]
mod tables;
mod topics;
mod track;
mod vehicle;
#[cfg(feature = "viewer")]
mod view;
