"""The network of ppo_fly.py in JAX, for training."""

from __future__ import annotations

from typing import Any

import flax.linen as nn
import jax
import jax.numpy as jnp
import numpy as np
from ppo_fly import LAYERS, Weights

HIDDEN = 32  # units of each layer


def scores(seen: jax.Array) -> jax.Array:
    """The score of each SN [..., N] from its features [..., N, F]; within a compact method of a module."""
    each = nn.tanh(nn.Dense(HIDDEN)(seen))
    mean = nn.tanh(nn.Dense(HIDDEN)(each)).mean(-2, keepdims=True)
    both = nn.tanh(nn.Dense(HIDDEN)(jnp.concatenate([each, jnp.broadcast_to(mean, each.shape)], -1)))
    return nn.Dense(1, kernel_init=nn.initializers.orthogonal(0.3))(both)[..., 0]


def weights_of(variables: Any) -> Weights:
    """The weights for ppo_fly.py."""
    layers = variables["params"]
    kernels = {f"kernel_{layer}": np.asarray(layers[f"Dense_{layer}"]["kernel"]) for layer in range(LAYERS)}
    biases = {f"bias_{layer}": np.asarray(layers[f"Dense_{layer}"]["bias"]) for layer in range(LAYERS)}
    return kernels | biases
