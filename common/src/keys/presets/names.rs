//! The names of the rows of a table, for the keys that choose one.

/// The names of the rows of a table.
macro_rules! names {
    ($rows:ident) => {
        &{
            let mut names = [""; $rows.len()];
            let mut row = 0;
            while row < $rows.len() {
                names[row] = $rows[row].name;
                row += 1;
            }
            names
        }
    };
}
pub(crate) use names;
