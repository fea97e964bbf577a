//! Has the crate compiled again when a file of the library is new.

fn main() {
    println!("cargo::rerun-if-changed=.");
}
