//! `[planner.link]`: the link that plans reckon with, where it is not the true one.

use serde::{Deserialize, Serialize};
use skysink_common::channel::{Environment, K_DB, LinkBudget, LinkModel};
use skysink_common::error::InputError;
use skysink_common::keys::Accepts;
use skysink_common::scenario::Scenario;
use skysink_common::units::ratio_of_db;
use strum::VariantNames;

/// Errors of SNRs.
const OFFSET_DB: Accepts = Accepts::Number("-60 to 60 dB", |offset_db| (-60.0..=60.0).contains(&offset_db));

skysink_common::keys! {
    /// `[planner.link]`: what plans take the link for, to see what wrong knowledge costs. What is flown has the rates
    /// of `[link]`, and strategies that compare no rates fly as before. Those in Python see the true gains.
    #[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
    #[serde(deny_unknown_fields, expecting = "a table")]
    pub struct AssumedLink {
        /// By how much plans take SNRs for higher than they are [dB]; 0 if absent. With `link.model = "free-space"`,
        /// `"probabilistic-los"` or `"buildings"`.
        snr_offset_db: Option<f64>, OFFSET_DB;
        /// Rician K-factor that plans reckon with, instead of `link.k_db` [dB]; with `link.fading`.
        k_db: Option<f64>, K_DB;
        /// Surroundings by whose probability of line of sight plans are made, instead of `link.environment` or
        /// `link.los`; with `link.model = "probabilistic-los"`.
        environment: Option<Environment>, Accepts::OneOf(Environment::VARIANTS);
    }
}

impl AssumedLink {
    /// Refuses keys that say nothing of the link of `scenario`.
    pub(crate) fn check(&self, scenario: &Scenario) -> Result<(), InputError> {
        let link = &scenario.link;
        let is_measured = matches!(link.model, LinkModel::Table | LinkModel::Map);
        let refuse = |key: &str, value: toml::Value, expected| {
            Err(scenario.refusal(&format!("planner.link.{key}"), &value, expected))
        };
        match *self {
            Self { snr_offset_db: Some(offset_db), .. } if is_measured => refuse(
                "snr_offset_db",
                offset_db.into(),
                "it only with a law of the link, not with the rates or SNRs of a file or a preset",
            ),
            Self { k_db: Some(k_db), .. } if link.fading.is_none() => {
                refuse("k_db", k_db.into(), "it only with link.fading")
            }
            Self { environment: Some(environment), .. } if link.model != LinkModel::ProbabilisticLos => {
                let name = Environment::VARIANTS[environment as usize];
                refuse("environment", name.into(), "it only with link.model = \"probabilistic-los\"")
            }
            Self { snr_offset_db: None, k_db: None, environment: None } => {
                Err(scenario.refusal("planner.link", &toml::Table::new().into(), "one of its keys, or no such table"))
            }
            _ => Ok(()),
        }
    }

    /// The link `planned` as plans take it.
    pub(crate) fn of(&self, planned: LinkBudget) -> LinkBudget {
        let tx_power_w = planned.tx_power_w * ratio_of_db(self.snr_offset_db.unwrap_or(0.0));
        LinkBudget {
            tx_power_w,
            k_db: self.k_db.or(planned.k_db),
            environment: self.environment.or(planned.environment),
            los: planned.los.filter(|_| self.environment.is_none()),
            ..planned
        }
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use skysink_common::channel::{ChannelModel as _, Uplink};
    use skysink_common::scenario::Overrides;

    use super::*;
    use crate::settings::{Settings, check};

    fn parse(link: &str, assumed: &str) -> Scenario {
        let text = format!("name = 'a'\n[link]\n{link}\n[planner.link]\n{assumed}\n");
        Scenario::parse(&text, Path::new("a.toml"), Overrides::default()).unwrap()
    }

    /// Expected rates that plans reckon with.
    fn rates_bps(link: &str, assumed: &str) -> Vec<f64> {
        let mut scenario = parse(link, assumed);
        if assumed.is_empty() {
            scenario.planner.others.clear();
        }
        let channel = Settings::channel(&scenario);
        let away = (0..30).map(|step| f64::from(step * step));
        away.map(|d2_m2| channel.expected_rate_bps(&Uplink::at(1e-6, d2_m2, 20.0))).collect()
    }

    #[test]
    fn plans_reckon_with_the_assumed_link_as_if_it_was_the_true_one() {
        const SIGHT: &str = "model = 'probabilistic-los'\ncomm_radius_m = 60.0\n";
        let cases = [
            (SIGHT, "environment = 'suburban'", "environment = 'suburban'\n"),
            ("", "snr_offset_db = 10.0", "tx_power_w = 0.5\n"),
            ("fading = 'rician'\nbandwidth_hz = 5e3\n", "k_db = -inf", "k_db = -inf\n"),
        ];
        for (link, assumed, true_keys) in cases {
            let [known, wrong, other] = [(link, ""), (link, assumed), (&format!("{link}{true_keys}"), "")]
                .map(|(link, assumed)| rates_bps(link, assumed));
            assert_eq!(wrong, other, "{assumed}");
            assert_ne!(wrong, known, "{assumed}");
        }
        let curve = format!("{SIGHT}los = {{ a = 1.0, b = 0.1 }}\n");
        let urban = format!("{SIGHT}environment = 'urban'\n");
        assert_eq!(rates_bps(&curve, "environment = 'urban'"), rates_bps(&urban, ""));
    }

    #[test]
    fn keys_that_say_nothing_of_the_link_are_refused() {
        let cases = [
            ("", "environment = 'urban'", "planner.link.environment = \"urban\": expected it only with link.model"),
            ("", "k_db = 3.0", "planner.link.k_db = 3.0: expected it only with link.fading"),
            ("", "snr_offset_db = 61.0", "planner.link.snr_offset_db = 61.0: expected -60 to 60 dB"),
            ("", "gain = 1", "planner.link.gain"),
            ("", "", "planner.link = {}: expected one of its keys"),
        ];
        for (link, assumed, expected) in cases {
            let message = check(&parse(link, assumed)).unwrap_err().to_string();
            assert!(message.contains(expected), "{message}");
        }
    }
}
