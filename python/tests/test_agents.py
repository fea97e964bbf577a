"""Several UAVs as agents: the PettingZoo environment, and the batch that steps in place."""

from __future__ import annotations

import copy
import pickle
from typing import Any

import numpy as np
import pytest
from gymnasium import spaces

import skysink
from numpy.typing import NDArray
from skysink import FleetBatch
from skysink.environment import DataCollectionEnv

KEYS: dict[str, Any] = {"slots": 40, "area.side_m": 120.0, "sensors.count": 30, "sensors.sampling_bps": 400.0}
RULES: list[dict[str, Any]] = [
    {},
    {"action": "waypoint", "reward": "difference", "observation": ("uav", "queues", "positions", "ages", "others")},
    {"action": "sensor", "nearest": 6, "observation": ("uav", "nearest", "slot", "others"), "reward": "age"},
]


@pytest.fixture
def scenario() -> skysink.Scenario:
    return skysink.Scenario.letter().replace({**KEYS, "uav.count": 3})


def draw(batch: FleetBatch, actions: np.ndarray[Any, Any], random: np.random.Generator) -> None:
    """Fills in random actions, of SNs those that the masks allow."""
    if actions.dtype == np.int64:
        masks = batch.action_masks()
        for place in np.ndindex(actions.shape):
            actions[place] = random.choice(np.flatnonzero(masks[place]))
    else:
        actions[...] = random.uniform(-1.0, 1.0, actions.shape)


@pytest.mark.parametrize("rules", RULES)
def test_pettingzoo_accepts_the_environment(scenario: skysink.Scenario, rules: dict[str, Any]) -> None:
    test = pytest.importorskip("pettingzoo.test")
    test.parallel_api_test(skysink.parallel_env(scenario, **rules), num_cycles=200)
    test.parallel_seed_test(lambda: skysink.parallel_env(scenario, **rules))


@pytest.mark.parametrize("action", ["displacement", "waypoint", "sensor"])
def test_one_agent_matches_the_single_agent_environment(action: Any) -> None:
    scenario = skysink.Scenario.letter().replace({**KEYS, "sensors.sampling_bps": [100.0, 900.0]})
    env = DataCollectionEnv(scenario, action=action)
    batch = FleetBatch(1, scenario, observation=("uav", "queues", "slot"), action=action)
    actions, observations, rewards, terminated, truncated = batch.arrays()
    batch.reset_into(observations, seed=4)
    observed, _ = env.reset(seed=4)
    random = np.random.default_rng(1)
    for _ in range(40):
        for name, place in batch.slices.items():
            assert np.array_equal(observations[0, 0, place], observed[name].ravel())
        draw(batch, actions, random)
        batch.step_into(actions, observations, rewards, terminated, truncated)
        observed, reward, down, over, _ = env.step(actions[0, 0])
        assert rewards[0, 0] == np.float32(reward) and (terminated[0], truncated[0]) == (down, over)
    assert truncated[0]


@pytest.mark.parametrize("rules", RULES)
def test_a_batch_matches_its_environments(scenario: skysink.Scenario, rules: dict[str, Any]) -> None:
    batch = FleetBatch(5, scenario, **rules)
    singles = [FleetBatch(1, scenario, **rules) for _ in range(5)]
    all_of = batch.arrays()
    each = [single.arrays() for single in singles]
    batch.reset_into(all_of[1], seed=7)
    for index, single in enumerate(singles):
        single.reset_into(each[index][1], seed=7 + index)
    random = np.random.default_rng(2)
    for _ in range(40):
        draw(batch, all_of[0], random)
        batch.step_into(*all_of)
        for index, single in enumerate(singles):
            each[index][0][0] = all_of[0][index]
            single.step_into(*each[index])
            assert all(np.array_equal(own[0], whole[index]) for own, whole in zip(each[index], all_of, strict=True))
    assert all_of[4].all()
    lost_bits, delivered_bits = batch.totals
    batch.step_into(*all_of)
    assert batch.seeds == [12, 13, 14, 15, 16] and not all_of[2].any() and not all_of[4].any()
    assert (delivered_bits > 0).all() and (batch.totals[0] == 0).all() and (batch.totals[1] == 0).all()
    assert lost_bits.dtype == np.uint64


def test_observations_of_others_are_relative_to_each_agent(scenario: skysink.Scenario) -> None:
    starts = {"uav.starts_m": [[12.0, 60.0], [60.0, 60.0], [60.0, 108.0]]}
    batch = FleetBatch(1, scenario.replace(starts), observation=("uav", "others", "agent"))
    observations = batch.arrays()[1]
    batch.reset_into(observations)
    others = observations[0, :, batch.slices["others"]]
    expected = [[0.4, 0.0, 0.4, 0.4], [-0.4, 0.0, 0.0, 0.4], [-0.4, -0.4, 0.0, -0.4]]
    assert np.array_equal(observations[0, :, batch.slices["agent"]], np.eye(3))
    assert np.allclose(others, expected) and np.allclose(observations[0, :, :2].ravel(), [0.1, 0.5, 0.5, 0.5, 0.5, 0.9])


