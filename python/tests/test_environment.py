"""The Gymnasium environments."""

from __future__ import annotations

import copy
import pickle
import subprocess
import sys
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from conftest import ROOT, same_files
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode

import skysink
from skysink.environment import DataCollectionEnv, DataCollectionVectorEnv

ID = "skysink/DataCollection-v0"
POSITIONS = ("uav", "queues", "slot", "positions")


def free_altitude() -> skysink.Scenario:
    """A mission in which the UAV climbs."""
    scenario = skysink.Scenario.load(ROOT / "scenarios" / "plos-suburban.toml")
    return scenario.replace({"uav.altitude": "free", "slots": 40})


def equal(one: dict[str, Any], other: dict[str, Any]) -> bool:
    """Whether two observations are the same."""
    return one.keys() == other.keys() and all(np.array_equal(one[name], other[name]) for name in one)


@pytest.mark.parametrize("observation", [("uav", "queues", "slot"), POSITIONS])
@pytest.mark.parametrize("fields", [None, 3])
@pytest.mark.filterwarnings("error")
def test_gymnasium_accepts_the_environment(
    smoke: skysink.Scenario, observation: tuple[str, ...], fields: int | None
) -> None:
    for scenario in (smoke, free_altitude(), smoke.replace({"planner.knowledge": "estimated"})):
        env = gymnasium.make(ID, scenario=scenario, fields=fields, observation=observation)
        check_env(env.unwrapped, skip_render_check=True)


def test_stable_baselines_accepts_the_environment(smoke: skysink.Scenario) -> None:
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    checker.check_env(DataCollectionEnv(smoke))


def test_an_episode_is_a_mission_of_the_same_seed(smoke: skysink.Scenario) -> None:
    env = DataCollectionEnv(smoke)
    spaces: dict[str, gymnasium.Space[Any]] = dict(env.observation_space.items())  # type: ignore[attr-defined]
    observation, info = env.reset(seed=5)
    assert info == {"seed": 5}
    sensors = smoke.replace({"seed": 5}).sensors()
    assert np.array_equal(env.queues_bits, sensors["queue_bits"])
    assert np.array_equal(observation["queues"], (env.queues_bits / np.float32(30_000)).astype(np.float32))
    assert observation["uav"].tolist() == [0.5, 0.5, 0.0] and observation["slot"] == [0.0]
    lost = sampled = 0.0
    for slot in range(1, 61):
        observation, reward, terminated, truncated, info = env.step(env.action_space.sample())
        assert (terminated, truncated) == (False, slot == 60)
        assert reward == -(info["lost_bits"] / (40 * 100))
        assert all(space.contains(observation[name]) for name, space in spaces.items())
        lost, sampled = lost + info["lost_bits"], sampled + 4000
    assert env.run().loss_rate == lost / sampled
    with pytest.raises(skysink.InputError, match="reset"):
        env.step(env.action_space.sample())


@pytest.mark.parametrize("strategy", ["gfs", "uts", "horizon"])
def test_an_episode_that_repeats_a_run_has_identical_bytes(tmp_path: Path, strategy: str) -> None:
    for scenario in (skysink.Scenario.load(ROOT / "scenarios" / "sparse.toml").replace({"slots": 80}), free_altitude()):
        flown = skysink.simulate(scenario, strategy)
        slots = flown.slots
        env = DataCollectionEnv(scenario)
        env.reset()
        for index in range(len(flown)):
            waypoint = (slots["x_m"][index], slots["y_m"][index], slots["z_m"][index])
            decision = skysink.Decision(waypoint, serve=slots["scheduled"][index])
            env.fly(decision, transit=slots["mode"][index] == "transit")
        repeated = env.run()
        assert repeated.summary["trace_hash"] == flown.summary["trace_hash"]
        folder = tmp_path / scenario.name
        flown.save(folder / "flown")
        repeated.save(folder / "repeated")
        same_files(folder / "flown", folder / "repeated", ["slots.csv", "sensors.csv"])


def test_actions_are_displacements_within_reach(smoke: skysink.Scenario) -> None:
    env = DataCollectionEnv(smoke)
    env.reset()
    x, y, _ = env.uav
    env.step(np.array([0.5, 0.0], np.float32))
    assert env.uav[:2] == (x + 10.0, y)  # V_max tau is 20 m
    env.step(np.array([-1.0, -1.0], np.float32))
    assert np.allclose(env.uav[:2], [x + 10.0 - 20.0 / 2**0.5, y - 20.0 / 2**0.5])
    for _ in range(5):
        env.step(np.array([1.0, 0.0], np.float32))
    assert env.uav[0] == 60.0, "the border of the area"
    assert env.run().summary["refused"] == 0


