//! What a scenario holds in memory instead of files.

use std::path::Path;
use std::sync::Arc;

use pyo3::prelude::*;
use skysink_common::arrivals::ArrivalTrace;
use skysink_common::channel::{LinkMap, RateTable};
use skysink_common::scenario::{Overrides, Scenario};

use crate::errors::refused;

/// The column of a channel that is a map of links.
const MAP_COLUMN: &str = "sensor";

/// The contents of the files of the arrivals and of the channel, a table of rates or a map of links.
#[derive(Clone, Default)]
pub struct Held {
    pub arrivals: Option<ArrivalTrace>,
    pub table: Option<Arc<RateTable>>,
    pub map: Option<Arc<LinkMap>>,
}

impl Held {
    pub fn of(scenario: &Scenario) -> Self {
        // The sensor nodes of a changed scenario may be at other places.
        let unplaced = |map: &Arc<LinkMap>| LinkMap::clone(map).at_places(&[]).shared();
        let map = scenario.link.map.as_ref().map(unplaced);
        Self { arrivals: scenario.trace.clone(), table: scenario.link.table.clone(), map }
    }

    /// What stands for the files of the channel.
    pub fn overrides(&self) -> Overrides {
        Overrides { table: self.table.clone(), map: self.map.clone(), ..Overrides::default() }
    }

    /// The texts of the files: of the arrivals, of the channel and of its rates.
    pub fn texts(&self) -> [Option<String>; 3] {
        let (levels, rates) = self.map.as_deref().map(LinkMap::to_csv).unzip();
        let channel = self.table.as_deref().map(RateTable::to_csv).or(levels);
        [self.arrivals.as_ref().map(ArrivalTrace::to_csv), channel, rates.flatten()]
    }

    /// Parses the text of a channel, and of the rates of its SNRs.
    pub fn parse_channel(text: &str, rates: Option<&str>) -> PyResult<Self> {
        let path = Path::new("channel");
        let header = text.lines().next().unwrap_or_default();
        if !header.split(',').any(|column| column.trim() == MAP_COLUMN) {
            let table = RateTable::parse(text, path).map_err(refused)?;
            return Ok(Self { table: Some(table.shared()), ..Self::default() });
        }
        let steps = rates.map(|rates| LinkMap::parse_steps(rates, Path::new("rates"))).transpose().map_err(refused)?;
        let map = LinkMap::parse(text, path, steps).map_err(refused)?;
        Ok(Self { map: Some(map.shared()), ..Self::default() })
    }
}
