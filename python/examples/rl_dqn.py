"""DQN for rl_train.py: double Q-learning with a replay memory and a target network."""

from __future__ import annotations

from typing import Any

import flax.linen as nn
import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
import optax
from numpy.typing import NDArray
from ppo_fly import Weights, features
from rl_envs import DISCOUNT
from rl_network import scores, weights_of

BATCH = 64  # transitions of an update
UPDATES = 2  # in each slot
AHEAD = 3  # slots whose rewards are summed before the values are asked
KEPT = 4000  # slots of all environments in the memory: all of the training for the library, or the values drift
BEFORE_LEARNING = 50  # slots
TARGET_RATE = 0.005  # of the target network towards the other, in an update
RATES = (5e-4, 5e-5)  # of learning, at the beginning and at the end
RANDOM = (1.0, 0.1)  # probability of a random SN, at the beginning and after ...
RANDOM_FOR = 0.2  # ... this fraction of the training

Observed = dict[str, NDArray[np.float32]]


class Actions(nn.Module):
    """The values of flying towards each SN."""

    @nn.compact
    def __call__(self, seen: dict[str, jax.Array]) -> jax.Array:
        return scores(features(seen, jnp))


class Memory:
    """The last slots of all environments. What is observed after a slot is what is observed before the next."""

    def __init__(self, seen: Observed, random: np.random.Generator) -> None:
        self.random = random
        self.seen = {name: np.empty((KEPT, *each.shape), np.float32) for name, each in seen.items()}
        count = len(seen["uav"])
        self.actions = np.zeros((KEPT, count), np.int32)
        self.rewards = np.zeros((KEPT, count), np.float32)
        self.down = np.zeros((KEPT, count), np.bool_)
        self.is_step = np.zeros((KEPT, count), np.bool_)
        self.slots = 0

    def add(self, seen: Observed, actions: Any, rewards: Any, down: Any, is_step: Any) -> None:
        """A slot of all environments; `is_step` is false where it began an episode."""
        place = self.slots % KEPT
        for name, each in seen.items():
            self.seen[name][place] = each
        self.actions[place], self.rewards[place], self.down[place], self.is_step[place] = actions, rewards, down, is_step
        self.slots += 1

    def sample(self) -> tuple[Observed, Observed, NDArray[Any], NDArray[Any], NDArray[Any]]:
        """At random: before, after some slots, actions, rewards, and the discounts of what follows. None spans episodes."""
        begins = self.slots - AHEAD - 1 - self.random.integers(0, min(self.slots, KEPT) - AHEAD, 2 * BATCH)
        envs = self.random.integers(0, self.actions.shape[1], 2 * BATCH)
        places = (begins[:, None] + np.arange(AHEAD + 1)) % KEPT
        within = np.flatnonzero(self.is_step[places[:, :-1], envs[:, None]].all(-1))[:BATCH]
        envs, first, last, end = envs[within], places[within, 0], places[within, -2], places[within, -1]
        seen, after = ({name: each[at, envs] for name, each in self.seen.items()} for at in (first, end))
        rewards = self.rewards[places[within, :-1], envs[:, None]] @ (DISCOUNT ** np.arange(AHEAD, dtype=np.float32))
        discounts = np.where(self.down[last, envs], 0.0, DISCOUNT**AHEAD).astype(np.float32)
        return seen, after, self.actions[first, envs], rewards.astype(np.float32), discounts


class Learner:
    """Networks with their environments."""

    def __init__(self, envs: gymnasium.vector.VectorEnv, slots: int, rounds: int, seed: int) -> None:
        self.envs, self.slots, self.all_slots = envs, slots, slots * rounds
        self.random = np.random.default_rng(seed)
        self.seen, _ = envs.reset(seed=seed)
        self.is_over = np.zeros(envs.num_envs, np.bool_)
        self.memory = Memory(self.seen, self.random)
        network = Actions()
        self.values = jax.jit(network.apply)
        self.variables = self.target = network.init(jax.random.key(seed), self.seen)
        rate = optax.exponential_decay(RATES[0], UPDATES * self.all_slots, RATES[1] / RATES[0])
        optimiser = optax.chain(optax.clip_by_global_norm(10.0), optax.adam(rate))
        self.state = optimiser.init(self.variables)

        def error(variables: Any, target: Any, seen: Any, after: Any, actions: Any, rewards: Any, discounts: Any) -> Any:
            best = network.apply(variables, after).argmax(-1)  # chosen by one network, valued by the other
            following = jnp.take_along_axis(network.apply(target, after), best[:, None], -1)[:, 0]
            own = jnp.take_along_axis(network.apply(variables, seen), actions[:, None], -1)[:, 0]
            return optax.huber_loss(own, jax.lax.stop_gradient(rewards + discounts * following)).mean()

        def update(variables: Any, target: Any, state: Any, *transitions: Any) -> tuple[Any, Any, Any]:
            slope = jax.grad(error)(variables, target, *transitions)
            changes, state = optimiser.update(slope, state, variables)
            variables = optax.apply_updates(variables, changes)
            return variables, optax.incremental_update(variables, target, TARGET_RATE), state

        self.update = jax.jit(update)

    def train(self) -> Weights:
        """Trains for a round of so many slots, and returns the weights."""
        for _ in range(self.slots):
            fraction = min(1.0, self.memory.slots / (RANDOM_FOR * self.all_slots))
            is_random = self.random.random(self.envs.num_envs) < RANDOM[0] + fraction * (RANDOM[1] - RANDOM[0])
            best = np.asarray(self.values(self.variables, self.seen)).argmax(-1)
            actions = np.where(is_random, self.random.integers(0, self.seen["queues"].shape[1], len(best)), best)
            after, rewards, down, over, _ = self.envs.step(actions)
            self.memory.add(self.seen, actions, rewards, down, ~self.is_over)
            self.seen, self.is_over = after, down | over
            if self.memory.slots > BEFORE_LEARNING:
                for _ in range(UPDATES):
                    transitions = self.memory.sample()
                    self.variables, self.target, self.state = self.update(
                        self.variables, self.target, self.state, *transitions
                    )
        return weights_of(self.variables)
