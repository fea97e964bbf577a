//! What strategies do not plan for, of the models of a scenario: they fly under all of them.

use skysink_common::channel::LinkService;
use skysink_common::scenario::Scenario;
use skysink_common::sensors::SensorList;
use skysink_planner::settings::Settings;
use skysink_planner::strategies::STRATEGIES;

/// How the models of this scenario with the SNs `list` are planned for where the strategies `flown` ignore a part, a
/// line each.
pub fn of(scenario: &Scenario, list: &SensorList, flown: &[&str]) -> Vec<String> {
    let weights = list.weights(&list.sampling(scenario));
    let unweighted = STRATEGIES.iter().filter(|strategy| strategy.ignores_weights).map(|strategy| strategy.name);
    let unweighted: Vec<&str> = unweighted.filter(|name| flown.contains(name)).collect();
    let without_weights = format!("weights: {} fly without them", unweighted.join(", "));
    let is_windy = scenario.uav.wind_mps.is_some_and(|wind_mps| wind_mps != [0.0; 2]);
    let is_wrong = Settings::of(scenario).is_ok_and(|settings| settings.link.is_some());
    let rules = [
        (scenario.arrival_law().is_random(), "arrivals: by their means; horizon and offline also by their spread"),
        (scenario.link.stays_in_sight(), "line of sight: by its probability, whatever a link had before"),
        (
            scenario.link.residual_m.is_some_and(|residual_m| residual_m > 0.0),
            "links by place: by the law of the residual, whatever a link had before",
        ),
        (
            scenario.link.service == Some(LinkService::Observed),
            "links by place: from the waypoint, though those from where the slot began count",
        ),
        (
            scenario.uav.position_error_m.is_some_and(|error_m| error_m > 0.0),
            "position errors: up to d_c; horizon and offline stay 1.5 σ inside",
        ),
        (is_wrong, "the link: by the law of [planner.link], where strategies compare rates"),
        (is_windy, "wind: by the reach that is left against it, in every direction"),
        (!weights.are_equal() && !unweighted.is_empty(), &*without_weights),
    ];
    let node_keys = scenario.node_keys();
    let of_features = node_keys.rows().filter_map(|row| row.unplanned);
    let of_models = rules.into_iter().filter(|(applies, _)| *applies).map(|(_, sentence)| sentence);
    of_features.chain(of_models).map(str::to_owned).collect()
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use skysink_common::scenario::Overrides;

    #[test]
    fn each_optional_model_adds_its_sentence() {
        let of = |keys: &str, list: &str, flown: &[&str]| {
            let scenario =
                Scenario::parse(&format!("name = 'a'\n{keys}"), Path::new("a.toml"), Overrides::default()).unwrap();
            super::of(&scenario, &SensorList::parse(list, Path::new("list.csv"), &scenario).unwrap(), flown)
        };
        let plain = "x_m,y_m\n1,1\n2,2\n";
        assert!(of("", plain, &["edf"]).is_empty());
        assert!(of("[uav]\nposition_error_m = 0.0\nwind_mps = [0.0, 0.0]\n", plain, &["edf"]).is_empty());
        let weighted = "x_m,y_m,weight\n1,1,1\n2,2,3\n";
        assert!(of("", weighted, &["hover", "horizon"]).is_empty());
        assert_eq!(of("", weighted, &["mes", "tour", "uts"]), ["weights: tour, mes fly without them"]);
        for (keys, list, begin) in [
            ("[sensors.arrivals]\nmodel = 'poisson'\n", plain, "arrivals"),
            ("[link]\nmodel = 'probabilistic-los'\nlos_correlation_m = 9.0\n", plain, "line of sight"),
            ("[uav]\nposition_error_m = 1.0\n", plain, "position errors"),
            ("[uav]\nwind_mps = [1.0, 0.0]\n", plain, "wind"),
            ("[planner]\nlink.snr_offset_db = 3.0\n", plain, "the link"),
            ("", weighted, "weights"),
        ] {
            let sentences = of(keys, list, &["edf"]);
            assert!(sentences.len() == 1 && sentences[0].starts_with(begin), "{sentences:?}");
        }
    }
}
