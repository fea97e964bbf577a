//! The descriptions of scenario keys: every key has one, and tables, lists and optional keys are read by theirs.

use std::path::Path;

use serde::{Deserialize, Serialize};
use skysink_common::error::InputError;
use skysink_common::keys::{Accepts, Keys, Only, POSITIVE, Source, all, fill, read};
use skysink_common::scenario::{Overrides, Scenario};
use toml::{Table, Value};

/// Endings of names, and the units that go with them.
const UNITS: [(&str, &str); 14] = [
    ("_m", "[m]"),
    ("_m2", "[m²]"),
    ("_s", "[s]"),
    ("_ms", "[ms]"),
    ("_dbm_per_hz", "[dBm/Hz]"),
    ("_hz", "[Hz]"),
    ("_w", "[W]"),
    ("_bits", "[bit]"),
    ("_bps", "[bit/s]"),
    ("_mps", "[m/s]"),
    ("_deg", "[°]"),
    ("_db", "[dB]"),
    ("_dbm", "[dBm]"),
    ("_kgpm3", "[kg/m³]"),
];

#[test]
fn every_written_key_is_described() {
    let los = "[link]\nmodel = 'probabilistic-los'\n";
    let texts = [
        "[area]\norigin_lat_deg = 0.0\norigin_lon_deg = 0.0\n[link]\ngain_db = -50.0\n".to_owned(),
        "[area]\nwidth_m = 90.0\nheight_m = 60.0\n".to_owned(),
        format!("[uav]\naltitude = 'free'\n{los}los = {{ a = 9.61, b = 0.16 }}\n"),
        format!("{los}los = {{ b1 = -0.4568, b2 = 0.047, b3 = -0.63, b4 = 1.63 }}\n"),
    ];
    let described = all(Scenario::KEYS, "");
    for text in texts {
        let text = format!("name = 'x'\n{text}");
        let scenario = Scenario::parse(&text, Path::new("x.toml"), Overrides::default()).unwrap();
        let mut written = Vec::new();
        add_names(&scenario.to_toml().parse().unwrap(), "", &mut written);
        assert!(written.len() > 30, "{written:?}");
        for name in written {
            assert_eq!(described.iter().filter(|(key, _)| *key == name).count(), 1, "{name}");
        }
    }
}

/// Adds the dotted names of all keys.
fn add_names(table: &Table, prefix: &str, names: &mut Vec<String>) {
    for (key, value) in table {
        let name = format!("{prefix}{key}");
        if let Value::Table(inner) = value {
            add_names(inner, &format!("{name}."), names);
        }
        names.push(name);
    }
}

#[test]
fn the_meaning_of_a_key_has_the_unit_of_its_name() {
    for (name, key) in all(Scenario::KEYS, "") {
        let unit = UNITS.iter().find(|(ending, _)| name.ends_with(ending));
        assert!(unit.is_none_or(|(_, unit)| key.words.contains(unit)), "{name}: {}", key.words);
        assert!(key.words.ends_with('.') && !key.words.contains(['|', '\n']), "{name}: {}", key.words);
    }
}

#[test]
fn every_default_is_accepted() {
    for (name, key) in all(Scenario::KEYS, "") {
        let Some(default) = key.default else { continue };
        let default: Value = default.parse().unwrap_or_else(|error| panic!("{name} = {default}: {error}"));
        assert_eq!(key.accepts.refusal(&default), None, "{name} = {default}");
    }
}

skysink_common::keys! {
    /// A table with all there may be.
    #[derive(Debug, PartialEq, Serialize, Deserialize)]
    #[serde(deny_unknown_fields)]
    pub struct Dock {
        /// How it charges.
        mode: String = "swap", Accepts::OneOf(&["swap", "plug"]);
        /// Power of the charger [W].
        charger_w: Option<f64> = 90.0, POSITIVE, Only { key: "mode", values: &["plug"], expected: None };
        /// The pad that is kept free.
        spare: Option<Pad>, Accepts::TableOf(Pad::KEYS);
    }
}

skysink_common::keys! {
    /// A table in the table.
    #[derive(Debug, PartialEq, Serialize, Deserialize)]
    #[serde(deny_unknown_fields)]
    pub struct Pad {
        /// Width [m].
        width_m: f64 = 2.0, POSITIVE;
        /// Number.
        number: u32, Accepts::Whole(1, 9);
    }
}

fn base(text: &str) -> Result<Dock, InputError> {
    let mut table = text.parse().unwrap();
    fill(Dock::KEYS, "base", &mut table, &[]);
    read(table, "base", Source { path: Path::new("a.toml"), settings: &[], own: None })
}

#[test]
fn defaults_are_filled_into_tables_that_are_present() {
    let empty = Dock { mode: "swap".to_owned(), charger_w: None, spare: None };
    assert_eq!(base("").unwrap(), empty);
    assert_eq!(base("mode = 'plug'").unwrap(), Dock { mode: "plug".to_owned(), charger_w: Some(90.0), ..empty });
    let width_m = |text: &str| base(text).unwrap().spare.unwrap().width_m;
    assert_eq!([width_m("[spare]\nnumber = 3\n"), width_m("[spare]\nnumber = 2\nwidth_m = 3.0\n")], [2.0, 3.0]);
}

#[test]
fn keys_of_tables_are_refused_by_their_dotted_names() {
    let cases = [
        ("[spare]\nnumber = 12\n", "base.spare.number = 12: expected 1 to 9"),
        ("[spare]\nnumber = 1\nwidth_m = 0.0\n", "base.spare.width_m = 0.0: expected a finite number above 0"),
        ("[[spare]]\nnumber = 12\n", "base.spare = [{ number = 12 }]: expected a table, [base.spare]"),
        ("[spare]\nwidth_m = 1.0\n", "base.spare: missing `number`: this key is required"),
    ];
    for (text, expected) in cases {
        assert_eq!(base(text).unwrap_err().to_string(), format!("scenario a.toml: {expected}"));
    }
}
