"""Trains a PPO policy for small.toml with skrl (JAX): 256 environments at once, over a new field in every episode.

    pip install ./python -r python/examples/requirements-ppo.txt
    python python/examples/ppo_train.py                  # writes ppo_weights.npz, ppo_curve.csv and ppo_curve.png
    python python/examples/ppo_train.py --fleet          # the same as ppo_fleet_*, for the two UAVs of small_fleet.toml

The UAVs of a fleet share one policy: each is an environment of its own to the training, and earns the bits that are
delivered because of it.

After every ten updates the deterministic policy is evaluated on the twenty fields of the seeds 1001 to 1020, and the weights
with the lowest loss rate so far are saved. ppo_fly.py and ppo_fleet.py compare them with Skysink's strategies on other fields.
"""

from __future__ import annotations

import os

os.environ.setdefault("JAX_PLATFORMS", "cpu")

import argparse
import csv
import time
from collections import deque
from pathlib import Path
from typing import Any, NamedTuple

import flax.linen as nn
import gymnasium
import jax
import jax.numpy as jnp
import matplotlib
import numpy as np
import optax
import skysink
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space
from gymnasium.wrappers.vector import RecordEpisodeStatistics
from numpy.typing import NDArray
from ppo_fly import LAYERS, REACH, Weights, choose, features
from skrl.agents.jax.ppo import PPO, PPO_CFG
from skrl.envs.wrappers.jax import Wrapper, wrap_env
from skrl.memories.jax import RandomMemory
from skrl.models.jax import CategoricalMixin, DeterministicMixin, Model
from skrl.resources.preprocessors.jax import RunningStandardScaler
from skrl.trainers.jax import SequentialTrainer, SequentialTrainerCfg
from skrl.utils import set_seed
from skrl.utils.spaces.jax import unflatten_tensorized_space

HERE = Path(__file__).parent
NAME = "skysink/DataCollection-v0"
KEYS = ("uav", "queues", "slot", "positions")
ENVS = 256
ROLLOUT = 32  # slots between two updates
UPDATES = 10  # between two evaluations
STEPS = ENVS * ROLLOUT * UPDATES  # environment steps between two evaluations
HIDDEN = 32  # units of each layer
SHARPNESS = 4.0  # of the random choice while training
JUDGED_FROM = 1001  # seed of the first of the fields of the evaluation
JUDGED = 20
TICKS = [0.01, 0.02, 0.05, 0.1, 0.2, 0.5]  # of the figure's loss rates


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
        self.loss_rates: deque[float] = deque(maxlen=ENVS)  # of the last episodes

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
    """Environments in which an action is the sensor node to fly towards, one slot at full speed or as far as there."""

    def __init__(self, envs: gymnasium.vector.VectorEnv) -> None:
        super().__init__(envs)
        spaces: Any = envs.single_observation_space
        self.single_action_space = gymnasium.spaces.Discrete(len(spaces["queues"].low))
        self.action_space = batch_space(self.single_action_space, envs.num_envs)

    def reset(self, **options: Any) -> tuple[dict[str, NDArray[np.float32]], dict[str, Any]]:
        self.seen, info = self.env.reset(**options)
        return self.seen, info

    def step(self, targets: NDArray[np.integer[Any]]) -> tuple[Any, ...]:
        towards = self.seen["positions"][np.arange(self.num_envs), targets] - self.seen["uav"][:, :2]
        self.seen, *rest = self.env.step(towards / REACH)  # the environment shortens what is longer than a flight
        return self.seen, *rest


def observed(model: Model, inputs: dict[str, Any]) -> tuple[dict[str, jax.Array], jax.Array]:
    """The observation in a model's inputs, and the features of each SN."""
    observation = unflatten_tensorized_space(model.observation_space, inputs["observations"])
    return observation, features(observation, jnp)


