//! The lines of one vehicle for people: what it says itself is limited, however much that is.

/// Texts that are passed on at once at most, and further ones [1/s].
const MOST_TEXTS: f64 = 8.0;
const TEXTS_PER_S: f64 = 0.2;

/// The lines that have come up.
#[derive(Debug, Clone)]
pub struct Said {
    lines: Vec<String>,
    /// The last text of the vehicle.
    text: String,
    /// Texts that may be passed on.
    budget: f64,
    /// When it was renewed [s].
    renewed_s: f64,
    /// Texts that were left out since.
    left_out: u64,
}

impl Default for Said {
    fn default() -> Self {
        Self { lines: Vec::new(), text: String::new(), budget: MOST_TEXTS, renewed_s: 0.0, left_out: 0 }
    }
}

impl Said {
    /// Adds a line of the bridge.
    pub fn say(&mut self, line: String) {
        self.lines.push(line);
    }

    /// Adds a text of the vehicle, unless it repeats the one before, or there are too many.
    pub fn quote(&mut self, text: &str, now_s: f64) {
        if text == self.text {
            return; // ArduPilot repeats them
        }
        text.clone_into(&mut self.text);
        self.budget = (self.budget + (now_s - self.renewed_s) * TEXTS_PER_S).min(MOST_TEXTS);
        self.renewed_s = now_s;
        if self.budget < 1.0 {
            self.left_out += 1;
            return;
        }
        self.budget -= 1.0;
        let left_out = std::mem::take(&mut self.left_out);
        if left_out > 0 {
            self.lines.push(format!("has said {left_out} more texts, left out here"));
        }
        self.lines.push(format!("says: {text}"));
    }

    /// Takes the lines that have come up.
    pub fn take(&mut self) -> Vec<String> {
        std::mem::take(&mut self.lines)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flood_of_texts_is_a_few_lines_and_a_count() {
        let mut said = Said::default();
        (0..100_000).for_each(|number| said.quote(&format!("text {number}"), f64::from(number) / 10_000.0));
        let lines = said.take();
        assert_eq!(lines.len(), 8 + 2, "8 at once, and within 10 s another one, with a count: {lines:?}");
        assert_eq!(lines[..2], ["says: text 0", "says: text 1"]);
        assert!(lines[8].starts_with("has said ") && lines[8].ends_with(" more texts, left out here"), "{lines:?}");
    }

    #[test]
    fn a_repeated_text_is_passed_on_once() {
        let mut said = Said::default();
        ["ready", "ready", "EKF variance", "ready"].iter().for_each(|text| said.quote(text, 0.0));
        assert_eq!(said.take(), ["says: ready", "says: EKF variance", "says: ready"]);
    }
}
