//! Recordings in a browser: a page of the rerun web viewer with the recordings that it shows.
//!
//! [`page`] is what the page consists of, and leaves it as a folder; [`server`] serves it by HTTP. What is in a
//! recording is left to `skysink-viewer`. The only crate that knows HTTP.

pub mod page;
pub mod server;

pub use page::{PageError, WebPage};
pub use server::Server;
