//! A map of links as the text of its files.

use super::{LevelGrid, LinkMap};

impl LinkMap {
    /// The map as a CSV file, and its steps as another; floats round-trip exactly.
    pub fn to_csv(&self) -> (String, Option<String>) {
        let mut text = format!("sensor,x_m,y_m,z_m,{}\n", if self.has_rates() { "rate_bps" } else { "snr_db" });
        for (name, LevelGrid { axes_m: [east_m, north_m, up_m], levels, .. }) in self.names.iter().zip(&*self.grids) {
            let by_id = if self.are_ids && !name.is_empty() { "#" } else { "" };
            let quoted = name.contains([',', '"']).then(|| format!("\"{}\"", name.replace('"', "\"\"")));
            let name = quoted.unwrap_or_else(|| format!("{by_id}{name}"));
            let mut levels = levels.iter();
            for x_m in east_m {
                for y_m in north_m {
                    for (z_m, level) in up_m.iter().zip(&mut levels) {
                        let level = if level.is_finite() { level.to_string() } else { String::new() };
                        text.push_str(&format!("{name},{x_m},{y_m},{z_m},{level}\n"));
                    }
                }
            }
        }
        let line = |[snr_db, rate_bps]: &[f64; 2]| format!("{snr_db},{rate_bps}\n");
        let steps = self.steps.as_ref().map(|steps| steps.iter().map(line).collect::<String>());
        (text, steps.map(|steps| format!("snr_db,rate_bps\n{steps}")))
    }
}
