//! skysink
fn main() {}
