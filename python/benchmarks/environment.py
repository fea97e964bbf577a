"""Measures steps per second of `skysink/DataCollection-v0`, of the same environment in NumPy, and of several agents, over the
same field.

    python python/benchmarks/environment.py                     # the paper's mission, N = 200; half a minute
    python python/benchmarks/environment.py --seconds 5         # per environment and repetition

First both simulate a mission with the same random displacements, and must lose the same number of bits in every slot:
exit code 1 if not. Then the environments alternate; the medians of wall-clock times are printed.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from statistics import median
from time import perf_counter
from typing import Any

import gymnasium
import numpy as np
import skysink
from numpy_env import Mission, NumpyEnv, NumpyVectorEnv, SensorField
from numpy.typing import NDArray

NATIVE = "skysink/DataCollection-v0"
FIELDS = 8  # that the environments of a vector fly over, by turns
UAVS = 4  # agents of an environment
ACTIONS = 64  # drawn in advance, and used by turns
Step = Callable[[int], int]  # makes step number i, and returns the number of environment steps in it


def field_of(scenario: skysink.Scenario, seed: int) -> SensorField:
    """The sensor nodes that Skysink draws from a seed."""
    seeded = scenario.replace({"seed": seed})
    field = seeded.field()
    return SensorField(field.positions_m, field.gains, seeded.sensors()["queue_bits"].astype(np.int64))


def single(env: gymnasium.Env) -> Step:
    actions = draw_actions(1)[:, 0]
    env.reset(seed=1)

    def step(number: int) -> int:
        if env.step(actions[number % ACTIONS])[3]:
            env.reset()
        return 1

    return step


def many(envs: gymnasium.vector.VectorEnv) -> Step:
    actions = draw_actions(envs.num_envs)
    envs.reset(seed=1)

    def step(number: int) -> int:
        envs.step(actions[number % ACTIONS])
        return envs.num_envs

    return step


def agents(batch: skysink.FleetBatch) -> Step:
    arrays = batch.arrays()
    actions = draw_actions(arrays[0][..., 0].size).reshape(ACTIONS, *arrays[0].shape)
    batch.reset_into(arrays[1], seed=1)

    def step(number: int) -> int:
        batch.step_into(actions[number % ACTIONS], *arrays[1:])
        return batch.num_envs * batch.agents

    return step


def dictionaries(env: skysink.agents.DataCollectionParallelEnv) -> Step:
    actions = [dict(zip(env.possible_agents, drawn, strict=True)) for drawn in draw_actions(env.max_num_agents)]
    env.reset(seed=1)

    def step(number: int) -> int:
        env.step(actions[number % ACTIONS])
        if not env.agents:
            env.reset()
        return env.max_num_agents

    return step


def draw_actions(count: int) -> NDArray[np.float32]:
    return np.random.default_rng(1).uniform(-1.0, 1.0, (ACTIONS, count, 2)).astype(np.float32)


def steps_per_second(step: Step, seconds: float) -> float:
    """Environment steps per second of `step`, measured for about `seconds`."""
    steps = 0
    number = 0
    begin = perf_counter()
    while (passed := perf_counter() - begin) < seconds:
        steps += step(number)
        number += 1
    return steps / passed


def slots_that_differ(scenario: skysink.Scenario, mission: Mission, count: int) -> list[str]:
    """Simulates `count` fields with the same actions in both: a line for each slot in which their lost bits differ."""
    native: Any
    numpy: NumpyEnv | NumpyVectorEnv
    if count == 1:
        native = gymnasium.make(NATIVE, scenario=scenario, fields=1)
        numpy = NumpyEnv(mission, field_of(scenario, native.reset()[1]["seed"]))
    else:
        native = gymnasium.make_vec(NATIVE, count, scenario=scenario, fields=count)
        seeds = native.reset(seed=0)[1]["seed"].tolist()
        numpy = NumpyVectorEnv(mission, count, [field_of(scenario, seed) for seed in seeds])
    random = np.random.default_rng(2)
    lines = []
    numpy.reset()
    for slot in range(1, numpy.mission.slots + 1):
        actions = random.uniform(-1.0, 1.0, numpy.action_space.shape).astype(np.float32)
        native_seen, native_reward, *native_ends, native_info = native.step(actions)
        numpy_seen, numpy_reward, *numpy_ends, numpy_info = numpy.step(actions)
        gap = max(float(np.abs(native_seen[key] - numpy_seen[key]).max()) for key in numpy_seen)
        agree = np.array_equal(native_info["lost_bits"], numpy_info["lost_bits"])
        agree &= np.array_equal(native_reward, numpy_reward) and np.array_equal(native_ends, numpy_ends)
        if not agree or gap > 1e-6:
            lost = f"lost {native_info['lost_bits']} and {numpy_info['lost_bits']} bit"
            lines.append(f"slot {slot}: {lost}, reward {native_reward} and {numpy_reward}, seen {gap:.1g} apart")
    return lines


def main() -> int:
    parser = argparse.ArgumentParser(description="Compares the native environment with the same in NumPy.")
    parser.add_argument("scenario", nargs="?", type=Path, help="a file [default: the letter's mission]")
    parser.add_argument("--seconds", type=float, default=1.0, help="of each in each repetition [default: 1]")
    parser.add_argument("--repetitions", type=int, default=5, help="at least 5 [default: 5]")
    parser.add_argument("--envs", type=int, default=256, help="environments in a VectorEnv [default: 256]")
    args = parser.parse_args()
    if not args.seconds > 0.0 or args.repetitions < 5 or args.envs < 1:
        parser.error("expected seconds above 0, at least 5 repetitions and at least 1 environment")

    scenario = skysink.Scenario.load(args.scenario) if args.scenario else skysink.Scenario.letter()
    try:
        mission = Mission.of(scenario.to_dict())
    except ValueError as error:
        parser.error(f"scenario {scenario.name}: {error}")
    for count in (1, FIELDS):
        if lines := slots_that_differ(scenario, mission, count):
            print(*lines[:3], f"{len(lines)} of {mission.slots} slots differ", sep="\n", file=sys.stderr)
            return 1
    print(f"N = {mission.count}: native and NumPy lose the same bits in all {mission.slots} slots, one and vectorised")

    fields = [field_of(scenario, scenario.seed + number) for number in range(FIELDS)]
    vector = gymnasium.make_vec(NATIVE, args.envs, scenario=scenario, fields=FIELDS)
    steps = {
        "native, one": single(gymnasium.make(NATIVE, scenario=scenario, fields=FIELDS)),
        "NumPy, one": single(NumpyEnv(mission, fields[0])),
        f"native, VectorEnv({args.envs})": many(vector),
        f"NumPy, VectorEnv({args.envs})": many(NumpyVectorEnv(mission, args.envs, fields)),
    }
    fleet = scenario.replace({"uav.count": UAVS})
    blind = ("uav", "slot", "others")
    steps[f"FleetBatch({args.envs})"] = agents(skysink.FleetBatch(args.envs, fleet, FIELDS))
    steps[f"FleetBatch({args.envs}), blind"] = agents(skysink.FleetBatch(args.envs, fleet, FIELDS, blind))
    if find_spec("pettingzoo"):
        steps["parallel_env"] = dictionaries(skysink.parallel_env(fleet, fields=FIELDS))
    measured: dict[str, list[float]] = {name: [] for name in steps}
    for _ in range(args.repetitions):
        for name, step in steps.items():
            measured[name].append(steps_per_second(step, args.seconds))

    print(f"{'environment':<22} {'steps/s':>12} {'lowest':>12} {'highest':>12}")
    for name, rates in measured.items():
        print(f"{name:<22} {median(rates):>12,.0f} {min(rates):>12,.0f} {max(rates):>12,.0f}")
    print(f"FleetBatch and parallel_env: steps of agents, {UAVS} in an environment; blind: without the queues")
    return 0


if __name__ == "__main__":
    sys.exit(main())
