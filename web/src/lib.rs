//! Shows recordings in a browser, with the rerun web viewer.
//!
//! [`page`] contains the files of the page and writes them to a folder; [`site`] says who may read them, and [`server`]
//! serves them over HTTP. The content of recordings is defined in `skysink-viewer`. This is the only crate that depends
//! on HTTP.

pub mod page;
pub mod server;
pub mod site;

pub use page::{PageError, WebPage};
pub use server::Server;
pub use site::Site;
