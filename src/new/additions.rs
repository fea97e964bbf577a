//! What a log or the terrain adds to a new scenario: files beside it, lines, and what stands for the files until they
//! are written.

#[cfg(feature = "lab")]
use skysink_common::channel::LinkMap;
#[cfg(feature = "lab")]
use skysink_common::geometry::Position;
use skysink_common::scenario::Overrides;
#[cfg(feature = "lab")]
use skysink_common::sensors::SensorList;

/// The file of a map of links.
#[cfg(feature = "lab")]
pub const LINKS: &str = "links.csv";

/// Most points of the maps that a new scenario has.
#[cfg(feature = "lab")]
pub const MOST_POINTS: usize = 1_000_000;

/// Most points of the map of one sensor node.
#[cfg(feature = "lab")]
pub const MOST_OF_NODE: usize = 10_000;

/// The additions.
#[derive(Default)]
pub struct Additions {
    /// Names and texts of the files.
    pub files: Vec<(&'static str, String)>,
    /// What replaces the files in the check before they are written.
    pub overrides: Overrides,
    /// The tables of zones.
    #[cfg(feature = "lab")]
    pub zones: String,
    pub notes: Vec<String>,
    /// What is probably unintended.
    pub warnings: Vec<String>,
}

#[cfg(feature = "lab")]
impl Additions {
    /// Adds a map of links of the sensor nodes in `list`.
    pub fn add_map(&mut self, map: LinkMap, list: &SensorList) -> Result<(), String> {
        let place = |id: usize| list.sensors()[id].position;
        let mut by_place: Vec<usize> = (0..list.sensors().len()).collect();
        by_place.sort_by(|a, b| place(*a).x.total_cmp(&place(*b).x).then(place(*a).y.total_cmp(&place(*b).y)));
        if let Some(pair) = by_place.windows(2).find(|pair| place(pair[0]) == place(pair[1])) {
            let [one, other] = [pair[0], pair[1]].map(|id| list.label(id));
            return Err(format!("{one} and {other} stand at one place: expected other places for links of their own"));
        }
        self.files.push((LINKS, map.to_csv().0));
        let (names, _) = map.names();
        let places: Vec<Position> = names
            .iter()
            .map(|name| place(LinkMap::id_of(name).expect("maps of arrays name sensor nodes by id")))
            .collect();
        self.overrides.map = Some(map.at_places(&places).held());
        Ok(())
    }
}
