"""Flies small.toml over twenty fields with Gymnasium's interface only, and prints the loss rates: in random directions,
and straight to the fullest sensor node.

    python python/examples/simple_policies.py
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import skysink

FIELDS = 20
SIDE_PER_REACH = 100.0 / 20.0  # area.side_m / (uav.max_speed_mps * slot_s)

Policy = Callable[[gymnasium.Env[Any, Any], dict[str, Any]], Any]


def random(env: gymnasium.Env[Any, Any], _seen: dict[str, Any]) -> Any:
    return env.action_space.sample()


def greedy(_env: gymnasium.Env[Any, Any], seen: dict[str, Any]) -> Any:
    towards = (seen["positions"][np.argmax(seen["queues"])] - seen["uav"][:2]) * SIDE_PER_REACH
    action = towards / max(1.0, np.linalg.norm(towards))
    return action.astype(np.float32)


def loss_rates(policy: Policy) -> list[float]:
    """The loss rate in each field."""
    scenario = skysink.Scenario.load(Path(__file__).with_name("small.toml"))
    keys = ("uav", "queues", "slot", "positions")
    env = gymnasium.make("skysink/DataCollection-v0", scenario=scenario, observation=keys)
    env.action_space.seed(1)
    rates = []
    for _ in range(FIELDS):
        seen, _ = env.reset()  # the field of the scenario's seed first, then of the next one
        lost = []
        truncated = False
        while not truncated:
            seen, reward, _, truncated, _ = env.step(policy(env, seen))
            lost.append(-float(reward))
        rates.append(float(np.mean(lost)))  # every slot samples the same number of bits
    return rates


if __name__ == "__main__":
    for policy in (random, greedy):
        rates = loss_rates(policy)
        print(f"{policy.__name__}: loss rate {np.mean(rates):.4f}, from {min(rates):.4f} to {max(rates):.4f}")
