//! The definition of a sweep: a grid of points, by strategy and seed.

use std::collections::{BTreeMap, HashSet};

use serde::{Deserialize, Deserializer, Serialize, Serializer};
use xxhash_rust::xxh3::xxh3_64;

use super::shard::Shard;

/// Everything that the results of a sweep depend on, as in `sweep.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Definition {
    /// Hash of the other fields.
    pub identity: String,
    /// Hash of what all missions have in common: the version, the keys and points, and the scenario and sensor list of
    /// each point. It stays when the sweep is extended.
    pub grid: String,
    /// Version of Skysink.
    pub version: String,
    /// Dotted names of the swept keys.
    pub keys: Vec<String>,
    /// The values of the keys, by point of the grid; the last key varies fastest. Infinite ones are strings in JSON.
    #[serde(serialize_with = "serialize_points", deserialize_with = "deserialize_points")]
    pub points: Vec<Vec<toml::Value>>,
    /// Names of the strategies, in the order of the results.
    pub strategies: Vec<String>,
    /// Hash of the source of each strategy in Python, by its name.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub sources: BTreeMap<String, String>,
    /// Arrivals and channel in Python, with hashes of their sources.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub models: Vec<(String, String)>,
    /// Seeds, ascending. All strategies use the same seeds and thus the same fields.
    pub seeds: Vec<u64>,
}

/// Infinities, which JSON does not have.
const INFINITE: [&str; 2] = ["-inf", "inf"];

fn serialize_points<S: Serializer>(points: &[Vec<toml::Value>], serializer: S) -> Result<S::Ok, S::Error> {
    let text = |value: &toml::Value| match value.as_float() {
        Some(number) if number.is_infinite() => Some(number.to_string().into()),
        _ => None,
    };
    let points = points.iter().map(|point| point.iter().map(|value| replaced(value, &text)).collect::<Vec<_>>());
    serializer.collect_seq(points)
}

fn deserialize_points<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<Vec<toml::Value>>, D::Error> {
    let number = |value: &toml::Value| {
        let name = value.as_str().filter(|name| INFINITE.contains(name))?;
        Some(name.parse::<f64>().expect("a number").into())
    };
    let points = Vec::<Vec<toml::Value>>::deserialize(deserializer)?;
    Ok(points.iter().map(|point| point.iter().map(|value| replaced(value, &number)).collect()).collect())
}

/// A value with others instead of its parts, where there are.
fn replaced(value: &toml::Value, other: &dyn Fn(&toml::Value) -> Option<toml::Value>) -> toml::Value {
    match value {
        toml::Value::Array(values) => values.iter().map(|value| replaced(value, other)).collect::<Vec<_>>().into(),
        toml::Value::Table(table) => {
            table.iter().map(|(key, value)| (key.clone(), replaced(value, other))).collect::<toml::Table>().into()
        }
        _ => other(value).unwrap_or_else(|| value.clone()),
    }
}

impl Definition {
    /// The hash of all fields but the identity.
    pub(crate) fn hash(&self) -> String {
        let plain = Self { identity: String::new(), ..self.clone() };
        format!("{:016x}", xxh3_64(serde_json::to_string(&plain).expect("plain values").as_bytes()))
    }

    /// The number of fields: points of the grid times seeds.
    pub fn fields(&self) -> usize {
        self.points.len() * self.seeds.len()
    }

    /// The number of missions: fields times strategies.
    pub fn mission_count(&self) -> usize {
        self.fields() * self.strategies.len()
    }

    /// The keys with their values, of which the points are all combinations.
    pub fn axes(&self) -> toml::Table {
        let axis = |(place, key): (usize, &String)| {
            let mut seen = HashSet::new();
            let values = self.points.iter().map(|point| &point[place]);
            (key.clone(), values.filter(|value| seen.insert(value.to_string())).cloned().collect::<Vec<_>>().into())
        };
        self.keys.iter().enumerate().map(axis).collect()
    }

    /// What this sweep has and `larger` has not; `None` if `larger` is this sweep, or this one with more seeds and with
    /// more strategies behind its own.
    pub(crate) fn lacking_in(&self, larger: &Self) -> Option<String> {
        let is_changed = |(name, source): &(&String, &String)| larger.sources.get(*name) != Some(*source);
        if self.keys != larger.keys {
            Some(format!("axes {:?}", self.keys))
        } else if self.points != larger.points {
            Some("other values of the axes".to_owned())
        } else if self.grid != larger.grid {
            Some("another scenario, sensor list or version of Skysink".to_owned())
        } else if self.models != larger.models {
            Some("other arrivals or another channel in Python".to_owned())
        } else if !larger.strategies.starts_with(&self.strategies) {
            Some(format!("strategies {:?}: expected them first", self.strategies))
        } else if let Some((name, _)) = self.sources.iter().find(is_changed) {
            Some(format!("another source of {name}"))
        } else {
            let seed = self.seeds.iter().find(|seed| larger.seeds.binary_search(seed).is_err());
            seed.map(|seed| format!("seed {seed}"))
        }
    }

    /// The missions of a shard, in the order of the results: those over every n-th field from the k-th, in the order of
    /// points and seeds. Empty if k exceeds the number of fields.
    pub fn missions(&self, shard: Shard) -> impl Iterator<Item = MissionKey> {
        let (k, n) = shard.into();
        let indices = (0..self.mission_count()).filter(move |&index| self.shard_of(index, n) == k);
        indices.map(|index| {
            let group = index / self.seeds.len();
            let strategies = self.strategies.len();
            let seed = self.seeds[index % self.seeds.len()];
            MissionKey { point: group / strategies, strategy: group % strategies, seed }
        })
    }

    /// The shard, of `n`, that contains the mission with this index in the results of the whole sweep.
    pub(crate) fn shard_of(&self, index: usize, n: usize) -> usize {
        let seeds = self.seeds.len();
        let point = index / seeds / self.strategies.len();
        (point * seeds + index % seeds) % n + 1
    }

    /// The index of a mission in the results of the whole sweep; `None` if it does not belong to the sweep.
    pub fn index(&self, MissionKey { point, strategy, seed }: MissionKey) -> Option<usize> {
        let seed = self.seeds.binary_search(&seed).ok()?;
        let exists = point < self.points.len() && strategy < self.strategies.len();
        exists.then(|| (point * self.strategies.len() + strategy) * self.seeds.len() + seed)
    }
}

/// One mission of a sweep. The order is that of the results.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct MissionKey {
    /// Point of the grid.
    pub point: usize,
    /// Index of the strategy in the sweep's list.
    pub strategy: usize,
    /// The seed.
    pub seed: u64,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn infinite_values_are_kept_in_json() {
        let inner: toml::Value = vec![toml::Value::Float(f64::INFINITY), "inf or so".into()].into();
        let definition = Definition {
            identity: String::new(),
            grid: String::new(),
            version: String::new(),
            keys: Vec::new(),
            points: vec![vec![f64::NEG_INFINITY.into(), 300.0.into()], vec![inner, 3.into()]],
            strategies: Vec::new(),
            sources: BTreeMap::new(),
            models: Vec::new(),
            seeds: Vec::new(),
        };
        let text = serde_json::to_string(&definition).unwrap();
        assert!(text.contains(r#""points":[["-inf",300.0],[["inf","inf or so"],3]]"#), "{text}");
        assert_eq!(serde_json::from_str::<Definition>(&text).unwrap(), definition);
    }
}
