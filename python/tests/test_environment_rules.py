"""What an environment sees, does and earns by its arguments."""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from test_environment import ID, equal, free_altitude

import skysink
from skysink.environment import DataCollectionEnv, DataCollectionVectorEnv

NAMES = ("uav", "queues", "slot", "positions", "belief", "belief_spread", "rates", "ages", "gains", "nearest", "reach")
ACTIONS = ("displacement", "waypoint", "sensor")
REWARDS = ("lost", "weighted", "age", "loss_fraction")
UNEQUAL = {"sensors.sampling_bps": [20.3, 900.7], "sensors.capacity_bits": 12_000}
"""Fractions of bits per slot, and losses."""

LEARNT = {"planner.knowledge": "estimated", "planner.rates": "learnt"}


@pytest.mark.parametrize("observation", [*((name,) for name in NAMES), NAMES, ("nearest", "reach", "slot")])
@pytest.mark.filterwarnings("error")
def test_gymnasium_accepts_every_observation(smoke: skysink.Scenario, observation: tuple[str, ...]) -> None:
    for scenario in (smoke, smoke.replace(UNEQUAL | LEARNT)):
        env = gymnasium.make(ID, scenario=scenario, observation=observation, nearest=4)
        assert isinstance(env.observation_space, gymnasium.spaces.Dict)
        assert sorted(env.observation_space) == sorted(observation)
        check_env(env.unwrapped, skip_render_check=True)


@pytest.mark.parametrize("action", ACTIONS)
@pytest.mark.parametrize("reward", REWARDS)
@pytest.mark.filterwarnings("error")
def test_gymnasium_accepts_every_action_and_reward(smoke: skysink.Scenario, action: Any, reward: Any) -> None:
    for scenario in (smoke, free_altitude()):
        for nearest in (None, 3):
            env = gymnasium.make(ID, scenario=scenario, action=action, reward=reward, nearest=nearest)
            check_env(env.unwrapped, skip_render_check=True)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"observation": ["queue"]}, r'observation = \["queue"\]: expected one or more of uav, queues, slot'),
        ({"observation": []}, r"observation = \[\]: expected one or more of uav"),
        ({"observation": ["uav", "others"]}, r'observation = \["uav", "others"\]: expected one or more of uav.*, returnable$'),
        ({"observation": ["agent"]}, r'observation = \["agent"\]: expected one or more of uav.*, returnable$'),
        ({"observation": ["nearest"]}, r"nearest = None: expected the number"),
        ({"nearest": 0}, r"nearest = 0: expected 1 to 40"),
        ({"nearest": 41}, r"nearest = 41: expected 1 to 40"),
        ({"action": "jump"}, r'action = "jump": expected displacement, waypoint or sensor'),
        ({"reward": "loss"}, r'reward = "loss": expected lost, weighted, age or loss_fraction'),
    ],
)
def test_unknown_rules_are_refused(smoke: skysink.Scenario, arguments: dict[str, Any], message: str) -> None:
    for make in (DataCollectionEnv, lambda one, **others: DataCollectionVectorEnv(2, one, **others)):
        with pytest.raises(skysink.InputError, match=message):
            make(smoke, **arguments)


@pytest.mark.parametrize("knowledge", [{}, {"planner.knowledge": "estimated"}, LEARNT])
def test_observations_contain_only_the_belief_of_the_uav(smoke: skysink.Scenario, knowledge: dict[str, Any]) -> None:
    scenario = smoke.replace(UNEQUAL | knowledge | {"sensors.initial_queue_mean_bits": 5000.0})
    env = DataCollectionEnv(scenario, observation=NAMES, nearest=7)
    env.action_space.seed(5)
    seen, _ = env.reset(seed=3)
    field = env.field
    widest = 0.0
    for slot in range(61):
        belief = env.belief
        widest = max(widest, seen["belief_spread"].max())
        rates = np.minimum(belief.rate_bps / 900.7, 1.0)
        expected = {
            "queues": belief.queue_bits / 12_000,
            "belief": belief.queue_bits / 12_000,
            "belief_spread": belief.queue_sd_bits / 12_000,
            "rates": rates,
            "ages": belief.age_slots / 60,
            "gains": field.gains / field.gains.max(),
            "positions": field.positions_m / field.area_m,
        }
        for name, values in expected.items():
            assert np.allclose(seen[name], values, atol=1e-6), name
        offsets = field.positions_m - env.uav[:2]
        distances = np.hypot(*offsets.T)
        assert np.array_equal(seen["reach"], distances <= field.reach_m * (1 + 1e-9))
        order = np.lexsort((np.arange(len(field)), (offsets**2).sum(axis=1)))[:7]
        rows = [offsets / field.area_m, expected["belief"][:, None], rates[:, None], expected["ages"][:, None]]
        assert np.allclose(seen["nearest"], np.hstack(rows)[order], atol=1e-6)
        if slot < 60:
            seen, *_ = env.step(env.action_space.sample())
    assert seen["ages"].max() > 0.1 and (seen["ages"] == 0).any()
    assert (widest > 0) == bool(knowledge)