@pytest.mark.parametrize("action", [[np.nan, 0.0], [0.0], [0.0, 0.0, 0.0], "up"])
def test_an_invalid_action_is_refused(smoke: skysink.Scenario, action: Any) -> None:
    env = DataCollectionEnv(smoke)
    env.reset()
    with pytest.raises((skysink.InputError, TypeError, ValueError)):
        env.step(action)
    assert env.step(np.zeros(2, np.float32))[0]["slot"] > 0, "nothing was flown"


def test_seeds_increase_and_fields_are_reproducible(smoke: skysink.Scenario) -> None:
    def seeds(env: DataCollectionEnv, first: int | None) -> list[int]:
        return [env.reset(seed=first)[1]["seed"], *(env.reset()[1]["seed"] for _ in range(3))]

    assert seeds(DataCollectionEnv(smoke), None) == [1, 2, 3, 4]
    assert seeds(DataCollectionEnv(smoke), 8) == [8, 9, 10, 11]
    assert seeds(DataCollectionEnv(smoke, fields=2), None) == [1, 2, 1, 2]
    assert seeds(DataCollectionEnv(smoke, fields=2), 7) == [2, 1, 2, 1]
    vector = DataCollectionVectorEnv(3, smoke)
    assert vector.reset()[1]["seed"].tolist() == [1, 2, 3]
    assert vector.reset()[1]["seed"].tolist() == [4, 5, 6]
    assert vector.reset(seed=[9, None, 2])[1]["seed"].tolist() == [9, 8, 2]
    vector.reset(seed=np.int64(3))  # type: ignore[arg-type]
    assert vector.reset(seed=3)[1]["seed"].tolist() == [3, 4, 5]
    vector.reset(options={"reset_mask": np.array([True, False, False])})
    assert vector._core.numbers == [6, 4, 5]
    with pytest.raises(skysink.InputError):
        DataCollectionEnv(smoke, fields=0)
    with pytest.raises(skysink.InputError, match="reset_mask of 2"):
        vector.reset(options={"reset_mask": [True, False]})


@pytest.mark.parametrize("knowledge", ["oracle", "estimated"])
def test_vector_and_single_environments_agree_step_by_step(smoke: skysink.Scenario, knowledge: str) -> None:
    scenario = smoke.replace({"planner.knowledge": knowledge, "sensors.sampling_bps": [50.0, 300.0]})
    envs = gymnasium.make_vec(ID, num_envs=3, scenario=scenario, observation=POSITIONS)
    assert isinstance(envs, DataCollectionVectorEnv)
    assert envs.metadata["autoreset_mode"] == AutoresetMode.NEXT_STEP
    singles = [DataCollectionEnv(scenario, observation=POSITIONS) for _ in range(3)]
    observed, _ = envs.reset(seed=4)
    for index, single in enumerate(singles):
        assert equal(single.reset(seed=4 + index)[0], {name: value[index] for name, value in observed.items()})
    envs.action_space.seed(1)
    over = [False] * 3
    for _ in range(150):  # two episodes and a half
        actions = envs.action_space.sample()
        observed, rewards, terminated, truncated, info = envs.step(actions)
        assert observed["queues"].shape == (3, 40) and not terminated.any()
        for index, single in enumerate(singles):
            if over[index]:
                following, _ = single.reset(seed=single._core.numbers[0] + 3)
                outcome: tuple[Any, ...] = (following, 0.0, False, False, {"lost_bits": 0, "delivered_bits": 0})
            else:
                outcome = single.step(actions[index])
            assert equal(outcome[0], {name: value[index] for name, value in observed.items()})
            assert (outcome[1], outcome[3]) == (rewards[index], truncated[index])
            assert outcome[4]["lost_bits"] == info["lost_bits"][index]
            over[index] = outcome[3]
    assert envs._core.numbers == [10, 11, 12]


@pytest.mark.parametrize(
    "twin_of", [lambda env: env.clone(), copy.copy, copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))]
)
@pytest.mark.parametrize("knowledge", ["oracle", "estimated"])
def test_a_clone_continues_independently_from_the_same_state(smoke: skysink.Scenario, twin_of: Any, knowledge: str) -> None:
    scenario = smoke.replace({"planner.knowledge": knowledge})
    for env in (DataCollectionEnv(scenario), DataCollectionVectorEnv(2, scenario)):
        env.action_space.seed(3)
        env.reset(seed=2)
        for _ in range(25):
            env.step(env.action_space.sample())
        twin = twin_of(env)
        actions = [env.action_space.sample() for _ in range(20)]
        flown = [env.step(action) for action in actions]
        again = [twin.step(action) for action in actions]
        for (one, reward, *_), (other, same, *_) in zip(flown, again, strict=True):
            assert equal(one, other) and np.array_equal(reward, same)
        if isinstance(env, DataCollectionEnv):
            assert env.run().summary["trace_hash"] == twin.run().summary["trace_hash"]
        env.step(env.action_space.sample())
        assert np.array_equal(twin.step(actions[0])[0]["slot"] * 60, np.full_like(again[0][0]["slot"], 46.0))


