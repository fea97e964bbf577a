"""Strategies as experts in environments: actions for imitation, rollouts, and data sets of Minari."""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from conftest import ROOT

import skysink
from skysink import FleetBatch
from skysink.environment import DataCollectionEnv, DataCollectionVectorEnv
from skysink.transitions import to_minari

ID = "skysink/DataCollection-v0"
SMALL = ROOT / "python" / "examples" / "small.toml"


def loss(env: Any, strategy: str) -> float:
    """The loss rate of the rest of an episode in which a learner acts as the expert does."""
    ended = False
    while not ended:
        *_, terminated, truncated, _ = env.step(env.expert(strategy))
        ended = terminated or truncated
    return float(env.run().loss_rate)


@pytest.mark.parametrize("knowledge", ["oracle", "estimated"])
@pytest.mark.parametrize("strategy", ["gfs", "tour", "horizon"])
def test_an_episode_that_follows_a_strategy_is_its_mission(smoke: skysink.Scenario, strategy: str, knowledge: str) -> None:
    scenario = smoke.replace({"planner.knowledge": knowledge})
    env = DataCollectionEnv(scenario)
    env.reset(seed=3)
    flown = skysink.simulate(scenario, strategy, seed=3)
    for _ in range(len(flown.slots["slot"])):
        env.follow(strategy)
    assert np.array_equal(env.run().queues, flown.queues)
    assert env.run().summary["trace_hash"] == flown.summary["trace_hash"]


@pytest.mark.parametrize("action", ["displacement", "waypoint"])
@pytest.mark.parametrize("altitude", ["fixed", "free"])
def test_the_action_of_an_expert_ends_where_its_plan_does(smoke: skysink.Scenario, action: Any, altitude: str) -> None:
    if altitude == "free":
        smoke = skysink.Scenario.load(ROOT / "scenarios" / "plos-suburban.toml").replace({"uav.altitude": "free", "slots": 40})
    env = DataCollectionEnv(smoke, action=action)
    env.reset(seed=1)
    for _ in range(20):
        twin = env.clone()
        asked = env.expert("horizon")
        assert asked in env.action_space and np.array_equal(asked, env.expert("horizon"))
        twin.follow("horizon")
        env.step(asked)
        assert np.allclose(env.uav, twin.uav, atol=0.01)


def test_learners_that_copy_an_expert_come_close_to_it() -> None:
    scenario = skysink.Scenario.load(SMALL)
    flown = skysink.simulate(scenario, "tour").loss_rate
    # Whoever flies toward SNs alone cannot stop where its range begins.
    for rules, worst in (({}, flown + 0.001), ({"action": "sensor"}, 0.2), ({"action": "sensor", "nearest": 8}, 0.2)):
        env = DataCollectionEnv(scenario, **rules)
        env.reset()
        copied = loss(env, "tour")
        assert copied <= worst < skysink.simulate(scenario, "exact").loss_rate, (rules, copied, flown)


def test_rollouts_from_a_clone_leave_the_episode_as_it_is() -> None:
    env = DataCollectionEnv(skysink.Scenario.load(SMALL))
    env.reset(seed=1)
    env.action_space.seed(1)
    for _ in range(50):
        env.step(env.action_space.sample())
    before = env.queues_bits
    losses = {}
    for strategy in ("gfs", "tour"):
        twin = pickle.loads(pickle.dumps(env)) if strategy == "gfs" else env.clone()
        lost = 0
        for _ in range(100):
            lost += twin.follow(strategy)[4]["lost_bits"]
        losses[strategy] = lost
    assert losses["tour"] < losses["gfs"]
    assert np.array_equal(env.queues_bits, before)
    with pytest.raises(skysink.InputError, match="strategy \"horizom\": expected one of .*did you mean `horizon`"):
        env.expert("horizom")