class Policy(CategoricalMixin, Model):
    """The policy of ppo_fly.py in JAX: the scores are the logits of a categorical distribution."""

    def __init__(self, **spaces: Any) -> None:
        Model.__init__(self, **spaces)
        CategoricalMixin.__init__(self)

    @nn.compact
    def __call__(self, inputs: dict[str, Any], role: str) -> tuple[jax.Array, dict[str, Any]]:
        _, seen = observed(self, inputs)
        each = nn.tanh(nn.Dense(HIDDEN)(seen))
        mean = nn.tanh(nn.Dense(HIDDEN)(each)).mean(-2, keepdims=True)
        both = nn.tanh(nn.Dense(HIDDEN)(jnp.concatenate([each, jnp.broadcast_to(mean, each.shape)], -1)))
        ratings = nn.Dense(1, kernel_init=nn.initializers.orthogonal(0.3))(both)[..., 0]
        return SHARPNESS * ratings, {}


class Value(DeterministicMixin, Model):
    """The value function: the discounted future loss."""

    def __init__(self, **spaces: Any) -> None:
        Model.__init__(self, **spaces)
        DeterministicMixin.__init__(self)

    @nn.compact
    def __call__(self, inputs: dict[str, Any], role: str) -> tuple[jax.Array, dict[str, Any]]:
        observation, seen = observed(self, inputs)
        mean = nn.tanh(nn.Dense(HIDDEN)(nn.tanh(nn.Dense(HIDDEN)(seen)))).mean(-2)
        whole = nn.tanh(nn.Dense(HIDDEN)(jnp.concatenate([mean, observation["uav"], observation["slot"]], -1)))
        return nn.Dense(1)(whole), {}


class Row(NamedTuple):
    """A line of the learning curve."""

    steps: int
    seconds: float
    training_loss_rate: float  # of the last episodes, stochastic
    loss_rate: float  # of the evaluation, deterministic


def make_agent(env: Wrapper, updates: int) -> PPO:
    spaces = {"observation_space": env.observation_space, "action_space": env.action_space, "device": env.device}
    models: dict[str, Model] = {"policy": Policy(**spaces), "value": Value(**spaces)}
    for role, model in models.items():
        model.init_state_dict(role=role)
    config = PPO_CFG(
        rollouts=ROLLOUT,
        learning_epochs=3,
        mini_batches=4,
        discount_factor=0.99,
        gae_lambda=0.97,
        learning_rate=1e-3,
        learning_rate_scheduler=optax.constant_schedule,  # a factor in every update: down to a tenth at the end
        learning_rate_scheduler_kwargs={"value": 0.1 ** (1.0 / updates)},
        value_preprocessor=RunningStandardScaler,
        value_preprocessor_kwargs={"size": 1, "device": env.device},
        time_limit_bootstrap=True,
        experiment={"write_interval": 0, "checkpoint_interval": 0},
    )
    memory = RandomMemory(memory_size=ROLLOUT, num_envs=ENVS, device=env.device)
    return PPO(models=models, memory=memory, cfg=config, **spaces)


def weights_of(policy: Policy) -> Weights:
    layers = policy.state_dict.params["params"]
    kernels = {f"kernel_{layer}": np.asarray(layers[f"Dense_{layer}"]["kernel"]) for layer in range(LAYERS)}
    biases = {f"bias_{layer}": np.asarray(layers[f"Dense_{layer}"]["bias"]) for layer in range(LAYERS)}
    return kernels | biases


def judge(envs: Targets, weights: Weights, slots: int) -> float:
    """The mean loss rate of one mission in each environment."""
    observation, _ = envs.reset(seed=JUDGED_FROM)
    lost = 0.0
    for _ in range(slots):
        observation, rewards, *_ = envs.step(choose(weights, observation))
        lost -= float(rewards.mean())  # every slot samples the same number of bits
    return float(np.mean(envs.env.loss_rates)) if isinstance(envs.env, Agents) else lost / slots


