//! What takes minutes: runs whose processes are killed again and again.

mod reliability;
#[path = "../support/mod.rs"]
mod support;
