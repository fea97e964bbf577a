"""Gymnasium environments: ``skysink/DataCollection-v0``, single and vectorised.

Observation: ``uav`` float32 [3], x and y as fractions of the area and the altitude within its range (0 if it is
fixed); ``queues`` float32 [N], each queue as a fraction of its buffer; ``slot`` float32 [1], the slot as a fraction of
the mission; optionally ``positions`` float32 [N, 2], as fractions of the area. If the scenario has
``planner.knowledge = "estimated"``, ``queues`` is the estimate of the UAV.

Action: float32 [2], or [3] with a free altitude, each -1 to 1: the displacement of the slot as a fraction of the
maximum distance, V_max tau, and of the maximum climb. A displacement longer than 1 is scaled to 1, and a waypoint
outside the area is moved to its border. The n fullest queues within d_c are served.

Reward: minus the fraction of the bits sampled in the slot that was lost. An episode is truncated after the mission's
last slot; it never terminates. The mean reward is minus the loss rate only if the field samples equally many bits in
every slot, as with whole bits per slot. Otherwise, and for one figure over episodes, add up ``lost_bits``.

Seeds are Skysink seeds: ``reset(seed=s)`` uses the field of the scenario with seed s. Without a seed, the next
episode has the next seed: first the scenario's, then one more each (``num_envs`` more in a vector). With ``fields=k``,
there are only k fields, starting at the scenario's seed, and seeds count modulo k.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from os import PathLike
from typing import Any, Self

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from skysink._skysink import Decision, EnvironmentCore, Field, InputError, Run, Scenario, VectorCore
from skysink.flight import scenario_of

ID = "skysink/DataCollection-v0"
OBSERVED = ("uav", "queues", "slot")
OBSERVABLE = (*OBSERVED, "positions")

Observation = dict[str, NDArray[np.float32]]
Action = NDArray[np.float32]
Step = tuple[Observation, float, bool, bool, dict[str, Any]]


def register() -> None:
    """Registers the environments; `import skysink` does so."""
    if ID not in gymnasium.registry:
        place = "skysink.environment"
        gymnasium.register(
            ID,
            entry_point=f"{place}:DataCollectionEnv",
            vector_entry_point=f"{place}:DataCollectionVectorEnv",
            disable_env_checker=True,  # the environment is tested; checking every step would take longer than the step
            order_enforce=False,
        )


class NativeEnvironment:
    """What the environments have in common: their arguments, and clones, copies and pickles of their native core."""

    _core: Any

    def _begin(
        self,
        scenario: Scenario | str | PathLike[str] | None,
        fields: int | None,
        observation: Sequence[str],
    ) -> tuple[spaces.Space[Any], spaces.Space[Any]]:
        """Makes the core, and returns the spaces of observations and actions of one environment."""
        if isinstance(scenario, Sequence) and not isinstance(scenario, str):
            several = "gymnasium.vector.SyncVectorEnv with an environment for each"
            raise InputError(f"scenario = {scenario!r}: expected one for all environments; for several, {several}")
        self.scenario = Scenario.letter() if scenario is None else scenario_of(scenario)
        self.fields = fields
        self._positions = "positions" in observation
        self._core = self._new_core()
        field: Field = self._core.field
        count = len(field)
        shapes = {"uav": (3,), "queues": (count,), "slot": (1,), "positions": (count, 2)}
        if not set(OBSERVED) <= set(observation) <= set(OBSERVABLE):
            raise InputError(f"observation={tuple(observation)}: expected {OBSERVED}, and optionally positions")
        observed = [name for name in OBSERVABLE if name in observation]
        boxes: dict[str, spaces.Space[Any]] = {name: spaces.Box(0.0, 1.0, shapes[name], np.float32) for name in observed}
        axes = 3 if field.climb_m > 0 else 2
        return spaces.Dict(boxes), spaces.Box(-1.0, 1.0, (axes,), np.float32)

    def _new_core(self) -> Any:
        """A new core with the arguments of the environment."""
        raise NotImplementedError

    def clone(self) -> Self:
        """An independent copy in the same slot, for tree search. Spaces are shared."""
        twin: Self = object.__new__(type(self))
        twin.__dict__.update(self.__dict__)
        twin._core = self._core.clone()
        twin.__dict__["_np_random"] = copy.deepcopy(self.__dict__.get("_np_random"))
        return twin

    def __copy__(self) -> Self:
        return self.clone()

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        twin = self.clone()
        for name in ("observation_space", "action_space", "single_observation_space", "single_action_space"):
            if name in self.__dict__:
                setattr(twin, name, copy.deepcopy(self.__dict__[name], memo))
        return twin

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_core": self._core.save()}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._core = self._new_core()
        self._core.restore(state["_core"])


def check_options(options: dict[str, Any] | None, *possible: str) -> None:
    """Refuses other options of ``reset`` than these."""
    unknown = [name for name in options or {} if name not in possible]
    if unknown:
        expected = f"expected {' or '.join(possible) or 'none'}"
        raise InputError(f"options = {unknown}: {expected}; the scenario is an argument of the environment, made anew")


class DataCollectionEnv(NativeEnvironment, gymnasium.Env[Observation, Action]):
    """An environment for one mission. See the module for spaces, reward and seeds.

    ``scenario`` is a :class:`skysink.Scenario` or a file, by default the paper's; ``fields`` is the number of fields;
    ``observation`` lists the observed quantities.
    """

    metadata: dict[str, Any] = {"render_modes": []}
    _core: EnvironmentCore

    def __init__(
        self,
        scenario: Scenario | str | PathLike[str] | None = None,
        fields: int | None = None,
        observation: Sequence[str] = OBSERVED,
        render_mode: None = None,
    ) -> None:
        self.render_mode = render_mode
        self.observation_space, self.action_space = self._begin(scenario, fields, observation)
        self._is_new = True

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begins an episode; ``info["seed"]`` is its Skysink seed. There are no ``options``."""
        check_options(options)
        super().reset(seed=seed)
        following = self._core.number if self._is_new else self._core.number + 1
        self._is_new = False
        observation = self._core.reset(following if seed is None else int(seed))
        return observation, {"seed": self._core.seed}

    def step(self, action: Action) -> Step:
        """Flies one slot; ``info`` contains its ``lost_bits`` and ``delivered_bits``."""
        return self._core.step(action)

    def fly(self, decision: Decision, *, transit: bool = False) -> Step:
        """Flies one slot with an exact waypoint [m] and schedule, like a strategy."""
        return self._core.fly(decision, transit)

    @property
    def field(self) -> Field:
        """The sensor nodes and limits of this episode."""
        return self._core.field

    @property
    def uav(self) -> tuple[float, float, float]:
        """Position of the UAV [m]."""
        return self._core.uav

    @property
    def queues_bits(self) -> NDArray[np.uint32]:
        """The queues, true or estimated, uint32 [N], as a copy."""
        return self._core.queues_bits

    @property
    def sampling_bps(self) -> NDArray[np.float64]:
        """The sampling rates, true or learnt [bit/s], float64 [N], as a copy."""
        return self._core.sampling_bps

    def run(self, label: str = "environment") -> Run:
        """The episode so far as a run, which can be saved, shown or compared."""
        return self._core.run(label)

    def _new_core(self) -> EnvironmentCore:
        return EnvironmentCore(self.scenario, self.fields, self._positions)


