//! What strategies do not plan for, of the models of a scenario: they fly under all of them.

use skysink_common::scenario::Scenario;
use skysink_common::sensors::SensorList;

/// How the models of this scenario with the SNs `list` are planned for where strategies ignore a part, a line each.
#[must_use]
pub fn of(scenario: &Scenario, list: &SensorList) -> Vec<&'static str> {
    let weights = list.weights(&list.sampling(scenario));
    let rules = [
        (scenario.arrival_law().is_random(), "arrivals: by their means; horizon and offline also imagine draws"),
        (scenario.link.stays_in_sight(), "line of sight: by its probability, whatever a link had before"),
        (
            scenario.uav.position_error_m.is_some_and(|error_m| error_m > 0.0),
            "position errors: up to d_c; horizon and offline stay 1.5 σ inside",
        ),
        (!weights.are_equal(), "weights: tour, round-robin, max-age-first, edf, mes fly without them"),
    ];
    rules.into_iter().filter_map(|(applies, sentence)| applies.then_some(sentence)).collect()
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use skysink_common::scenario::Overrides;

    #[test]
    fn each_model_has_its_sentence_and_the_papers_none() {
        let of = |keys: &str, list: &str| {
            let scenario =
                Scenario::parse(&format!("name = 'a'\n{keys}"), Path::new("a.toml"), Overrides::default()).unwrap();
            super::of(&scenario, &SensorList::parse(list, Path::new("list.csv"), &scenario).unwrap())
        };
        let plain = "x_m,y_m\n1,1\n2,2\n";
        assert!(of("", plain).is_empty());
        assert!(of("[uav]\nposition_error_m = 0.0\n", plain).is_empty());
        for (keys, list, begin) in [
            ("[sensors.arrivals]\nmodel = 'poisson'\n", plain, "arrivals"),
            ("[link]\nmodel = 'probabilistic-los'\nlos_correlation_m = 9.0\n", plain, "line of sight"),
            ("[uav]\nposition_error_m = 1.0\n", plain, "position errors"),
            ("", "x_m,y_m,weight\n1,1,1\n2,2,3\n", "weights"),
        ] {
            let sentences = of(keys, list);
            assert!(sentences.len() == 1 && sentences[0].starts_with(begin), "{sentences:?}");
        }
    }
}
