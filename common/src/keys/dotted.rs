//! Dotted keys, such as `link.los.a`, in the tables of a scenario.

use toml::{Table, Value};

/// The dotted name of `key` in the table `table`, whose name is empty for the scenario itself.
#[must_use]
pub fn join(table: &str, key: &str) -> String {
    if table.is_empty() { key.to_owned() } else { format!("{table}.{key}") }
}

/// The dotted name of `key` in the table of the dotted key `sibling`.
#[must_use]
pub fn beside(sibling: &str, key: &str) -> String {
    join(sibling.rsplit_once('.').map_or("", |(table, _)| table), key)
}

/// Whether the dotted `key` lies in the table `table`.
#[must_use]
pub fn is_below(key: &str, table: &str) -> bool {
    key.strip_prefix(table).is_some_and(|rest| rest.starts_with('.'))
}

/// The value of a dotted key.
#[must_use]
pub fn value<'a>(table: &'a Table, key: &str) -> Option<&'a Value> {
    let mut names = key.split('.');
    let first = table.get(names.next()?)?;
    names.try_fold(first, |table, name| table.get(name))
}

/// The value under a dotted key, to change it.
#[must_use]
pub fn value_mut<'a>(table: &'a mut Table, key: &str) -> Option<&'a mut Value> {
    let mut names = key.split('.');
    let first = table.get_mut(names.next()?)?;
    names.try_fold(first, |table, name| table.get_mut(name))
}

/// Inserts a dotted key that is missing, with its tables. If one of them is no table, nothing happens.
pub fn insert_missing(mut table: &mut Table, key: &str, value: Value) {
    let (names, last) = key.rsplit_once('.').unwrap_or(("", key));
    for name in names.split_terminator('.') {
        match table.entry(name).or_insert_with(|| Table::new().into()) {
            Value::Table(inner) => table = inner,
            _ => return,
        }
    }
    table.entry(last).or_insert(value);
}

/// Removes a dotted key, if present.
pub fn remove(table: &mut Table, key: &str) {
    let (table, last) = match key.rsplit_once('.') {
        Some((parent, last)) => (value_mut(table, parent).and_then(Value::as_table_mut), last),
        None => (Some(table), key),
    };
    table.and_then(|table| table.remove(last));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_key_is_found_and_removed_by_its_dotted_name() {
        let mut table: Table = "a = 1\n[b]\nc = 2\nd = { e = 3 }".parse().unwrap();
        assert_eq!(value(&table, "b.d.e"), Some(&Value::Integer(3)));
        assert_eq!(value(&table, "a.c"), None);
        for key in ["b.d.e", "a.c", "x.y", "b.c"] {
            remove(&mut table, key);
        }
        assert_eq!(table, "a = 1\n[b]\nd = {}".parse().unwrap());
    }
}