def test_the_difference_reward_is_an_agents_marginal_delivery() -> None:
    # Agents 0 and 1 are over the SNs on the left, agent 2 over those on the right.
    scenario = skysink.Scenario.letter().replace({
        **KEYS,
        "uav.count": 3,
        "uav.starts_m": [[30.0, 60.0], [31.0, 60.0], [90.0, 60.0]],
        "link.comm_radius_m": 29.0,
        "link.resource_blocks": 64,
    })
    rewards = {}
    for reward in ("difference", "lost"):
        batch = FleetBatch(1, scenario, observation=("uav",), reward=reward)
        arrays = batch.arrays()
        batch.reset_into(arrays[1], seed=3)
        batch.step_into(*arrays)
        rewards[reward] = arrays[2][0].tolist()
    sensors = scenario.replace({"seed": 3}).sensors()
    x_m, y_m = np.asarray(sensors["x_m"]), np.asarray(sensors["y_m"])
    in_range = [np.hypot(x_m - at, y_m - 60.0) <= 29.0 for at in (30.0, 31.0, 90.0)]
    queues = np.asarray(sensors["queue_bits"]) + 400.0
    alone = [
        queues[in_range[uav] & ~np.any([in_range[other] for other in range(3) if other != uav], axis=0)].sum() / (30 * 400.0)
        for uav in range(3)
    ]
    assert rewards["difference"] == pytest.approx(alone, rel=1e-6) and alone[2] > 1.0
    assert len(set(rewards["lost"])) == 1


def test_clones_copies_and_pickles_continue_identically(scenario: skysink.Scenario) -> None:
    batch = FleetBatch(2, scenario)
    arrays = batch.arrays()
    batch.reset_into(arrays[1])
    random = np.random.default_rng(3)
    for _ in range(5):
        draw(batch, arrays[0], random)
        batch.step_into(*arrays)
    for twin in (batch.clone(), pickle.loads(pickle.dumps(batch)), copy.deepcopy(batch)):
        one, other = batch.clone().arrays(), twin.arrays()
        one[0][...] = other[0][...] = arrays[0]
        batch.clone().step_into(*one)
        twin.step_into(*other)
        assert all(np.array_equal(mine, its) for mine, its in zip(one, other, strict=True))
    env = skysink.parallel_env(scenario)
    env.reset(seed=1)
    twin_env = pickle.loads(pickle.dumps(env))
    actions = {agent: env.action_space(agent).sample() for agent in env.agents}
    one_step, other_step = env.step(actions), twin_env.step(actions)
    assert one_step[1:4] == other_step[1:4]
    assert np.array_equal(env.state(), twin_env.state()) and isinstance(env.state_space, spaces.Box)
    assert env.state_space.contains(env.state())


def test_agents_keep_apart_by_the_rules_of_strategies() -> None:
    """Two agents that fly toward each other end their slots apart; without the rules the second is refused, and holds."""
    keys: dict[str, Any] = {"uav.count": 2, "uav.separation_m": 20.0, "uav.starts_m": [[20.0, 60.0], [100.0, 60.0]]}
    scenario = skysink.Scenario.letter().replace({**KEYS, **keys})
    toward = {"uav_0": np.array([1.0, 0.0], dtype=np.float32), "uav_1": np.array([-1.0, 0.0], dtype=np.float32)}

    def flown(return_rule: bool) -> NDArray[np.float32]:
        env = skysink.parallel_env(scenario, return_rule=return_rule, observation=("uav",))
        env.reset(seed=1)
        places = []
        for _ in range(6):
            observations = env.step(toward)[0]
            places.append([observations[agent]["uav"][:2] * 120.0 for agent in env.agents])
        return np.array(places)

    ruled, refused = flown(True), flown(False)
    for places in (ruled, refused):
        assert np.linalg.norm(places[:, 0] - places[:, 1], axis=1).min() >= 20.0 - 1e-3
    assert np.array_equal(ruled[0], refused[0])
    assert not np.array_equal(ruled, refused), "instead of being refused, one flies beside the other"


def test_actions_may_have_any_memory_layout(scenario: skysink.Scenario) -> None:
    batch = FleetBatch(2, scenario)
    arrays, others = batch.arrays(), batch.arrays()
    batch.reset_into(arrays[1])
    twin = batch.clone()
    turned = np.random.default_rng(4).uniform(-1.0, 1.0, arrays[0].shape).astype(np.float32)[:, ::-1, ::-1]
    batch.step_into(turned, *arrays[1:])
    twin.step_into(turned.copy(), *others[1:])
    assert all(np.array_equal(one, other) for one, other in zip(arrays, others, strict=True))


