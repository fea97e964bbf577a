//! The lines of one vehicle for people: what it says itself is limited, however much that is, and what does not change
//! is said less and less often.

/// Texts that are passed on at once at most, and further ones [1/s].
const MOST_TEXTS: f64 = 8.0;
const TEXTS_PER_S: f64 = 0.2;

/// Time between two lines on the same matter [s], and the factor by which it grows while the line does not change.
const AGAIN_S: f64 = 10.0;
const GROWS: f64 = 2.0;

/// Length of a text that has further parts [byte].
const WHOLE_PART: usize = 50;

/// Length from which a text is not waited for any longer [byte].
const MOST_BYTES: usize = 500;

/// A matter that lasts.
#[derive(Debug, Clone)]
struct Lasting {
    what: &'static str,
    line: String,
    due_s: f64,
    every_s: f64,
}

/// The lines that have come up.
#[derive(Debug, Clone)]
pub struct Said {
    /// The matters that last.
    lasting: Vec<Lasting>,
    /// A line of the vehicle of which further parts may come, with its number.
    part: (u16, String),
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
        Self {
            lasting: Vec::new(),
            part: (0, String::new()),
            lines: Vec::new(),
            text: String::new(),
            budget: MOST_TEXTS,
            renewed_s: 0.0,
            left_out: 0,
        }
    }
}

impl Said {
    /// Adds a line of the bridge.
    pub fn say(&mut self, line: String) {
        self.lines.push(line);
    }

    /// Says `line` of the matter `what` once that lasts for `after_s` [s], and from time to time while it does; `None`
    /// ends it. Returns whether it was ended after it was said.
    pub fn say_while(&mut self, what: &'static str, line: Option<String>, after_s: f64, now_s: f64) -> bool {
        let known = self.lasting.iter().position(|lasting| lasting.what == what);
        let Some(line) = line else {
            return known.is_some_and(|index| !self.lasting.swap_remove(index).line.is_empty());
        };
        let index = known.unwrap_or_else(|| {
            let due_s = now_s + after_s;
            self.lasting.push(Lasting { what, line: String::new(), due_s, every_s: AGAIN_S });
            self.lasting.len() - 1
        });
        let lasting = &mut self.lasting[index];
        // Another line on what is missing is news.
        if after_s > 0.0 && after_s < AGAIN_S && lasting.line != line {
            lasting.due_s = lasting.due_s.min(now_s + after_s);
        }
        if now_s >= lasting.due_s {
            lasting.every_s = if lasting.line == line { lasting.every_s * GROWS } else { AGAIN_S };
            lasting.due_s = now_s + lasting.every_s;
            lasting.line.clone_from(&line);
            self.lines.push(line);
        }
        false
    }

    /// Adds a text of the vehicle, or a part of the line with this number, as soon as it is whole.
    pub fn quote_part(&mut self, text: &str, line: u16, now_s: f64) {
        if self.part.0 != line || line == 0 {
            let (_, begun) = std::mem::take(&mut self.part);
            self.quote(&begun, now_s);
            self.part.0 = line;
        }
        self.part.1.push_str(text);
        if line == 0 || text.len() < WHOLE_PART || self.part.1.len() >= MOST_BYTES {
            let (_, whole) = std::mem::take(&mut self.part);
            self.quote(&whole, now_s);
        }
    }

    /// Adds a text of the vehicle, unless it repeats the one before, or there are too many.
    fn quote(&mut self, text: &str, now_s: f64) {
        let text = text.trim(); // PX4 ends them with a tab
        if text.is_empty() || text == self.text {
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
    fn a_text_in_parts_is_one_line() {
        let mut said = Said::default();
        let part = "a".repeat(WHOLE_PART);
        let parts = [(&*part, 7), ("b\t", 7), ("whole", 0), (&*part, 8), ("next", 9)];
        parts.iter().for_each(|(text, line)| said.quote_part(text, *line, 0.0));
        assert_eq!(
            said.take(),
            [format!("says: {part}b"), "says: whole".into(), format!("says: {part}"), "says: next".into()]
        );
    }

    #[test]
    fn a_text_without_an_end_is_not_kept_for_ever() {
        let mut said = Said::default();
        (0..1000).for_each(|_| said.quote_part(&"a".repeat(WHOLE_PART), 7, 0.0));
        assert!(said.part.1.len() <= MOST_BYTES);
        assert_eq!(said.take(), [format!("says: {}", "a".repeat(MOST_BYTES))], "it repeats itself");
    }

    #[test]
    fn what_does_not_change_is_said_less_and_less_often() {
        let mut said = Said::default();
        let lines: Vec<u32> = (0..200)
            .filter(|second| {
                said.say_while("x", Some("waits".to_owned()), 2.0, f64::from(*second));
                !said.take().is_empty()
            })
            .collect();
        assert_eq!(lines, [2, 12, 32, 72, 152]);
        said.say_while("x", Some("changes".to_owned()), 2.0, 312.0);
        assert_eq!(said.take(), ["changes"]);
        assert!(said.say_while("x", None, 2.0, 313.0) && !said.say_while("x", None, 2.0, 313.0));
        said.say_while("x", Some("again".to_owned()), 2.0, 314.0);
        assert!(said.take().is_empty() && !said.say_while("x", None, 2.0, 315.0), "never said");
    }

    #[test]
    fn a_repeated_text_is_passed_on_once() {
        let mut said = Said::default();
        ["ready", "ready", "EKF variance", "ready"].iter().for_each(|text| said.quote(text, 0.0));
        assert_eq!(said.take(), ["says: ready", "says: EKF variance", "says: ready"]);
    }
}
