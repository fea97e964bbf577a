//! What a scenario holds in memory instead of the files of its channel.

use std::path::Path;

use pyo3::prelude::*;
use skysink_common::channel::{LinkMap, RateTable};
use skysink_common::scenario::{Overrides, Scenario};

use crate::errors::refused;

/// The column of a channel that is a map of links.
const MAP_COLUMN: &str = "sensor";

/// The content of the file of a channel in memory: a table of rates, or a map of links.
#[derive(Clone, Copy, Default)]
pub struct HeldChannel {
    pub table: Option<&'static RateTable>,
    pub map: Option<&'static LinkMap>,
}

impl HeldChannel {
    /// That of a scenario.
    pub fn of(scenario: &Scenario) -> Self {
        // The sensor nodes of a changed scenario may be at other places.
        let unplaced = |map: &LinkMap| map.clone().at_places(&[]).held();
        Self { table: scenario.link.table, map: scenario.link.map.map(unplaced) }
    }

    /// What stands for its files.
    pub fn overrides(self) -> Overrides {
        Overrides { table: self.table, map: self.map, ..Overrides::default() }
    }

    /// The texts of its files.
    pub fn texts(self) -> [Option<String>; 2] {
        let (levels, rates) = self.map.map(LinkMap::to_csv).unzip();
        [self.table.map(RateTable::to_csv).or(levels), rates.flatten()]
    }

    /// Parses the text of a channel, and of the rates of its SNRs.
    pub fn parse(text: &str, rates: Option<&str>) -> PyResult<Self> {
        let path = Path::new("channel");
        let header = text.lines().next().unwrap_or_default();
        if !header.split(',').any(|column| column.trim() == MAP_COLUMN) {
            return Ok(Self { table: Some(RateTable::parse(text, path).map_err(refused)?.held()), map: None });
        }
        let steps = rates.map(|rates| LinkMap::parse_steps(rates, Path::new("rates"))).transpose().map_err(refused)?;
        Ok(Self { table: None, map: Some(LinkMap::parse(text, path, steps).map_err(refused)?.held()) })
    }
}