def test_waypoints_are_fractions_of_the_area_limited_by_reach(smoke: skysink.Scenario) -> None:
    env = DataCollectionEnv(smoke, action="waypoint")
    env.reset()
    (width, height), reach = env.field.area_m, env.field.reach_m
    random = np.random.default_rng(1)
    arrived = 0
    for _ in range(60):
        uav = np.array(env.uav[:2])
        action = np.clip(uav / (width, height) + random.normal(0.0, 0.35, 2), 0.0, 1.0).astype(np.float32)
        goal = action.astype(np.float64) * (width, height)
        env.step(action)
        way = goal - uav
        arrived += bool(np.hypot(*way) <= reach)
        assert np.allclose(env.uav[:2], uav + way * min(1.0, reach / max(np.hypot(*way), 1e-9)))
    assert 5 < arrived < 55
    assert env.run().summary["refused"] == 0
    climbing = DataCollectionEnv(free_altitude(), action="waypoint")
    climbing.reset()
    low, high = climbing.field.altitudes_m
    before = climbing.uav
    climbing.step(np.array([0.5, 0.5, 1.0], np.float32))
    assert climbing.uav[2] == min(high, before[2] + climbing.field.climb_m)
    for _ in range(39):
        climbing.step(np.array([0.5, 0.5, 0.0], np.float32))
    assert climbing.uav[2] == low and climbing.run().summary["refused"] == 0


@pytest.mark.parametrize("nearest", [None, 6])
def test_a_discrete_action_flies_to_its_sensor_node_and_serves_it(smoke: skysink.Scenario, nearest: int | None) -> None:
    scenario = smoke.replace(UNEQUAL | {"uav.max_speed_mps": 9.0})
    env = DataCollectionEnv(scenario, action="sensor", nearest=nearest)
    _, info = env.reset(seed=2)
    field = env.field
    random = np.random.default_rng(4)
    masks = []
    for _ in range(60):
        uav = np.array(env.uav[:2])
        distances = np.hypot(*(field.positions_m - uav).T)
        ids = np.arange(len(field)) if nearest is None else np.argsort(distances, kind="stable")[:nearest]
        mask = distances[ids] <= field.reach_m * (1 + 1e-9)
        assert np.array_equal(info["action_mask"], mask if mask.any() else np.ones_like(mask))
        assert np.array_equal(info["action_mask"], env.action_masks())
        masks.append(mask)
        choice = int(random.integers(len(ids)))
        goal = field.positions_m[ids[choice]]
        *_, info = env.step(np.int64(choice))
        assert np.allclose(env.uav[:2], uav + (goal - uav) * min(1.0, field.reach_m / max(distances[ids[choice]], 1e-9)))
        is_near = np.hypot(*(goal - env.uav[:2])) <= field.comm_radius_m
        assert (env.belief.age_slots[ids[choice]] == 0) == is_near
    assert np.any(masks) and not np.all(masks)
    assert env.run().summary["refused"] == 0
    with pytest.raises(skysink.InputError, match="reset"):
        env.step(0)
    env.reset()
    for wrong in (-1, len(ids), 1.5, "up"):
        with pytest.raises((skysink.InputError, TypeError)):
            env.step(wrong)


def test_all_sensor_nodes_are_allowed_if_none_is_in_reach(tmp_path: Path) -> None:
    (tmp_path / "list.csv").write_text("x_m,y_m\n5,5\n395,395\n")
    text = "name = 'far'\nslots = 40\narea.side_m = 400.0\n[sensors]\nfile = 'list.csv'\n[uav]\nmax_speed_mps = 20.0\n"
    env = DataCollectionEnv(skysink.Scenario.parse(text, tmp_path / "far.toml"), action="sensor")
    _, info = env.reset()
    assert info["action_mask"].tolist() == [True, True]
    for _ in range(39):
        *_, info = env.step(1)
    assert info["action_mask"].tolist() == [False, True]
    with pytest.raises(skysink.InputError, match="which alone has a mask"):
        DataCollectionEnv(action="waypoint").action_masks()


