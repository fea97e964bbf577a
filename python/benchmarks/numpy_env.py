"""`skysink/DataCollection-v0` in plain NumPy, single and vectorised.

Free space, fixed altitude, static gains. Same spaces, rewards and order of events as the native environment (decisions
D1, D2 and D5 of docs/src/model.md), in whole bits, so that both lose the same number of bits over the same field. The
random numbers of a new field are those of NumPy.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Dict
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

Reals = NDArray[np.float64]
Bits = NDArray[np.int64]
Observation = dict[str, NDArray[np.float32]]

SLACK = 1e-9  # of "within range" relative to the radius (D5), and of whole bits sampled [bit] (D2)


@dataclass(frozen=True)
class Mission:
    """The keys of a scenario that the environment needs, in SI units."""

    slots: int
    slot_s: float
    area_m: tuple[float, float]
    start_m: tuple[float, float]
    count: int
    capacity_bits: int
    sampling_bps: float
    initial_queue_mean_bits: float
    altitude_m: float
    reach_m: float
    bandwidth_hz: float
    snr_per_gain: float
    gain_db: tuple[float, float]
    comm_radius_m: float
    comm_s: float
    resource_blocks: int

    @classmethod
    def of(cls, scenario: dict[str, Any]) -> Mission:
        """The mission of a scenario with every key: drawn sensor nodes of equal rates, static links in free space.

        Raises ValueError for other scenarios.
        """
        area, sensors, uav, link = (scenario[table] for table in ("area", "sensors", "uav", "link"))
        modes = (link["model"], uav["altitude"], link.get("gain"))
        if modes != ("free-space", "fixed", "static") or "file" in sensors or isinstance(sensors["sampling_bps"], list):
            raise ValueError("expected drawn sensor nodes of equal rates, a fixed altitude, static links in free space")
        side_m = area.get("side_m")
        gain_db = link["gain_db"]
        return cls(
            slots=scenario["slots"],
            slot_s=scenario["slot_s"],
            area_m=(side_m or area["width_m"], side_m or area["height_m"]),
            start_m=tuple(uav["start_m"]),
            count=sensors["count"],
            capacity_bits=sensors["capacity_bits"],
            sampling_bps=sensors["sampling_bps"],
            initial_queue_mean_bits=sensors["initial_queue_mean_bits"],
            altitude_m=uav["altitude_m"],
            reach_m=uav["max_speed_mps"] * scenario["slot_s"],
            bandwidth_hz=link["bandwidth_hz"],
            snr_per_gain=link["tx_power_w"] / 10.0 ** ((link["noise_dbm"] - 30.0) / 10.0),
            gain_db=tuple(gain_db) if isinstance(gain_db, list) else (gain_db, gain_db),
            comm_radius_m=link["comm_radius_m"],
            comm_s=link["comm_s"],
            resource_blocks=link["resource_blocks"],
        )


@dataclass(frozen=True)
class SensorField:
    """The sensor nodes of one mission: positions [N, 2] in m, linear gains [N], queues before slot 1 [N] in bit."""

    positions_m: Reals
    gains: Reals
    queues_bits: Bits

    @classmethod
    def draw(cls, mission: Mission, random: np.random.Generator) -> SensorField:
        """A new field, by the distributions of docs/src/model.md."""
        queues_bits = random.poisson(mission.initial_queue_mean_bits, mission.count)
        return cls(
            random.random((mission.count, 2)) * mission.area_m,
            10.0 ** (random.uniform(*mission.gain_db, mission.count) / 10.0),
            np.minimum(queues_bits, mission.capacity_bits),
        )


def sampled_bits(mission: Mission, slot: int) -> int:
    """Bits sampled by each sensor node in `slot`, from 1: whole bits without drift (D2)."""
    mean_bits = mission.sampling_bps * mission.slot_s
    return int(np.floor(mean_bits * slot + SLACK)) - int(np.floor(mean_bits * (slot - 1) + SLACK))


def observation_space(mission: Mission) -> Dict:
    """The observation space of one environment."""
    spaces = {"uav": (3,), "queues": (mission.count,), "slot": (1,)}
    return Dict({key: Box(0.0, 1.0, shape, np.float32) for key, shape in spaces.items()})


class NumpyEnv(gymnasium.Env[Any, Any]):
    """One mission at a time, over `field`, or over a new field in every episode."""

    def __init__(self, mission: Mission, field: SensorField | None = None) -> None:
        self.mission = mission
        self.fixed_field = field
        self.observation_space = observation_space(mission)
        self.action_space = Box(-1.0, 1.0, (2,), np.float32)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        super().reset(seed=seed)
        self.field = self.fixed_field or SensorField.draw(self.mission, self.np_random)
        self.queues_bits = self.field.queues_bits.astype(np.int64)
        self.uav_m = np.array(self.mission.start_m)
        self.slot = 0
        return self.observation(), {}

    def step(self, action: NDArray[np.float32]) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        mission = self.mission
        self.slot += 1
        move = np.asarray(action, np.float64)
        move = move / max(np.hypot(move[0], move[1]), 1.0)
        self.uav_m = np.clip(self.uav_m + move * mission.reach_m, 0.0, mission.area_m)

        distance2_m2 = ((self.field.positions_m - self.uav_m) ** 2).sum(axis=1)
        in_range = np.flatnonzero(distance2_m2 <= (mission.comm_radius_m * (1.0 + SLACK)) ** 2)
        fullest_first = np.argsort(-self.queues_bits[in_range], kind="stable")  # as known before the slot
        served = in_range[fullest_first[: mission.resource_blocks]]

        bits = sampled_bits(mission, self.slot)
        queues_bits = self.queues_bits + bits
        lost_bits = int(np.maximum(queues_bits - mission.capacity_bits, 0).sum())
        queues_bits = np.minimum(queues_bits, mission.capacity_bits)
        snr = self.field.gains[served] * mission.snr_per_gain / (mission.altitude_m**2 + distance2_m2[served])
        upload_bits = np.floor(mission.bandwidth_hz * np.log2(1.0 + snr) * mission.comm_s).astype(np.int64)
        queues_bits[served] -= np.minimum(upload_bits, queues_bits[served])
        self.queues_bits = queues_bits

        reward = -lost_bits / (bits * mission.count) if bits > 0 else 0.0
        return self.observation(), reward, False, self.slot == mission.slots, {"lost_bits": lost_bits}

    def observation(self) -> Observation:
        mission = self.mission
        uav = np.append(self.uav_m / mission.area_m, 0.0)
        return {
            "uav": uav.astype(np.float32),
            "queues": (self.queues_bits / mission.capacity_bits).astype(np.float32),
            "slot": np.array([self.slot / mission.slots], np.float32),
        }


class NumpyVectorEnv(gymnasium.vector.VectorEnv[Any, Any, Any]):
    """Many missions in step, with arrays [E, N]: over the given fields cyclically, or over new ones in every episode.

    All missions have the same number of slots, so that episodes are synchronous.
    """

    def __init__(self, mission: Mission, num_envs: int, fields: Sequence[SensorField] = ()) -> None:
        self.mission = mission
        self.num_envs = num_envs
        self.fields = fields
        self.single_observation_space = observation_space(mission)
        self.single_action_space = Box(-1.0, 1.0, (2,), np.float32)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.metadata = {"autoreset_mode": AutoresetMode.NEXT_STEP}

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        if isinstance(seed, int):
            self._np_random = np.random.default_rng(seed)
        mission = self.mission
        if self.fields:
            fields = [self.fields[env % len(self.fields)] for env in range(self.num_envs)]
        else:
            fields = [SensorField.draw(mission, self.np_random) for _ in range(self.num_envs)]
        self.positions_m = np.stack([field.positions_m for field in fields])
        self.gains = np.stack([field.gains for field in fields])
        self.queues_bits = np.stack([field.queues_bits for field in fields]).astype(np.int64)
        self.uav_m = np.tile(mission.start_m, (self.num_envs, 1))
        self.slot = 0
        return self.observation(), {}

    def step(
        self, actions: NDArray[np.float32]
    ) -> tuple[Observation, NDArray[Any], NDArray[Any], NDArray[Any], dict[str, Any]]:
        mission = self.mission
        never = np.zeros(self.num_envs, np.bool_)
        if self.slot == mission.slots:
            observation, _ = self.reset()
            return observation, np.zeros(self.num_envs), never, never, {"lost_bits": np.zeros(self.num_envs, np.int64)}
        self.slot += 1
        moves = np.asarray(actions, np.float64)
        moves = moves / np.maximum(np.hypot(moves[:, :1], moves[:, 1:]), 1.0)
        self.uav_m = np.clip(self.uav_m + moves * mission.reach_m, 0.0, mission.area_m)

        east_m = self.positions_m[:, :, 0] - self.uav_m[:, :1]
        north_m = self.positions_m[:, :, 1] - self.uav_m[:, 1:]
        distance2_m2 = east_m**2 + north_m**2
        in_range = distance2_m2 <= (mission.comm_radius_m * (1.0 + SLACK)) ** 2
        # The key increases with the queue; ties go to the lowest id; -1 out of range.
        key = np.where(in_range, (self.queues_bits + 1) * mission.count - np.arange(mission.count), -1)
        blocks = min(mission.resource_blocks, mission.count)
        served = np.argpartition(key, mission.count - blocks, axis=1)[:, mission.count - blocks :]
        is_served = np.take_along_axis(in_range, served, axis=1)

        bits = sampled_bits(mission, self.slot)
        queues_bits = self.queues_bits + bits
        lost_bits = np.maximum(queues_bits - mission.capacity_bits, 0).sum(axis=1)
        queues_bits = np.minimum(queues_bits, mission.capacity_bits)
        x_m2 = mission.altitude_m**2 + np.take_along_axis(distance2_m2, served, axis=1)
        snr = np.take_along_axis(self.gains, served, axis=1) * mission.snr_per_gain / x_m2
        upload_bits = np.floor(mission.bandwidth_hz * np.log2(1.0 + snr) * mission.comm_s).astype(np.int64)
        held_bits = np.take_along_axis(queues_bits, served, axis=1)
        left_bits = np.where(is_served, held_bits - np.minimum(upload_bits, held_bits), held_bits)
        np.put_along_axis(queues_bits, served, left_bits, axis=1)
        self.queues_bits = queues_bits

        rewards = -lost_bits / (bits * mission.count) if bits > 0 else np.zeros(self.num_envs)
        truncated = np.full(self.num_envs, self.slot == mission.slots)
        return self.observation(), rewards, never, truncated, {"lost_bits": lost_bits}

    def observation(self) -> Observation:
        mission = self.mission
        uav = np.zeros((self.num_envs, 3), np.float32)
        uav[:, :2] = self.uav_m / mission.area_m
        return {
            "uav": uav,
            "queues": (self.queues_bits / mission.capacity_bits).astype(np.float32),
            "slot": np.full((self.num_envs, 1), self.slot / mission.slots, np.float32),
        }
