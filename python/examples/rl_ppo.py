"""PPO for rl_train.py, by skrl (JAX)."""

from __future__ import annotations

from typing import Any

import flax.linen as nn
import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
import optax
from ppo_fly import Weights, features
from rl_envs import DISCOUNT
from rl_network import HIDDEN, scores, weights_of
from skrl.agents.jax.ppo import PPO, PPO_CFG
from skrl.envs.wrappers.jax import Wrapper, wrap_env
from skrl.memories.jax import RandomMemory
from skrl.models.jax import CategoricalMixin, DeterministicMixin, Model
from skrl.resources.preprocessors.jax import RunningStandardScaler
from skrl.trainers.jax import SequentialTrainer, SequentialTrainerCfg
from skrl.utils.spaces.jax import unflatten_tensorized_space

ROLLOUT = 32  # slots between two updates
SHARPNESS = 4.0  # of the random choice while training


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
        return SHARPNESS * scores(seen), {}


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


def make_agent(env: Wrapper, updates: int) -> PPO:
    spaces = {"observation_space": env.observation_space, "action_space": env.action_space, "device": env.device}
    models: dict[str, Model] = {"policy": Policy(**spaces), "value": Value(**spaces)}
    for role, model in models.items():
        model.init_state_dict(role=role)
    config = PPO_CFG(
        rollouts=ROLLOUT,
        learning_epochs=3,
        mini_batches=4,
        discount_factor=DISCOUNT,
        gae_lambda=0.97,
        learning_rate=1e-3,
        learning_rate_scheduler=optax.constant_schedule,  # a factor in every update: down to a tenth at the end
        learning_rate_scheduler_kwargs={"value": 0.1 ** (1.0 / updates)},
        value_preprocessor=RunningStandardScaler,
        value_preprocessor_kwargs={"size": 1, "device": env.device},
        time_limit_bootstrap=True,
        experiment={"write_interval": 0, "checkpoint_interval": 0},
    )
    memory = RandomMemory(memory_size=ROLLOUT, num_envs=env.num_envs, device=env.device)
    return PPO(models=models, memory=memory, cfg=config, **spaces)


class Learner:
    """An agent with its environments."""

    def __init__(self, envs: gymnasium.vector.VectorEnv, slots: int, rounds: int) -> None:
        env = wrap_env(envs, verbose=False)
        self.agent = make_agent(env, rounds * slots // ROLLOUT)
        schedule = SequentialTrainerCfg(timesteps=slots, headless=True, disable_progressbar=True)
        self.trainer = SequentialTrainer(cfg=schedule, env=env, agents=self.agent)

    def train(self) -> Weights:
        """Trains for a round of so many slots, and returns the weights."""
        self.trainer.train()
        return weights_of(self.agent.policy.state_dict.params)
