"""Several UAVs as agents: a PettingZoo environment, and a batch of environments that steps in place.

Observations, actions, rewards, seeds and scenarios are those of :mod:`skysink.environment`, for each agent from where it is;
``others`` [U - 1, 2], which is observed by default, are the other UAVs in the order of their numbers: x and y from the agent as
fractions of the area (-1 to 1). ``agent`` [U] is 1 for the agent itself, else 0, for a policy that all share. An SN that several
agents schedule is served by the one of lowest number (decision D19).

All agents have the reward of the team. With ``reward="difference"`` each has the bits that are delivered because of it in the
slot, as a fraction of the mean bits that are sampled in a slot; what another agent in range has scheduled, too, does not count.

All agents act until the end of the mission: none leaves before. A UAV that is down stays where it is, whatever it is told.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from math import prod
from typing import Any, Literal, Self

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from skysink._skysink import Field, InputError
from skysink.environment import Action, Control, NativeEnvironment, Observation, Reward, Source, following, one_of, whole_seed
from skysink.models import Arrivals, Channel, Model, Models

try:
    from pettingzoo import ParallelEnv  # type: ignore[import-untyped]
except ImportError:  # the batch needs none

    class ParallelEnv:  # type: ignore[no-redef]
        """Stands for PettingZoo's, where that is not installed."""

        def __class_getitem__(cls, _types: Any) -> Any:
            return cls


OBSERVED = ("uav", "queues", "slot", "others")


class FleetBatch(NativeEnvironment):
    """A batch of environments with several agents each, stepped in place in arrays that the caller owns.

    ``num_envs`` environments fly ``scenario``, or environment i scenario i modulo their number; the other arguments are those of
    :class:`skysink.environment.DataCollectionEnv`, with ``reward="difference"`` in addition.

    :meth:`arrays` makes the arrays once; :meth:`reset_into` and :meth:`step_into` write into them. A row of ``observations`` is
    what one agent observes, one quantity after another; ``slices`` says where each lies. ``observation_space`` and
    ``action_space`` are those of one agent; ``num_envs`` is the number of missions, ``agents`` that of UAVs in each.

    Raises :class:`skysink.InputError` for what is unknown or impossible.
    """

    def __init__(
        self,
        num_envs: int = 1,
        scenario: Source | Sequence[Source] | None = None,
        fields: int | None = None,
        observation: Sequence[str] = OBSERVED,
        *,
        nearest: int | None = None,
        action: Control = "displacement",
        reward: Reward | Literal["difference"] = "lost",
        arrivals: Model[Arrivals] | None = None,
        channel: Model[Channel] | None = None,
        return_rule: bool = False,
    ) -> None:
        if num_envs < 1:
            raise InputError(f"num_envs = {num_envs}: expected 1 or more")
        self.num_envs = num_envs
        rules = (fields, observation, nearest, action, reward, Models(arrivals, channel), return_rule)
        self.observation_space, self.action_space = self._begin(scenario, True, num_envs, *rules)
        self.agents = self._core.agents
        self.slices: dict[str, slice] = {}
        begin = 0
        for name, shape, _low in self._core.observed:
            end = begin + prod(shape)
            self.slices[name] = slice(begin, end)
            begin = end
        self._width = begin

    @property
    def seeds(self) -> list[int]:
        """The Skysink seed of each environment."""
        return self._core.seeds

    @property
    def field(self) -> Field:
        """The sensor nodes and limits of the first environment."""
        return self._core.field

    @property
    def totals(self) -> tuple[NDArray[np.uint64], NDArray[np.uint64]]:
        """Bits lost and delivered so far in the mission of each environment."""
        lost_bits, delivered_bits = self._core.totals
        return lost_bits, delivered_bits

    def arrays(self) -> tuple[NDArray[Any], NDArray[np.float32], NDArray[np.float32], NDArray[np.bool_], NDArray[np.bool_]]:
        """New arrays for :meth:`step_into`: actions, observations [E, U, width], rewards [E, U], terminated [E], truncated [E].

        Actions are float32 [E, U, 2 or 3], or int64 [E, U] if they are SNs.
        """
        agents = (self.num_envs, self.agents)
        shape = agents if self._chooses_sensors else (*agents, self._core.action_size)
        return (
            np.zeros(shape, np.int64 if self._chooses_sensors else np.float32),
            np.zeros((*agents, self._width), np.float32),
            np.zeros(agents, np.float32),
            np.zeros(self.num_envs, np.bool_),
            np.zeros(self.num_envs, np.bool_),
        )

    def reset_into(self, observations: NDArray[np.float32], seed: int | None = None) -> None:
        """Begins all episodes, environment i with the seed ``seed + i``, by default with the next ones."""
        self._core.reset_into(following(whole_seed(seed), self.num_envs), observations)

    def step_into(
        self,
        actions: NDArray[Any],
        observations: NDArray[np.float32],
        rewards: NDArray[np.float32],
        terminated: NDArray[np.bool_],
        truncated: NDArray[np.bool_],
    ) -> None:
        """Flies one slot of each mission, and writes what follows into the other arrays. All are as those of :meth:`arrays`, and
        those that are written are C-contiguous; NumPy refuses other types, and arrays that overlap.

        The step after the end of an episode begins the next episode instead, with reward 0.
        """
        self._core.step_into(actions, observations, rewards, terminated, truncated)


