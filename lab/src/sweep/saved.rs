//! What the folder of a sweep holds of its definition, so that the folder alone repeats the sweep: `scenario.toml` with
//! its sensor list, the sources of strategies in Python, and `sweep.toml`.

use std::fs;
use std::path::{Path, PathBuf};

use skysink_common::channel::RateTable;
use skysink_common::error::InputError;
use skysink_common::keys::dotted;
use skysink_common::nodes;
use skysink_common::scenario::{CHANNEL, Overrides, RATES, Scenario, TRACE};
use skysink_common::terminal::shell_path;
use skysink_mission::error::FileContext;
use skysink_mission::files::read_regular;
use skysink_mission::origin::{SourceFile, is_source};
use skysink_planner::settings;
use skysink_planner::strategies::PYTHON;
use toml::Table;
use xxhash_rust::xxh3::xxh3_64;

use super::definition::Definition;
use super::manifest::{ARRAYS, Manifest, SCENARIO, SENSORS, SWEEP, TRACK};
use super::plan::Sweep;
use super::settings::{ExternalStrategy, Seeds, SweepBase, SweepFile, SweepSettings};
use crate::error::LabError;

/// A file with its path in the folder of a sweep.
pub(crate) type SavedFile = (PathBuf, Vec<u8>);

/// Reads the sweep in the folder `path`, and its definition. `external` are its strategies in Python.
///
/// # Errors
/// If the folder is not that of a sweep of this version, or `sweep.toml` was modified.
pub(crate) fn read(path: &Path, external: Vec<ExternalStrategy>) -> Result<(SweepSettings, Definition), LabError> {
    let refuse = |message: String| InputError::new("sweep", path, message);
    let scenario = path.join(SCENARIO);
    if !scenario.is_file() {
        let message = "it is a folder without scenario.toml, in which no sweep was begun or an earlier version flew: \
                       expected a sweep file, and the folder as --out";
        return Err(refuse(message.to_owned()).into());
    }
    let Some(Manifest { definition, .. }) = Manifest::read("sweep", path)? else {
        return Err(refuse("it has no sweep.json: expected the folder of a sweep".to_owned()).into());
    };
    if read_regular(&path.join(SWEEP)).is_ok_and(|text| text != sweep_file(&definition).as_bytes()) {
        let message = format!(
            "its {SWEEP} was modified: delete it to repeat the sweep, or fly another one: skysink sweep {} --out DIR",
            shell_path(&path.join(SWEEP))
        );
        return Err(refuse(message).into());
    }
    let settings = SweepSettings {
        base: SweepBase::read(scenario)?,
        axes: definition.axes(),
        strategies: definition.strategies.clone(),
        seeds: definition.seeds.clone(),
        external,
        models: definition.models.clone(),
    };
    Ok((settings, definition))
}

/// The strategies in Python of the sweep in the folder `path`, as they are saved there.
///
/// # Errors
/// If a file cannot be read.
pub(crate) fn external(path: &Path, definition: &Definition) -> Result<Vec<ExternalStrategy>, LabError> {
    let saved = |(name, version): (&String, &String)| {
        let folder = path.join(folder_of(definition, name));
        let entries = fs::read_dir(&folder).and_then(Iterator::collect::<Result<Vec<_>, _>>).at(&folder)?;
        let names = entries.iter().map(|entry| entry.file_name().to_string_lossy().into_owned());
        let source = |name: String| Ok(SourceFile { bytes: read_regular(&folder.join(&name)).at(&folder)?, name });
        let sources = names.filter(|name| is_source(name)).map(source).collect::<Result<_, LabError>>()?;
        Ok(ExternalStrategy { name: name.clone(), version: version.clone(), sources })
    };
    definition.sources.iter().map(saved).collect()
}

/// The folder, in that of a sweep, with the source of the strategy `name` in Python.
fn folder_of(definition: &Definition, name: &str) -> String {
    format!("strategy-{}", definition.strategies.iter().position(|strategy| strategy == name).unwrap_or_default())
}