def write_curve(rows: list[Row], name: str, folder: Path) -> None:
    with (folder / f"{name}_curve.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(Row._fields)
        writer.writerows((row.steps, f"{row.seconds:.1f}", *(f"{rate:.5f}" for rate in row[2:])) for row in rows)
    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(6.0, 3.5), layout="constrained")
    million = [row.steps / 1e6 for row in rows]
    axes.plot(million, [row.training_loss_rate for row in rows], color="0.6", label="training, stochastic")
    axes.plot(million, [row.loss_rate for row in rows], color="C0", label=f"{JUDGED} other fields, deterministic")
    axes.set(xlabel="environment steps [million]", ylabel="loss rate η", yscale="log")
    least = min(row.loss_rate for row in rows)
    ticks = [tick for tick in TICKS if tick >= 0.5 * least]
    axes.set_yticks(ticks, [str(tick) for tick in ticks])
    axes.minorticks_off()
    axes.set_ylim(min(ticks[0], least), 1.0)
    axes.legend(frameon=False)
    figure.savefig(folder / f"{name}_curve.png", dpi=150)


def main() -> None:
    parser = argparse.ArgumentParser(description="Trains a PPO policy for small.toml.")
    parser.add_argument("--fleet", action="store_true", help="train for small_fleet.toml instead")
    parser.add_argument("--steps", type=float, default=2.5e6, help="steps of all agents [2.5e6]")
    parser.add_argument("--seed", type=int, default=1_000_001, help="of weights, choices and the first field [1000001]")
    parser.add_argument("--out", type=Path, default=HERE, help="folder to write [that of this file]")
    args = parser.parse_args()
    rounds = max(1, round(args.steps / STEPS))
    set_seed(args.seed)

    name = "ppo_fleet" if args.fleet else "ppo"
    scenario = skysink.Scenario.load(HERE / ("small_fleet.toml" if args.fleet else "small.toml"))
    judged = scenario.replace({"seed": JUDGED_FROM})
    fresh: gymnasium.vector.VectorEnv
    fixed: gymnasium.vector.VectorEnv
    if args.fleet:
        fresh, fixed = Agents(ENVS // 2, scenario), Agents(JUDGED, judged, JUDGED)
    else:
        fresh = gymnasium.make_vec(NAME, num_envs=ENVS, scenario=scenario, observation=KEYS)
        fixed = gymnasium.make_vec(NAME, num_envs=JUDGED, scenario=judged, fields=JUDGED, observation=KEYS)
    envs = RecordEpisodeStatistics(Targets(fresh), buffer_length=ENVS)
    env = wrap_env(envs, verbose=False)
    judge_envs = Targets(fixed)
    agent = make_agent(env, rounds * UPDATES)
    schedule = SequentialTrainerCfg(timesteps=ROLLOUT * UPDATES, headless=True, disable_progressbar=True)
    trainer = SequentialTrainer(cfg=schedule, env=env, agents=agent)

    args.out.mkdir(parents=True, exist_ok=True)
    rows: list[Row] = []
    begin = time.perf_counter()
    for number in range(1, rounds + 1):
        trainer.train()
        weights = weights_of(agent.policy)
        of_returns = -float(np.mean(envs.return_queue)) / scenario.slots
        training_loss_rate = float(np.mean(fresh.loss_rates)) if isinstance(fresh, Agents) else of_returns
        loss_rate = judge(judge_envs, weights, scenario.slots)
        if loss_rate < min((row.loss_rate for row in rows), default=1.0):
            np.savez(args.out / f"{name}_weights.npz", allow_pickle=False, **weights)
        rows.append(Row(number * STEPS, time.perf_counter() - begin, training_loss_rate, loss_rate))
        print("{:9,} steps, {:4.0f} s: loss rate {:.4f} stochastic, {:.4f} deterministic".format(*rows[-1]), flush=True)
    write_curve(rows, name, args.out)


if __name__ == "__main__":
    main()
