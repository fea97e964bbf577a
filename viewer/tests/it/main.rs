//! Recordings, read back.

mod chunks;
mod files;
mod kills;
mod line_of_sight;
mod links;
mod maps;
mod recording;
mod scene;
mod support;
