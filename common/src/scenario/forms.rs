//! Alternative forms: groups of keys for the same quantity, of which a scenario has one.
//!
//! The defaults of a form are not filled in beside the other form. A setting in one form removes the other form of the
//! file.

use toml::{Table, Value};

/// Two alternative forms: the keys of each, and what is expected if both are present.
pub(super) struct Forms {
    pub(super) forms: [&'static [&'static str]; 2],
    pub(super) expected: &'static str,
}

/// All alternatives.
pub(super) const FORMS: [Forms; 4] = [
    Forms {
        forms: [&["area.side_m"], &["area.width_m", "area.height_m"]],
        expected: "either side_m, or width_m and height_m",
    },
    Forms { forms: [&["sensors.count"], &["sensors.file"]], expected: "either count or file, not both" },
    Forms { forms: [&["link.environment"], &["link.los"]], expected: "either environment or los, not both" },
    Forms {
        forms: [&["link.los.a", "link.los.b"], &["link.los.b1", "link.los.b2", "link.los.b3", "link.los.b4"]],
        expected: "either a and b, or b1 to b4",
    },
];

/// The key that chooses between [`FREE_SPACE`] and [`LINE_OF_SIGHT`].
const MODEL: &str = "link.model";

/// Keys of the link that belong to the model `free-space` only.
pub(super) const FREE_SPACE: [&str; 2] = ["link.gain_db", "link.gain"];

/// Keys of the link that belong to the model `probabilistic-los` only.
pub(super) const LINE_OF_SIGHT: [&str; 7] = [
    "link.environment",
    "link.los",
    "link.reference_gain_db",
    "link.los_exponent",
    "link.nlos_exponent",
    "link.nlos_extra_db",
    "link.snr_gap_db",
];

/// All keys of alternative forms.
pub(super) fn keys() -> impl Iterator<Item = &'static str> {
    FORMS.iter().flat_map(|forms| forms.forms).flatten().copied().chain([MODEL])
}

/// The keys of the other form, which must not be present beside `key` with this value.
pub(super) fn displaced(key: &str, value: &Value) -> Vec<&'static str> {
    let is_in = |form: &[&str]| form.iter().any(|own| *own == key || is_below(key, own));
    let of_other_form = |forms: &Forms| match forms.forms.map(is_in) {
        [true, false] => forms.forms[1],
        [false, true] => forms.forms[0],
        _ => &[],
    };
    let of_other_model: &[&str] = match value.as_str() {
        Some("free-space") if key == MODEL => &LINE_OF_SIGHT,
        Some("probabilistic-los") if key == MODEL => &FREE_SPACE,
        _ => &[],
    };
    FORMS.iter().flat_map(of_other_form).chain(of_other_model).copied().collect()
}

/// Whether the dotted `key` lies in the table `table`.
pub(super) fn is_below(key: &str, table: &str) -> bool {
    key.strip_prefix(table).is_some_and(|rest| rest.starts_with('.'))
}

/// The value of a dotted key.
pub(super) fn value<'a>(table: &'a Table, key: &str) -> Option<&'a Value> {
    let mut names = key.split('.');
    let first = table.get(names.next()?)?;
    names.try_fold(first, |table, name| table.get(name))
}

/// Removes a dotted key, if present.
pub(super) fn remove(mut table: &mut Table, key: &str) {
    let mut names: Vec<&str> = key.split('.').collect();
    let last = names.pop().unwrap_or_default();
    for name in names {
        match table.get_mut(name) {
            Some(Value::Table(inner)) => table = inner,
            _ => return,
        }
    }
    table.remove(last);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_form_displaces_the_other_and_nothing_else() {
        let of = |key: &str, value: &str| displaced(key, &Value::String(value.to_owned()));
        assert_eq!(of("area.height_m", ""), ["area.side_m"]);
        assert_eq!(of("area.side_m", ""), ["area.width_m", "area.height_m"]);
        assert_eq!(of("sensors.file", ""), ["sensors.count"]);
        assert_eq!(of("link.los", ""), ["link.environment"]);
        assert_eq!(
            of("link.los.b", ""),
            ["link.environment", "link.los.b1", "link.los.b2", "link.los.b3", "link.los.b4"]
        );
        assert_eq!(of("link.model", "probabilistic-los"), FREE_SPACE);
        assert_eq!(of("link.model", "free-space"), LINE_OF_SIGHT);
        for key in ["area", "area.origin_lat_deg", "link.los_exponent", "slots"] {
            assert_eq!(of(key, "free-space"), [""; 0], "{key}");
        }
    }

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