class DataCollectionVectorEnv(NativeEnvironment, VectorEnv[Observation, Action, NDArray[Any]]):
    """An environment for many missions in parallel. See the module for spaces, reward and seeds.

    Autoreset is ``NEXT_STEP``: the step after a truncation begins the next episode, with reward 0.
    """

    metadata: dict[str, Any] = {"render_modes": [], "autoreset_mode": AutoresetMode.NEXT_STEP}
    _core: VectorCore

    def __init__(
        self,
        num_envs: int = 1,
        scenario: Scenario | str | PathLike[str] | None = None,
        fields: int | None = None,
        observation: Sequence[str] = OBSERVED,
        render_mode: None = None,
    ) -> None:
        self.num_envs = num_envs
        self.render_mode = render_mode
        single = self._begin(scenario, fields, observation)
        self.single_observation_space, self.single_action_space = single
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._has_begun = [False] * num_envs

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begins all episodes, or those selected by ``options["reset_mask"]``, bool [num_envs]."""
        check_options(options, "reset_mask")
        first = None if seed is None or isinstance(seed, Sequence) else int(seed)
        super().reset(seed=first)
        mask = (options or {}).get("reset_mask")
        mask = [True] * self.num_envs if mask is None else [bool(one) for one in mask]
        begun = zip(self._core.numbers, self._has_begun, strict=True)
        following = [number + (self.num_envs if has_begun else 0) for number, has_begun in begun]
        if first is not None:
            following = [first + index for index in range(self.num_envs)]
        elif isinstance(seed, Sequence):
            if len(seed) != self.num_envs:
                raise InputError(f"{len(seed)} seeds: expected {self.num_envs}")
            following = [number if one is None else one for one, number in zip(seed, following, strict=True)]
        observation = self._core.reset(following, mask)
        self._has_begun = [begun or now for begun, now in zip(self._has_begun, mask, strict=True)]
        return observation, {"seed": np.array(self._core.seeds), "_seed": np.ones(self.num_envs, np.bool_)}

    def step(
        self, actions: Action
    ) -> tuple[Observation, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """Flies one slot of each mission; ``actions`` is float32 [num_envs, 2 or 3]."""
        observation, rewards, truncated, lost_bits, delivered_bits = self._core.step(np.asarray(actions, np.float32))
        info: dict[str, Any] = {"lost_bits": lost_bits, "delivered_bits": delivered_bits}
        info |= {f"_{name}": np.ones(self.num_envs, np.bool_) for name in info}
        return observation, rewards, np.zeros(self.num_envs, np.bool_), truncated, info

    def _new_core(self) -> VectorCore:
        return VectorCore(self.scenario, self.num_envs, self.fields, self._positions)