/// The sweep as a file in its folder.
fn sweep_file(definition: &Definition) -> String {
    let strategy = |name: &String| {
        let class = name.rsplit(':').next().filter(|_| definition.sources.contains_key(name));
        class.map_or_else(
            || name.clone(),
            |class| format!("{PYTHON}{}/strategy.py:{class}", folder_of(definition, name)),
        )
    };
    let seeds = definition.seeds.clone();
    let count = seeds.len() as u64;
    let file = SweepFile {
        scenario: SCENARIO.into(),
        strategies: definition.strategies.iter().map(strategy).collect(),
        seeds: if (1..=count).eq(seeds.iter().copied()) { Seeds::Count(count) } else { Seeds::List(seeds) },
        axes: definition.axes(),
    };
    toml::to_string(&file).expect("values that were read can be written")
}

impl Sweep {
    /// The files of its folder from which it can be flown again.
    pub(crate) fn files(&self) -> Result<Vec<SavedFile>, LabError> {
        let mut files = Vec::new();
        let mut table = self.full_base()?;
        let lists = [("sensors.file", SENSORS), ("sensors.arrivals.file", TRACE)];
        let of_features = nodes::files().map(|file| (file.key, file.name));
        let others = [("link.file", CHANNEL), ("link.rates", RATES), ("uav.track", TRACK)];
        for (key, name) in lists.into_iter().chain(of_features).chain(others) {
            if let Some(file) = dotted::value_mut(&mut table, key).filter(|file| file.is_str()) {
                let path = self.base.path.parent().unwrap_or(Path::new("")).join(file.as_str().unwrap_or_default());
                let is_arrays = name == CHANNEL && path.extension() == Path::new(ARRAYS).extension();
                let name = if is_arrays { ARRAYS } else { name };
                let bytes = match self.held(name) {
                    Some(text) => text.into(),
                    None => read_regular(&path).at(&path)?,
                };
                files.push((name.into(), bytes));
                *file = name.into();
            }
        }
        files.push((SCENARIO.into(), toml::to_string(&table).expect("a table that was read can be written").into()));
        for ExternalStrategy { name, sources, .. } in &self.external {
            let folder = PathBuf::from(folder_of(&self.definition, name));
            files.extend(sources.iter().map(|source| (folder.join(&source.name), source.bytes.clone())));
        }
        files.push((SWEEP.into(), sweep_file(&self.definition).into()));
        Ok(files)
    }

    /// The text of the file `name` of the channel, if the base holds it.
    fn held(&self, name: &str) -> Option<String> {
        let Overrides { table, map, .. } = &self.base.held;
        match name {
            CHANNEL => table.as_deref().map(RateTable::to_csv).or_else(|| map.as_ref().map(|map| map.to_csv().0)),
            RATES => map.as_ref().and_then(|map| map.to_csv().1),
            _ => None,
        }
    }

    /// The base scenario with all keys. A default that depends on an axis, such as the start in the centre of the area,
    /// is left out, or all of them are.
    fn full_base(&self) -> Result<Table, LabError> {
        let given = &self.base.table;
        let text = toml::to_string(given).expect("a table that was read can be written");
        let scenario = Scenario::parse(&text, &self.base.path, self.base.held.clone()).and_then(settings::resolve)?;
        let full: Table = scenario.to_toml().parse().expect("it was just written");
        let mut without_start = full.clone();
        for key in ["uav.start_m", "base.position_m"].into_iter().filter(|key| dotted::value(given, key).is_none()) {
            dotted::remove(&mut without_start, key);
        }
        let points = self.points(given);
        Ok([full, without_start].into_iter().find(|base| self.points(base) == points).unwrap_or_else(|| given.clone()))
    }

    /// A hash of the scenario of each point over this base; `None` if one is refused.
    fn points(&self, base: &Table) -> Option<Vec<u64>> {
        let points = 0..self.definition.points.len();
        points.map(|point| Some(xxh3_64(self.scenario_of_grid(base, point).ok()?.to_toml().as_bytes()))).collect()
    }
}