def flown(scenario: skysink.Scenario, reward: Any) -> tuple[list[float], DataCollectionEnv, list[float]]:
    """The rewards of an episode of fixed actions, its environment, and the mean ages after each slot."""
    env = DataCollectionEnv(scenario, reward=reward)
    env.action_space.seed(1)
    env.reset()
    rewards, ages = [], []
    for _ in range(scenario.slots):
        rewards.append(env.step(env.action_space.sample())[1])
        ages.append(float(env.belief.age_slots.mean()))
    return rewards, env, ages


def test_rewards_match_their_formulas(smoke: skysink.Scenario) -> None:
    scenario = smoke.replace(UNEQUAL)
    lost, env, ages = flown(scenario, "lost")
    slots = env.run().slots
    # Each SN has sampled floor(s tau t) bits by the end of slot t (decision D2).
    rates_bits = env.field.sampling_bps * env.field.slot_s
    sampled = np.array([np.floor(rates_bits * slot + 1e-9).sum() for slot in range(61)])
    assert np.array_equal(lost, -slots["lost_bits"] / np.diff(sampled))
    assert flown(scenario, "weighted")[0] == lost, "all weights are 1"
    assert flown(scenario, "age")[0] == [-age for age in ages]
    fraction, _, _ = flown(scenario, "loss_fraction")
    expected_bits = rates_bits.sum() * 60
    assert np.allclose(fraction[:-1], -60 * slots["lost_bits"][:-1] / expected_bits, rtol=1e-12)


@pytest.mark.parametrize("rates", [[20.3, 900.7], [0.3, 0.9], 300.0])
def test_the_mean_loss_fraction_reward_is_the_negative_loss_rate(
    smoke: skysink.Scenario, rates: Any
) -> None:
    scenario = smoke.replace({"sensors.sampling_bps": rates, "sensors.capacity_bits": 10})
    rewards, env, _ = flown(scenario, "loss_fraction")
    assert env.run().loss_rate > 0.01
    assert np.mean(rewards) == pytest.approx(-env.run().loss_rate, abs=1e-13)
    idle, env, _ = flown(scenario.replace({"sensors.sampling_bps": 0.0}), "loss_fraction")
    assert idle == [0.0] * 60


def test_decisions_in_an_environment_give_the_ledger_of_a_mission(smoke: skysink.Scenario) -> None:
    """With every reward and observation, by an environment's own actions, too."""
    scenario = smoke.replace(UNEQUAL | LEARNT)
    for reward in REWARDS:
        env = DataCollectionEnv(scenario, observation=NAMES, nearest=3, action="sensor", reward=reward)  # type: ignore[arg-type]
        env.reset()
        env.action_space.seed(6)
        for _ in range(60):
            env.step(env.action_space.sample())
        slots = env.run().slots

        class Repeating(skysink.Strategy):
            def plan(self, view: skysink.View) -> skysink.Decision:
                row = view.slot - 1
                return skysink.Decision([slots[axis][row] for axis in ("x_m", "y_m", "z_m")], serve=slots["scheduled"][row])  # noqa: B023

        again = skysink.simulate(scenario, Repeating())
        assert again.summary["trace_hash"] == env.run().summary["trace_hash"]


def test_reset_accepts_another_scenario_of_the_same_shape(smoke: skysink.Scenario) -> None:
    other = smoke.replace(UNEQUAL | {"seed": 50, "slots": 30})
    env = DataCollectionEnv(smoke, observation=NAMES, nearest=3)
    env.action_space.seed(1)
    env.reset()
    env.step(env.action_space.sample())
    observed, info = env.reset(options={"scenario": other})
    alone = DataCollectionEnv(other, observation=NAMES, nearest=3)
    assert info == {"seed": 50} and env.scenario == other
    assert equal(observed, alone.reset()[0])
    twin = pickle.loads(pickle.dumps(env))
    for slot in range(1, 31):
        action = env.action_space.sample()
        outcomes = [one.step(action) for one in (env, alone, twin)]
        for outcome in outcomes:
            assert equal(outcome[0], outcomes[0][0]) and outcome[1:4] == outcomes[0][1:4]
        assert outcomes[0][3] == (slot == 30)
    assert env.run().summary["trace_hash"] == alone.run().summary["trace_hash"]
    assert env.reset()[1]["seed"] == 51, "the scenario stays"
    for wrong, message in (
        (smoke.replace({"sensors.count": 41}), r"scenario smoke: 41 sensor nodes, .* expected 40 and a fixed altitude"),
        (free_altitude(), r"a free altitude: expected 40 and a fixed"),
        ([smoke, smoke], r"expected one; a vector"),
        (7, r"expected a skysink\.Scenario or the path of its file"),
    ):
        with pytest.raises(skysink.InputError, match=message):
            env.reset(options={"scenario": wrong})
    assert env.scenario == other


