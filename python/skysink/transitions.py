"""Transitions of an environment as a data set of Minari, for offline learners and imitation."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np

from skysink._skysink import InputError
from skysink.environment import Action, DataCollectionEnv, Observation
from skysink.recording import need


def to_minari(
    name: str,
    env: Any,
    policy: str | Callable[[Observation, dict[str, Any]], Action],
    episodes: int = 10,
    *,
    seed: int | None = None,
    **description: Any,
) -> Any:
    """Flies episodes of an environment and writes their transitions as the data set ``name`` of Minari, such as
    ``"skysink/small-tour-v0"`` (``pip install './python[minari]'``). Returns it; ``minari.load_dataset(name)`` reads it.

    ``env`` is a ``skysink/DataCollection-v0``, also in wrappers. ``policy`` is the name of a built-in strategy, whose
    actions are those of :meth:`skysink.environment.DataCollectionEnv.expert`, or a function of observation and
    information; a name needs actions as they are, without a wrapper of these. ``seed`` is that of the first episode;
    others follow, and the data set has each. Informations are ``lost_bits`` and ``delivered_bits`` of each slot, after
    zeros. ``description`` goes to ``minari.create_dataset_from_buffers``, such as ``author``; its ``description`` is by default the scenario in TOML. The environment can be recovered from the data set
    if its scenario is a file by name.
    """
    if not isinstance(env.unwrapped, DataCollectionEnv):
        raise InputError(f"env = {env!r}: expected a skysink/DataCollection-v0")
    outer = env
    while isinstance(outer, gymnasium.Wrapper):
        if isinstance(policy, str) and isinstance(outer, gymnasium.ActionWrapper):
            raise InputError(f"env = {env!r}: expected no wrapper of actions, which those of {policy} are not meant for")
        outer = outer.env
    if episodes < 1:
        raise InputError(f"episodes = {episodes}: expected 1 or more")
    minari = need("minari", "minari")
    buffer = need("minari.data_collector.episode_buffer", "minari").EpisodeBuffer
    flown = [buffer(id=index, **_fly(env, policy, seed if index == 0 else None)) for index in range(episodes)]
    spec = env.spec
    if spec is not None and not isinstance(spec.kwargs.get("scenario", ""), str):
        spec = None  # it would not be written
    described = {
        "algorithm_name": policy if isinstance(policy, str) else getattr(policy, "__name__", type(policy).__name__),
        "description": env.unwrapped.scenario.to_toml(),
        "env": spec,
        "observation_space": env.observation_space,
        "action_space": env.action_space,
        "data_format": "hdf5",
    }
    return minari.create_dataset_from_buffers(name, flown, **described | description)


def _fly(env: Any, policy: str | Callable[[Observation, dict[str, Any]], Action], seed: int | None) -> dict[str, Any]:
    """An episode, as the arguments of Minari's buffer."""
    seen, info = env.reset(seed=seed)
    number = info["seed"]
    observed, actions, rewards, bits = [seen], [], [], [[0, 0]]
    ends: list[tuple[bool, bool]] = []
    while not (ends and any(ends[-1])):
        action = env.unwrapped.expert(policy) if isinstance(policy, str) else policy(seen, info)
        seen, reward, terminated, truncated, info = env.step(action)
        observed.append(seen)
        actions.append(action)
        rewards.append(float(reward))
        ends.append((terminated, truncated))
        bits.append([info["lost_bits"], info["delivered_bits"]])
    lost_bits, delivered_bits = np.array(bits).T
    return {
        "seed": number,
        "observations": {key: np.stack([one[key] for one in observed]) for key in seen}
        if isinstance(seen, dict)
        else np.stack(observed),
        "actions": np.asarray(actions),
        "rewards": rewards,
        "terminations": [terminated for terminated, _ in ends],
        "truncations": [truncated for _, truncated in ends],
        "infos": {"lost_bits": lost_bits, "delivered_bits": delivered_bits},
    }


__all__ = ["to_minari"]
