"""What the policies of rl_train.py are trained on: its tasks, and environments whose actions are sensor nodes."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import skysink
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray
from ppo_fly import scale_of

HERE = Path(__file__).parent
NAME = "skysink/DataCollection-v0"
KEYS = ("uav", "queues", "slot", "positions")
JUDGED_FROM = 1001  # seed of the first of the fields of the evaluation
JUDGED = 20
DISCOUNT = 0.99  # of a slot


class Agents(gymnasium.vector.VectorEnv):
    """The agents of a batch of fleets as the environments of a vector, fleet by fleet."""

    metadata: dict[str, Any] = {"autoreset_mode": AutoresetMode.NEXT_STEP}

    def __init__(self, fleets: int, scenario: skysink.Scenario, fields: int | None = None) -> None:
        self.batch = skysink.FleetBatch(fleets, scenario, fields, (*KEYS, "others", "agent"), reward="difference")
        self.actions, self.seen, self.rewards, self.down, self.over = self.batch.arrays()
        self.num_envs = fleets * self.batch.agents
        self.single_observation_space = self.batch.observation_space
        self.single_action_space = self.batch.action_space
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        slot_bits = scenario.to_dict()["slot_s"] * float(np.sum(scenario.sensors()["sampling_bps"]))
        self.sampled_bits = scenario.slots * slot_bits
        self.loss_rates: deque[float] = deque(maxlen=self.num_envs)  # of the last episodes

    def reset(self, *, seed: Any = None, options: Any = None) -> tuple[dict[str, NDArray[np.float32]], dict[str, Any]]:
        self.loss_rates.clear()
        self.batch.reset_into(self.seen, seed)
        return self.observed(), {}

    def step(self, actions: NDArray[np.float32]) -> tuple[Any, ...]:
        self.actions[...] = actions.reshape(self.actions.shape)
        self.batch.step_into(self.actions, self.seen, self.rewards, self.down, self.over)
        if self.over.any():
            self.loss_rates.extend(self.batch.totals[0][self.over] / self.sampled_bits)
        down, over = (np.repeat(ends, self.batch.agents) for ends in (self.down, self.over))
        return self.observed(), self.rewards.ravel().astype(float), down, over, {}

    def observed(self) -> dict[str, NDArray[np.float32]]:
        rows = self.seen.reshape(self.num_envs, -1).copy()
        spaces: Any = self.single_observation_space
        places = self.batch.slices.items()
        return {name: rows[:, place].reshape(-1, *spaces[name].shape) for name, place in places}


class Targets(gymnasium.vector.VectorWrapper):
    """Environments in which an action is the sensor node to fly towards, one slot at full speed or as far as there.

    They observe the `scale` of ppo_fly.py, too, and with `rates` also `fills`.
    """

    def __init__(self, envs: gymnasium.vector.VectorEnv, scenarios: list[skysink.Scenario]) -> None:
        super().__init__(envs)
        each = [scenarios[index % len(scenarios)] for index in range(self.num_envs)]
        self.scale = np.array([scale_of(scenario.field()) for scenario in each], np.float32)
        highest = [np.max(one["sensors.sampling_bps"]) * one["slot_s"] / one["sensors.capacity_bits"] for one in each]
        self.highest_fills = np.array(highest, np.float32)[:, None]
        spaces: Any = envs.single_observation_space
        nodes = spaces["queues"].shape
        seen = dict(spaces.spaces) | {"scale": gymnasium.spaces.Box(0.0, np.inf, (2,))}
        if seen.pop("rates", None):
            seen["fills"] = gymnasium.spaces.Box(0.0, np.inf, nodes)
        self.single_observation_space = gymnasium.spaces.Dict(seen)
        self.observation_space = batch_space(self.single_observation_space, envs.num_envs)
        self.single_action_space = gymnasium.spaces.Discrete(nodes[0])
        self.action_space = batch_space(self.single_action_space, envs.num_envs)

    def observed(self, seen: dict[str, NDArray[np.float32]]) -> dict[str, NDArray[np.float32]]:
        self.seen = dict(seen) | {"scale": self.scale}
        if "rates" in seen:
            self.seen["fills"] = self.seen.pop("rates") * self.highest_fills
        return self.seen

    def reset(self, **options: Any) -> tuple[dict[str, NDArray[np.float32]], dict[str, Any]]:
        seen, info = self.env.reset(**options)
        return self.observed(seen), info

    def step(self, targets: NDArray[np.integer[Any]]) -> tuple[Any, ...]:
        towards = self.seen["positions"][np.arange(self.num_envs), targets] - self.seen["uav"][:, :2]
        seen, *rest = self.env.step(towards / self.scale[:, :1])  # the environment shortens what is longer than a flight
        return self.observed(seen), *rest


class Shaped(gymnasium.vector.VectorWrapper):
    """Environments whose losses are announced: by the bits in all buffers, in those that a slot samples.

    The potential leaves every policy's discounted loss as it is, up to a constant (Ng, Harada and Russell, 1999), but a
    delivery is rewarded in its slot, and not when its buffer would have overflowed.
    """

    def __init__(self, envs: gymnasium.vector.VectorEnv) -> None:
        super().__init__(envs)
        self.over = np.ones(self.num_envs, np.bool_)

    def reset(self, **options: Any) -> tuple[dict[str, NDArray[np.float32]], dict[str, Any]]:
        seen, info = self.env.reset(**options)
        self.potential = self.potential_of(seen)
        self.over[:] = False
        return seen, info

    def step(self, actions: NDArray[np.integer[Any]]) -> tuple[Any, ...]:
        seen, rewards, down, over, info = self.env.step(actions)
        potential = self.potential_of(seen)
        shaped = rewards + np.where(self.over, 0.0, DISCOUNT * potential - self.potential)  # a new episode has no step yet
        self.potential, self.over = potential, down | over
        return seen, shaped, down, over, info

    @staticmethod
    def potential_of(seen: dict[str, NDArray[np.float32]]) -> NDArray[np.float64]:
        return np.asarray(-seen["queues"].sum(-1, dtype=float) / seen["fills"].sum(-1))


@dataclass(frozen=True)
class Task:
    """What a policy is trained for."""

    file: str
    envs: int
    """Environments, or agents, that are stepped at once."""

    changes: tuple[dict[str, Any], ...] = ({},)
    """Of the scenario, in turn."""

    is_fleet: bool = False
    is_shaped: bool = False
    """With rewards of `Shaped`, and rates observed."""

    def scenarios(self, seed: int | None = None) -> list[skysink.Scenario]:
        scenario = skysink.Scenario.load(HERE / self.file)
        return [scenario.replace(each if seed is None else each | {"seed": seed}) for each in self.changes]

    def make(self, count: int, seed: int | None = None, fields: int | None = None) -> Targets:
        """A vector of environments, from this seed or the scenario's on; with `fields`, `count` is that of fleets."""
        scenarios = self.scenarios(seed)
        made: gymnasium.vector.VectorEnv
        if self.is_fleet:
            made = Agents(count // (1 if fields else scenarios[0]["uav.count"]), scenarios[0], fields)
        else:
            keys = (*KEYS, "rates") if self.is_shaped else KEYS
            made = gymnasium.make_vec(NAME, num_envs=count, scenario=scenarios, fields=fields, observation=keys)
        return Targets(made, scenarios)


SIDES_AND_RATES = [(150.0, 900.0), (250.0, 550.0), (350.0, [40.0, 800.0]), (500.0, 300.0)]  # [m], [bit/s]
TASKS = {
    "small": Task("small.toml", 256),
    "fleet": Task("small_fleet.toml", 256, is_fleet=True),
    "library": Task(
        "typical.toml",
        64,
        tuple({"area.side_m": side_m, "sensors.sampling_bps": rate_bps} for side_m, rate_bps in SIDES_AND_RATES),
        is_shaped=True,
    ),
}