@pytest.mark.parametrize("action", ACTIONS)
def test_a_vector_of_scenarios_matches_single_environments_bit_for_bit(smoke: skysink.Scenario, action: Any) -> None:
    scenarios = [smoke, smoke.replace(UNEQUAL | {"seed": 30, "slots": 25})]
    rules: dict[str, Any] = {"observation": NAMES, "nearest": 5, "action": action, "reward": "loss_fraction"}
    envs = gymnasium.make_vec(ID, num_envs=5, scenario=scenarios, **rules)
    assert isinstance(envs, DataCollectionVectorEnv)
    singles = [DataCollectionEnv(scenarios[index % 2], **rules) for index in range(5)]
    observed, info = envs.reset()
    assert info["seed"].tolist() == [1, 31, 3, 33, 5]
    over = [False] * 5
    for index, single in enumerate(singles):
        seen, _ = single.reset(seed=int(info["seed"][index]))
        assert equal(seen, {name: values[index] for name, values in observed.items()})
    envs.action_space.seed(1)
    for _ in range(70):
        actions = envs.action_space.sample()
        observed, rewards, _, truncated, info = envs.step(actions)
        for index, single in enumerate(singles):
            if over[index]:
                seen, own = single.reset(seed=single._core.numbers[0] + 5)
                outcome: tuple[Any, ...] = (seen, 0.0, False, False, own)
            else:
                outcome = single.step(actions[index])
            assert equal(outcome[0], {name: values[index] for name, values in observed.items()})
            assert (outcome[1], outcome[3]) == (rewards[index], truncated[index])
            if action == "sensor":
                assert np.array_equal(outcome[4]["action_mask"], info["action_mask"][index])
            over[index] = outcome[3]
    assert any(over) or envs._core.numbers[1] > 31
    twin = pickle.loads(pickle.dumps(envs))
    actions = envs.action_space.sample()
    assert equal(twin.step(actions)[0], envs.step(actions)[0])


def test_a_vector_accepts_other_scenarios_in_reset(smoke: skysink.Scenario) -> None:
    other = smoke.replace({"seed": 70, "sensors.sampling_bps": 300.0})
    envs = DataCollectionVectorEnv(3, smoke)
    envs.reset()
    mask = np.array([False, True, True])
    observed, info = envs.reset(options={"scenario": other, "reset_mask": mask})
    assert info["seed"].tolist() == [1, 71, 72]
    assert envs.scenarios == (smoke, other, other)
    assert np.array_equal(observed["queues"][1], DataCollectionEnv(other).reset(seed=71)[0]["queues"])
    assert pickle.loads(pickle.dumps(envs))._core.seeds == [1, 71, 72]
    assert envs.reset()[1]["seed"].tolist() == [4, 74, 75]
    assert envs.reset(options={"scenario": [other, smoke]})[1]["seed"].tolist() == [70, 2, 72]
    with pytest.raises(skysink.InputError, match=r"4 scenarios: expected 1 to 3"):
        envs.reset(options={"scenario": [smoke] * 4})
    with pytest.raises(skysink.InputError, match=r"41 sensor nodes"):
        DataCollectionVectorEnv(2, [smoke, smoke.replace({"sensors.count": 41})])


def test_invalid_discrete_actions_of_a_vector_are_refused(smoke: skysink.Scenario) -> None:
    envs = DataCollectionVectorEnv(2, smoke, action="sensor")
    envs.reset()
    for wrong in ([0, 40], [-1, 0], [0], [0.5, 1.0], [[0, 1]]):
        with pytest.raises((skysink.InputError, TypeError)):
            envs.step(np.array(wrong))
    assert envs.step([0, 39])[0]["slot"].tolist() == [[np.float32(1 / 60)]] * 2
    assert envs.action_masks().shape == (2, 40)