def test_impossible_arrays_and_actions_are_refused(scenario: skysink.Scenario) -> None:
    batch = FleetBatch(2, scenario)
    actions, observations, rewards, terminated, truncated = batch.arrays()
    batch.reset_into(observations)
    with pytest.raises(skysink.InputError, match="rewards of shape"):
        batch.step_into(actions, observations, rewards[:1], terminated, truncated)
    with pytest.raises(skysink.InputError, match="actions of shape"):
        batch.step_into(actions[:1], observations, rewards, terminated, truncated)
    scrambled = np.asfortranarray(observations)
    with pytest.raises(skysink.InputError, match="observations of shape .* C-contiguous"):
        batch.step_into(actions, scrambled, rewards, terminated, truncated)
    with pytest.raises(skysink.InputError, match="rewards of shape .* C-contiguous"):
        batch.step_into(actions, observations, np.asfortranarray(rewards), terminated, truncated)
    with pytest.raises(skysink.InputError, match="no episode has begun"):
        FleetBatch(2, scenario).step_into(actions, observations, rewards, terminated, truncated)
    with pytest.raises(skysink.InputError, match="num_envs = -1"):
        FleetBatch(-1, scenario)
    with pytest.raises(skysink.InputError, match="loss_fraction or difference"):
        FleetBatch(1, scenario, reward="most")  # type: ignore[arg-type]
    actions[1, 2, 0] = np.nan
    with pytest.raises(skysink.InputError, match="expected finite numbers, -1 to 1"):
        batch.step_into(actions, observations, rewards, terminated, truncated)
    chooser = FleetBatch(2, scenario, action="sensor")
    arrays = chooser.arrays()
    chooser.reset_into(arrays[1])
    arrays[0][0, 1] = 30
    with pytest.raises(skysink.InputError, match="action 30: expected 0 to 29"):
        chooser.step_into(*arrays)
    with pytest.raises(skysink.InputError, match="it alone|which alone has a mask"):
        batch.action_masks()
    own = {"uav.endurances_s": [20.0, 30.0, 40.0], "uav.must_land": True}
    with pytest.raises(skysink.InputError, match="endurances_s: expected none"):
        FleetBatch(1, scenario.replace(own))
    with pytest.raises(skysink.InputError, match="2 UAVs: expected 3"):
        skysink.parallel_env(scenario).reset(options={"scenario": scenario.replace({"uav.count": 2})})
    env = skysink.parallel_env(scenario)
    with pytest.raises(skysink.InputError, match="expected reset"):
        env.step({})
    env.reset()
    with pytest.raises(skysink.InputError, match="expected those of uav_1, uav_2, too"):
        env.step({"uav_0": np.zeros(2)})


def test_agents_exist_until_the_end(scenario: skysink.Scenario) -> None:
    env = skysink.parallel_env(scenario)
    observations, infos = env.reset(seed=9)
    assert env.agents == ["uav_0", "uav_1", "uav_2"] and infos["uav_1"] == {"seed": 9}
    for slot in range(1, 41):
        assert all(env.observation_space(agent).contains(seen) for agent, seen in observations.items())
        observations, rewards, terminated, truncated, infos = env.step({agent: np.zeros(2) for agent in env.agents})
        assert list(rewards) == ["uav_0", "uav_1", "uav_2"] and not any(terminated.values())
        assert all(truncated.values()) == (slot == 40)
    assert env.agents == [] and infos["uav_2"]["delivered_bits"] > 0


@pytest.mark.parametrize(
    ("action", "given", "message"),
    [
        ("displacement", 0.5, r"action of uav_1: 0\.5: expected one of Box\(-1\.0, 1\.0, \(2,\), float32\)"),
        ("waypoint", [0.1, 0.2, 0.3], r"action of uav_1: \[0\.1, 0\.2, 0\.3\]: expected one of Box\(0\.0"),
        ("sensor", 1.7, r"action of uav_1: 1\.7: expected one of Discrete\(30\)"),
        ("sensor", 30, r"action.* 30: expected"),
    ],
)
def test_actions_of_another_shape_are_refused(scenario: skysink.Scenario, action: Any, given: Any, message: str) -> None:
    env = skysink.parallel_env(scenario, action=action)
    env.reset(seed=1)
    actions = {agent: env.action_space(agent).sample() for agent in env.agents}
    with pytest.raises(skysink.InputError, match=message):
        env.step({**actions, "uav_1": given})


def test_infos_describe_the_slot(scenario: skysink.Scenario) -> None:
    env = skysink.parallel_env(scenario.replace({"sensors.sampling_bps": 9000.0}))
    env.reset(seed=1)
    lost = delivered = 0
    while env.agents:
        *_, infos = env.step({agent: env.action_space(agent).sample() for agent in env.agents})
        lost += infos["uav_0"]["lost_bits"]
        delivered += infos["uav_0"]["delivered_bits"]
        assert infos["uav_2"] == infos["uav_0"]
    assert (lost, delivered) == tuple(int(total[0]) for total in env.batch.totals) and lost > 0 < delivered


def test_a_single_agent_observes_no_others() -> None:
    alone = skysink.Scenario.letter().replace(KEYS)
    with pytest.raises(skysink.InputError, match=r'observation = \["others"\]: expected more, or several UAVs'):
        FleetBatch(2, alone, observation=("others",))
    assert FleetBatch(2, alone).slices["others"] == slice(34, 34)