def test_vectors_and_fleets_have_experts(smoke: skysink.Scenario) -> None:
    for action in ("displacement", "sensor"):
        envs = DataCollectionVectorEnv(3, smoke, action=action)
        envs.reset(seed=4)
        singles = [DataCollectionEnv(smoke, action=action) for _ in range(3)]
        for index, single in enumerate(singles):
            single.reset(seed=4 + index)
        over = [False]
        while not all(over):
            actions = envs.expert("tour")
            expected = [single.expert("tour") for single in singles]
            assert np.array_equal(actions, expected)
            envs.step(actions)
            over = [single.step(one)[3] for single, one in zip(singles, expected, strict=True)]
        assert not envs.expert("tour").any()


def test_a_fleet_that_acts_as_the_expert_plans_rounds_together() -> None:
    scenario = skysink.Scenario.load(ROOT / "python" / "examples" / "small_fleet.toml").replace({"uav.coordination": "sequential"})
    lost = {}
    for strategy in ("gfs", "tour"):
        env = skysink.parallel_env(scenario)
        env.reset(seed=1001)
        while env.agents:
            env.step(env.expert(strategy))
        lost[strategy] = int(env.batch.totals[0][0])
    sampled = int(skysink.simulate(scenario, "tour", seed=1001).summary["sampled_bits"])
    assert lost["tour"] < 0.2 * sampled < lost["gfs"]
    assert FleetBatch(2, scenario, action="sensor").expert("tour").shape == (2, scenario["uav.count"])


def test_a_policy_without_the_number_of_sensor_nodes_flies_any(smoke: skysink.Scenario) -> None:
    rules: dict[str, Any] = {"action": "sensor", "nearest": 5, "observation": ("uav", "nearest", "slot")}
    env = DataCollectionEnv(smoke, **rules)
    envs = DataCollectionVectorEnv(2, [smoke, smoke.replace({"sensors.count": 17})], **rules)
    for count in (40, 9, 200):
        other = smoke.replace({"sensors.count": count})
        seen, _ = env.reset(options={"scenario": other})
        assert seen in env.observation_space and len(env.field) == count
        loss(env, "uts")
        envs.reset(options={"scenario": [smoke, other]})
        envs.step(envs.expert("uts"))
    with pytest.raises(skysink.InputError, match="nearest = 5: expected 1 to 3"):
        env.reset(options={"scenario": smoke.replace({"sensors.count": 3})})
    with pytest.raises(skysink.InputError, match="9 sensor nodes, .*because spaces stay the same"):
        DataCollectionEnv(smoke).reset(options={"scenario": smoke.replace({"sensors.count": 9})})


def test_minari_reads_the_transitions(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    minari = pytest.importorskip("minari")
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    env = gymnasium.make(ID, scenario=str(SMALL), action="sensor", nearest=8, observation=["uav", "nearest", "slot"])
    to_minari("skysink/small-tour-v0", env, "tour", 3, seed=1001, author="Me")
    data = minari.load_dataset("skysink/small-tour-v0")
    assert (data.total_episodes, data.total_steps) == (3, 600)
    env.reset(seed=1002)
    second = data[1]
    assert second.id == 1
    for slot, action in enumerate(second.actions):
        seen, reward, _, truncated, info = env.step(action)
        assert np.array_equal(second.observations["nearest"][slot + 1], seen["nearest"])
        assert np.isclose(second.rewards[slot], float(reward)) and second.truncations[slot] == truncated
        assert second.infos["lost_bits"][slot + 1] == info["lost_bits"]
    again = data.recover_environment()
    assert again.observation_space == env.observation_space
    flat = gymnasium.wrappers.FlattenObservation(gymnasium.make(ID, scenario=skysink.Scenario.load(SMALL)))
    flat.action_space.seed(1)
    plain = gymnasium.make(ID, scenario=skysink.Scenario.load(SMALL))
    scaled = gymnasium.wrappers.RescaleAction(plain, np.float32(0.0), np.float32(1.0))
    with pytest.raises(skysink.InputError, match="expected no wrapper of actions"):
        to_minari("scaled-v0", scaled, "tour", 1)
    written = to_minari("flat-v0", flat, lambda _seen, _info: flat.action_space.sample(), 1)
    assert written[0].observations.shape == (201, 24) and written.spec.env_spec is None