class DataCollectionParallelEnv(ParallelEnv[str, Observation, Action]):  # type: ignore[misc]
    """One mission of several UAVs as a PettingZoo ``ParallelEnv``; the agents are ``uav_0``, ``uav_1`` and so on.

    The arguments are those of :class:`FleetBatch`. Observations are dictionaries, as those of
    :class:`skysink.environment.DataCollectionEnv`; they are new arrays in every step.
    """

    metadata: dict[str, Any] = {"name": "skysink_data_collection_v0", "render_modes": [], "is_parallelizable": True}

    def __init__(self, scenario: Source | None = None, render_mode: None = None, **arguments: Any) -> None:
        self.render_mode = render_mode
        self.batch = FleetBatch(1, one_of(scenario)[0], **arguments)
        self.possible_agents = [f"uav_{uav}" for uav in range(self.batch.agents)]
        self.agents: list[str] = []
        self._actions, self._observations, self._rewards, self._terminated, self._truncated = self.batch.arrays()
        self.observation_spaces = {agent: copy.deepcopy(self.batch.observation_space) for agent in self.possible_agents}
        self.action_spaces = {agent: copy.deepcopy(self.batch.action_space) for agent in self.possible_agents}
        self.state_space = spaces.Box(0.0, 1.0, self.state().shape, np.float32)
        observed = zip(self.batch.slices.items(), self.batch._core.observed, strict=True)
        self._shapes = [(name, place, shape) for (name, place), (_name, shape, _low) in observed]

    def observation_space(self, agent: str) -> spaces.Space[Any]:
        """What an agent observes."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> spaces.Space[Any]:
        """What an agent does."""
        return self.action_spaces[agent]

    @property
    def num_agents(self) -> int:
        """The number of agents that act."""
        return len(self.agents)

    @property
    def max_num_agents(self) -> int:
        """The number of UAVs."""
        return len(self.possible_agents)

    @property
    def unwrapped(self) -> Self:
        """This environment."""
        return self

    def state(self) -> NDArray[np.float32]:
        """Of the mission, float32: x and y of all UAVs, the queues and the slot, as fractions."""
        return self.batch._core.state()

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Observation], dict[str, dict[str, Any]]]:
        """Begins an episode; each information has its Skysink ``seed``. ``options["scenario"]`` replaces the scenario by another,
        with as many SNs and UAVs; other options are ignored, as PettingZoo expects.
        """
        seed = whole_seed(seed)
        if options and options.get("scenario") is not None:
            self.batch._replace(one_of(options["scenario"]), [True])
        self.batch.reset_into(self._observations, seed)
        self.agents = list(self.possible_agents)
        return self._observed(), self._infos({"seed": self.batch.seeds[0]})

    def step(
        self, actions: dict[str, Action]
    ) -> tuple[
        dict[str, Observation], dict[str, float], dict[str, bool], dict[str, bool], dict[str, dict[str, Any]]
    ]:
        """Flies one slot; the informations have its ``lost_bits`` and ``delivered_bits``, of all UAVs."""
        agents = self.agents
        if not agents:
            raise InputError("the episode is over: expected reset()")
        if missing := [agent for agent in agents if agent not in actions]:
            raise InputError(f"actions of {sorted(actions)}: expected those of {', '.join(missing)}, too")
        row = self._actions[0]
        for index, agent in enumerate(agents):
            action = np.asarray(actions[agent])
            if action.shape != row.shape[1:] or (row.dtype == np.int64 and action.dtype.kind not in "iu"):
                expected = self.action_spaces[agent]
                raise InputError(f"action of {agent}: {actions[agent]!r}: expected one of {expected}")
            row[index] = action
        before = self.batch.totals
        self.batch.step_into(self._actions, self._observations, self._rewards, self._terminated, self._truncated)
        down, over = bool(self._terminated[0]), bool(self._truncated[0])
        rewards = dict(zip(agents, self._rewards[0].tolist(), strict=True))
        lost, delivered = (int(after[0] - begun[0]) for after, begun in zip(self.batch.totals, before, strict=True))
        infos = self._infos({"lost_bits": lost, "delivered_bits": delivered})
        result = self._observed(), rewards, dict.fromkeys(agents, down), dict.fromkeys(agents, over), infos
        if down or over:
            self.agents = []
        return result

    def expert(self, strategy: str) -> dict[str, Action]:
        """For each agent the action that comes closest to what a built-in strategy would do, with the scenario's
        ``uav.coordination``; see :meth:`skysink.environment.DataCollectionEnv.expert`.
        """
        return dict(zip(self.possible_agents, self.batch.expert(strategy)[0], strict=True))

    def render(self) -> None:
        """Renders nothing; runs are shown by ``skysink view``."""

    def close(self) -> None:
        """Does nothing."""

    def _observed(self) -> dict[str, Observation]:
        """What each agent observes."""
        rows = self._observations[0].copy()
        return {
            agent: {name: row[place].reshape(shape) for name, place, shape in self._shapes}
            for agent, row in zip(self.agents, rows, strict=True)
        }

    def _infos(self, info: dict[str, Any]) -> dict[str, dict[str, Any]]:
        """The same information for each agent, with its own mask where actions are SNs."""
        if not self.batch._chooses_sensors:
            return {agent: dict(info) for agent in self.agents}
        masks = self.batch.action_masks()[0]
        return {agent: {**info, "action_mask": mask} for agent, mask in zip(self.agents, masks, strict=True)}


def parallel_env(scenario: Source | None = None, **arguments: Any) -> DataCollectionParallelEnv:
    """A PettingZoo environment of the scenario's UAVs (``pip install 'skysink[agents]'``).

    See :class:`DataCollectionParallelEnv`.
    """
    if ParallelEnv.__module__ == __name__:
        raise InputError("PettingZoo is not installed: expected pip install 'skysink[agents]'")
    return DataCollectionParallelEnv(scenario, **arguments)
