"""What an environment knows of base, battery and zones (decisions D9 to D15)."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from test_environment import ID

import skysink
from skysink.environment import DataCollectionEnv, DataCollectionVectorEnv

HOVERING_W = 79.86 + 88.63
"""Power of the default propulsion in hovering, P_0 + P_i."""

OBSERVED = ("uav", "energy", "home", "zones", "returnable")

HOVER = np.zeros(2, np.float32)


def scenario(text: str = "", uav: str = "") -> skysink.Scenario:
    """An area of 400 m × 200 m with the UAV at (100, 100), its base there, and a wall 20 m to its east."""
    return skysink.Scenario.parse(
        "name = 'walled'\nslots = 60\n[area]\nwidth_m = 400.0\nheight_m = 200.0\n"
        "no_fly = [{ polygon_m = [[120, 50], [130, 50], [130, 150], [120, 150]] }]\n[sensors]\ncount = 60\n"
        f"[base]\nradius_m = 2.0\n{text}[uav]\nstart_m = [100.0, 100.0]\n{uav}"
        "[uav.battery]\ncapacity_j = 10000.0\nreserve = 0.1\n"
    )


def observed(env: DataCollectionEnv, name: str, observation: Any) -> list[float]:
    """The numbers of this name, which lie in their space."""
    assert isinstance(env.observation_space, gymnasium.spaces.Dict)
    assert env.observation_space.contains(observation)
    numbers: list[float] = observation[name].astype(float).tolist()
    return numbers


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("action", ["displacement", "waypoint", "sensor"])
@pytest.mark.parametrize("return_rule", [False, True])
def test_gymnasium_accepts_base_battery_and_zones(action: Any, return_rule: bool) -> None:
    for mission in (scenario(), skysink.Scenario.letter()):
        env = gymnasium.make(ID, scenario=mission, observation=OBSERVED, action=action, return_rule=return_rule)
        check_env(env.unwrapped, skip_render_check=True)


def test_hovering_consumes_its_power() -> None:
    env = DataCollectionEnv(scenario(), observation=OBSERVED)
    observation, _ = env.reset()
    assert observed(env, "energy", observation) == [1.0]
    for slot in range(1, 11):
        observation, *_ = env.step(HOVER)
        assert observed(env, "energy", observation)[0] == pytest.approx(1.0 - slot * HOVERING_W / 10_000.0)


def test_home_is_the_distance_to_the_rim_of_the_base() -> None:
    env = DataCollectionEnv(scenario(), observation=OBSERVED)
    observation, _ = env.reset()
    assert observed(env, "home", observation) == pytest.approx([0.0, 0.0, 0.0, 0.9])
    observation, *_ = env.step(np.array([-1.0, 0.0], np.float32))
    # 30 m to the west, 28 m from the rim: a slot of 28 m home, of the energy of the trace.
    home = observed(env, "home", observation)
    assert home[:3] == pytest.approx([28 / 400, 0.0, 28 / 400])
    energy = observed(env, "energy", observation)[0]
    assert home[3] == pytest.approx(energy - 0.1 - 28 * 9.1 / 10_000.0, abs=2e-2)
    assert home[3] < energy - 0.1 - HOVERING_W * 0.5 / 10_000.0


def test_zones_are_free_distances() -> None:
    env = DataCollectionEnv(scenario(), observation=OBSERVED)
    zones = observed(env, "zones", env.reset()[0])
    # East 20 m to the wall, north 100 m to the border, west 100 m, south 100 m; of 400 m.
    assert [zones[direction] for direction in (0, 4, 8, 12)] == pytest.approx([0.05, 0.25, 0.25, 0.25])
    assert zones[2] == pytest.approx(20 * 2**0.5 / 400)
    assert zones[6] == pytest.approx(100 * 2**0.5 / 400)


def test_an_empty_battery_terminates_the_episode() -> None:
    slots = int(10_000.0 / HOVERING_W) + 1
    env = DataCollectionEnv(scenario(), observation=OBSERVED)
    env.reset()
    for _ in range(1, slots):
        assert env.step(HOVER)[2:4] == (False, False)
    observation, _, terminated, truncated, _ = env.step(HOVER)
    assert (terminated, truncated) == (True, False)
    assert observed(env, "energy", observation)[0] < 0.0
    with pytest.raises(skysink.InputError, match=r"expected reset"):
        env.step(HOVER)
    vector = DataCollectionVectorEnv(2, scenario(), observation=OBSERVED)
    vector.reset()
    for _ in range(1, slots):
        vector.step(np.zeros((2, 2), np.float32))
    _, _, ended, cut, _ = vector.step(np.zeros((2, 2), np.float32))
    assert ended.tolist() == [True, True]
    assert cut.tolist() == [False, False]
    begun, rewards, ended, cut, _ = vector.step(np.zeros((2, 2), np.float32))
    assert (rewards.tolist(), ended.tolist(), cut.tolist()) == ([0.0, 0.0], [False, False], [False, False])
    assert begun["energy"].tolist() == [[1.0], [1.0]]


def test_the_return_rule_returns_home_under_any_action() -> None:
    mission = scenario("charge_w = 0.0\n", "must_land = true\n").replace({"uav.battery.capacity_j": 5_000.0})
    random = np.random.default_rng(1)
    for return_rule in (False, True):
        env = DataCollectionEnv(mission, observation=OBSERVED, return_rule=return_rule)
        env.reset()
        is_over = is_down = False
        while not is_over and not is_down:
            # To the west, on and on.
            action = np.array([-1.0, random.uniform(-0.2, 0.2)], np.float32)
            _, _, is_down, is_over, _ = env.step(action)
        summary = env.run().summary
        assert is_down is not return_rule
        assert summary["landed"] is return_rule


def test_returnable_sensors_are_those_the_battery_allows() -> None:
    near = scenario()
    env = DataCollectionEnv(near, observation=OBSERVED, action="sensor")
    observation, info = env.reset()
    returnable = np.array(observed(env, "returnable", observation)) > 0.5
    positions = env.field.positions_m
    away_m = np.hypot(*(positions - np.array([100.0, 100.0])).T)
    # Out at 30 m/s (356 J a slot), back at the least energy per metre (9.1 J/m): 9 kJ last for 428 m.
    assert returnable.all()
    weak = near.replace({"uav.battery.capacity_j": 2_000.0})
    env = DataCollectionEnv(weak, observation=OBSERVED, action="sensor")
    observation, info = env.reset()
    returnable = np.array(observed(env, "returnable", observation)) > 0.5
    # 1.8 kJ last for about 86 m there and back, straight or around the wall; the range is 10 m.
    assert returnable[away_m < 30.0].all() or (away_m < 30.0).sum() == 0
    assert not returnable[away_m > 120.0].any()
    assert 0 < returnable.sum() < len(returnable)
    mask = info["action_mask"]
    assert not (mask & ~returnable).any()
    assert mask.any()
    # Behind the wall it is farther than straight.
    behind = (positions[:, 0] > 135.0) & (np.abs(positions[:, 1] - 100.0) < 20.0) & (away_m > 60.0)
    assert not returnable[behind].any()