def test_wrappers_of_gymnasium_work(smoke: skysink.Scenario) -> None:
    env = gymnasium.wrappers.FlattenObservation(gymnasium.make(ID, scenario=smoke))
    assert env.reset()[0].shape == (40 + 3 + 1,)
    envs = gymnasium.wrappers.vector.RecordEpisodeStatistics(gymnasium.make_vec(ID, num_envs=2, scenario=smoke))
    envs.reset()
    returns = []
    for _ in range(61):
        *_, info = envs.step(envs.action_space.sample())
        returns += [info["episode"]["r"]] if "episode" in info else []
    assert len(returns) == 1 and (returns[0] <= 0).all()


def test_a_vector_tells_what_each_of_its_environments_has(smoke: skysink.Scenario) -> None:
    two = [smoke, smoke.replace({"sensors.sampling_bps": 300.0})]
    envs = gymnasium.make_vec("skysink:skysink/DataCollection-v0", num_envs=3, scenario=two, action="sensor")
    assert isinstance(envs, DataCollectionVectorEnv)
    singles = [DataCollectionEnv(two[index % 2], action="sensor") for index in range(3)]
    envs.reset(seed=4)
    for index, single in enumerate(singles):
        single.reset(seed=4 + index)
    for _ in range(20):
        actions = envs.call("expert", "gfs")
        assert list(actions) == [single.expert("gfs") for single in singles]
        envs.step(np.array(actions))
        for single, action in zip(singles, actions, strict=True):
            single.step(action)
    assert envs.get_attr("uav") == tuple(single.uav for single in singles)
    for name in ("queues_bits", "sampling_bps"):
        told = envs.get_attr(name)
        assert len(told) == 3 and all(np.array_equal(one, getattr(single, name)) for one, single in zip(told, singles, strict=True))
    masks = envs.call("action_masks")
    assert len(masks) == 3 and all(np.array_equal(mask, single.action_masks()) for mask, single in zip(masks, singles, strict=True))
    assert [scenario["sensors.sampling_bps"] for scenario in envs.get_attr("scenario")] == [100.0, 300.0, 100.0]
    assert envs.get_attr("action_space") == (singles[0].action_space,) * 3
    assert envs.get_attr("observation_space") == (singles[0].observation_space,) * 3
    assert envs.get_attr("fields") == envs.get_attr("render_mode") == (None,) * 3
    for name in ("step", "run", "follow", "clone"):
        with pytest.raises(skysink.InputError, match=f"call\\('{name}'\\): a vector is flown as a whole"):
            envs.call(name)
    with pytest.raises(AttributeError, match="weather"):
        envs.get_attr("weather")


def test_a_spawned_worker_finds_the_environment_by_the_module_in_its_id() -> None:
    code = """if True:
        import gymnasium
        for make in (gymnasium.make, gymnasium.make_vec):
            print(make("skysink:skysink/DataCollection-v0").reset(seed=3)[1])
    """
    made = subprocess.run([sys.executable, "-P", "-c", code], capture_output=True, text=True, check=True)
    assert made.stdout.count("seed") >= 2, made


def test_unknown_options_of_reset_are_refused(smoke: skysink.Scenario) -> None:
    with pytest.raises(skysink.InputError, match=r"options = \['map'\]: expected scenario"):
        DataCollectionEnv(smoke).reset(options={"map": 1})
    with pytest.raises(skysink.InputError, match=r"options = \['map'\]: expected reset_mask or scenario"):
        DataCollectionVectorEnv(2, smoke).reset(options={"map": 1})


@pytest.mark.parametrize(("bps", "is_equal"), [(100.0, True), ([50.0, 300.0], False)])
def test_the_mean_reward_is_the_negative_loss_rate_only_for_equal_samples(
    smoke: skysink.Scenario, bps: Any, is_equal: bool
) -> None:
    env = DataCollectionEnv(smoke.replace({"sensors.sampling_bps": bps}))
    env.action_space.seed(1)
    env.reset()
    rewards = [env.step(env.action_space.sample())[1] for _ in range(60)]
    flown = env.run()
    assert flown.loss_rate > 0.01
    assert (abs(flown.loss_rate + np.mean(rewards)) < 1e-12) == is_equal
