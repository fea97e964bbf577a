//! The page has the table of the code.

#[test]
fn nothing() {}
