//! Text and files: errors, tables, checkpoints, what is written, and how a process waits and ends.

pub mod build;
pub mod checkpoint;
pub mod csv_cell;
pub(crate) mod csv_rows;
pub mod error;
pub mod file_locks;
pub mod markup;
pub mod pace;
pub mod stop;
pub mod terminal;
pub mod written_file;
