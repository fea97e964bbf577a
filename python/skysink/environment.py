"""Gymnasium environments: ``skysink/DataCollection-v0``, single and vectorised.

Observation: a dictionary of float32 arrays with the quantities named in ``observation``, by default ``uav``,
``queues`` and ``slot``. All are 0 to 1, except for the coordinates in ``nearest``. ``uav`` [3]: x and y as fractions
of the area, and the altitude within its range (0 if it is fixed). ``queues`` [N]: each queue as a fraction of its
buffer; if the scenario has ``planner.knowledge = "estimated"``, the estimate of the UAV. ``slot`` [1]: the slot as a
fraction of the mission. ``positions`` [N, 2]: as fractions of the area. ``belief`` and ``belief_spread`` [N]: mean
and standard deviation of each queue as the UAV knows it, as fractions of its buffer; the spread of a known queue is
0. ``rates`` [N]: sampling rates, true or learnt, as fractions of the highest that the scenario allows. ``ages`` [N]:
slots since each SN was last served, or since the start, as fractions of the mission. ``gains`` [N]: reference gains
as fractions of the largest. ``nearest`` [k, 5] with the argument ``nearest=k``: the k SNs nearest to the UAV, nearest
first; x and y from the UAV as fractions of the area (-1 to 1), queue, rate and age. ``reach`` [N]: 1 for the SNs that
the UAV reaches in one slot. ``energy`` [1]: as a fraction of the battery's capacity; 1 without a battery, below 0 if the
UAV is down. ``home`` [4], -1 to 1: x and y of the end of the way home from the UAV as fractions of the area, the length
of that way as a fraction of the longer side of the area, and the energy that is left beyond it and the reserve as a
fraction of the capacity, -1 if the UAV comes home too late; 0, 0, 0, 1 where it need not come home. ``zones`` [16]: how
far it is to the next zone or to the border of the area in 16 directions, from the east counterclockwise, as fractions
of the longer side. ``returnable`` [N]: 1 for the SNs that the UAV can still fly to, serve, and come home from in time
and with its reserve. Agents (:mod:`skysink.agents`) observe ``others`` and ``agent``, too.

Action ``"displacement"``, the default: float32 [2], or [3] with a free altitude, each -1 to 1: the displacement of
the slot as a fraction of the maximum distance, V_max tau, and of the maximum climb. A displacement longer than 1 is
scaled to 1, and a waypoint outside the area is moved to its border. Action ``"waypoint"``: float32 [2] or [3], each 0
to 1: the waypoint as fractions of area and altitude range. The UAV flies straight toward it, as far as one slot
allows. With both, the n fullest queues within d_c are served. Action ``"sensor"``: the id of an SN, or with
``nearest=k`` its place, from 0, among the k nearest. The UAV flies straight toward it, and serves it if it is then
within d_c, with the fullest others. ``info["action_mask"]`` and ``action_masks()`` are true for the SNs that one slot
reaches, or for all if it reaches none; with a base or zones, for those of them that are ``returnable``, or for all
that are.

Reward ``"lost"``, the default: minus the fraction of the bits sampled in the slot that was lost. Its mean is minus
the loss rate only if the field samples equally many bits in every slot. Reward ``"loss_fraction"``: minus the bits
lost in the slot, divided by the mean of the bits that the mission samples per slot. Its mean over an episode is always
minus the loss rate. Reward ``"weighted"``: as ``"lost"``, of bits times the weights of their SNs.
Reward ``"age"``: minus the mean over all SNs of the slots since they were last served.

An episode is truncated after the mission's last slot. It terminates when the UAV is down, its battery empty.

With ``return_rule=True`` actions are flown as the decisions of strategies are: around zones, apart from the other UAVs,
and home before energy or time end. Without it, which is the default, the UAV does what it is told: it holds before zones, and may go down.

Seeds are Skysink seeds: ``reset(seed=s)`` uses the field of the scenario with seed s. Without a seed, the next
episode has the next seed: first the scenario's, then one more each (``num_envs`` more in a vector). With
``fields=k``, there are only k fields, starting at the scenario's seed, and seeds count modulo k.

Scenarios: ``reset(options={"scenario": other})`` goes on with another scenario, with as many SNs; with any number of
them if neither observations nor actions depend on it, as with ``nearest=k``. A vector takes a list, too; environment
i flies scenario i modulo the number of scenarios, and its first episode has that scenario's seed plus i.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from os import PathLike
from typing import Any, Literal, Self

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from skysink._skysink import Belief, Decision, EnvironmentCore, Field, InputError, Run, Scenario
from skysink.flight import scenario_of
from skysink.models import Arrivals, Channel, Model, Models

ID = "skysink/DataCollection-v0"
OBSERVED = ("uav", "queues", "slot")

Observation = dict[str, NDArray[np.float32]]
Action = Any
"""float32 [2] or [3], or an integer if the action is a sensor node; of a vector [num_envs] of them."""

OF_EACH = ("field", "uav", "queues_bits", "sampling_bps")
"""What each environment of a vector has of its own."""

FLYING = ("step", "reset", "fly", "follow", "run")
"""What an environment alone can do, and none of a vector."""

MAX_SEED = 2**63 - 1
"""The largest seed of a scenario."""

Control = Literal["displacement", "waypoint", "sensor"]
Reward = Literal["lost", "weighted", "age", "loss_fraction"]
Source = Scenario | str | PathLike[str]
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

    _core: EnvironmentCore

    def _begin(
        self,
        scenario: Source | Sequence[Source] | None,
        agents: bool,
        count: int | None,
        fields: int | None,
        observation: Sequence[str],
        nearest: int | None,
        action: Control,
        reward: str,
        models: Models,
        return_rule: bool,
    ) -> tuple[spaces.Space[Any], spaces.Space[Any]]:
        """Makes the core of a vector of ``count`` environments, which may have several agents, or of a single environment,
        and returns the spaces of observations and actions of one.
        """
        self.scenarios = tuple(map(scenario_of, one_of(scenario) if count is None else some_of(scenario)))
        self.fields = fields
        self._action = action
        prepare = models.prepare if models else None
        self._rules = (agents, count, fields, list(observation), nearest, action, reward, prepare, return_rule)
        self._core = self._new_core()
        boxes: dict[str, spaces.Space[Any]] = {
            name: spaces.Box(low, 1.0, tuple(shape), np.float32) for name, shape, low in self._core.observed
        }
        size = self._core.action_size
        if action == "sensor":
            return spaces.Dict(boxes), spaces.Discrete(size)
        return spaces.Dict(boxes), spaces.Box(0.0 if action == "waypoint" else -1.0, 1.0, (size,), np.float32)

    @property
    def scenario(self) -> Scenario:
        """The scenario; of several environments the first."""
        return self.scenarios[0]

    @property
    def _chooses_sensors(self) -> bool:
        return self._action == "sensor"

    def action_masks(self) -> NDArray[np.bool_]:
        """The SNs to choose from that one slot reaches, or all if it reaches none: bool [N] or [k]; of a vector
        [num_envs, N] or [num_envs, k], of a batch of agents [num_envs, U, N] or [num_envs, U, k].

        Raises :class:`skysink.InputError` for other actions than ``"sensor"``.
        """
        if not self._chooses_sensors:
            raise InputError(f"action = {self._action!r}: expected sensor, which alone has a mask")
        return self._core.action_masks()

    def expert(self, strategy: str) -> Any:
        """The action that comes closest to what a built-in strategy would do in this state, for imitation; of a vector
        those of all environments, of a batch those of all agents.

        The strategy decides where the slot ends; with the action ``"sensor"`` it is the SN toward which the slot ends
        closest to that. A strategy with state, such as ``tour``, keeps it from call to call of an episode. With estimated
        queues it knows what it has seen in the slots in which it was asked.
        """
        return self._core.expert(strategy)

    def _new_core(self) -> EnvironmentCore:
        """A new core with the arguments of the environment."""
        return EnvironmentCore(self.scenarios, *self._rules)

    def _replace(self, scenarios: Sequence[Source], mask: list[bool]) -> None:
        """Begins the first episodes over other scenarios, where ``mask`` is true."""
        others = tuple(map(scenario_of, scenarios))
        self._core.replace(others, mask)
        flown = (others if is_new else self.scenarios for is_new in mask)
        self.scenarios = tuple(them[index % len(them)] for index, them in enumerate(flown))

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


def whole_seed(seed: Any) -> int | None:
    """The seed of an episode, or None; refuses all but whole numbers in the range of Skysink."""
    if seed is None:
        return None
    if isinstance(seed, bool) or not isinstance(seed, (int, np.integer)) or not 0 <= seed <= MAX_SEED:
        raise InputError(f"seed {seed!r}: expected 0 to {MAX_SEED}")
    return int(seed)


def following(seed: int | None, count: int) -> list[int | None]:
    """The seeds of the environments of a vector: ``seed`` and those after it, or the next ones of each."""
    return [None if seed is None else seed + index for index in range(count)]


def check_options(options: dict[str, Any] | None, *possible: str) -> None:
    """Refuses other options of ``reset`` than these."""
    unknown = [name for name in options or {} if name not in possible]
    if unknown:
        raise InputError(f"options = {unknown}: expected {' or '.join(possible)}")


def is_list(scenario: object) -> bool:
    """Whether these are several scenarios."""
    return isinstance(scenario, Sequence) and not isinstance(scenario, str)


def one_of(scenario: Source | Sequence[Source] | None) -> Sequence[Source]:
    """The scenario of an environment, by default the paper's."""
    if is_list(scenario):
        raise InputError(f"scenario = {scenario!r}: expected one; a vector of environments takes several")
    return [Scenario.letter() if scenario is None else scenario]  # type: ignore[list-item]


def some_of(scenario: Source | Sequence[Source] | None) -> Sequence[Source]:
    """The scenarios of a vector of environments."""
    return scenario if is_list(scenario) else one_of(scenario)  # type: ignore[return-value]


class DataCollectionEnv(NativeEnvironment, gymnasium.Env[Observation, Action]):
    """An environment for one mission. See the module for spaces, reward and seeds.

    ``scenario`` is a :class:`skysink.Scenario` or a file, by default the paper's; ``fields`` is the number of fields;
    ``observation`` lists the observed quantities; ``nearest`` is the number of nearest SNs to observe, or to choose
    from; ``action`` is ``"displacement"``, ``"waypoint"`` or ``"sensor"``; ``reward`` is ``"lost"``,
    ``"loss_fraction"``, ``"weighted"`` or ``"age"``; ``return_rule`` is whether the return rule holds.

    Raises :class:`skysink.InputError` for what is unknown or impossible.
    """

    metadata: dict[str, Any] = {"render_modes": []}

    def __init__(
        self,
        scenario: Source | None = None,
        fields: int | None = None,
        observation: Sequence[str] = OBSERVED,
        render_mode: None = None,
        *,
        nearest: int | None = None,
        action: Control = "displacement",
        reward: Reward = "lost",
        arrivals: Model[Arrivals] | None = None,
        channel: Model[Channel] | None = None,
        return_rule: bool = False,
    ) -> None:
        self.render_mode = render_mode
        rules = (fields, observation, nearest, action, reward, Models(arrivals, channel), return_rule)
        self.observation_space, self.action_space = self._begin(scenario, False, None, *rules)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begins an episode; ``info["seed"]`` is its Skysink seed. ``options["scenario"]`` replaces the scenario by
        another (see the module).
        """
        check_options(options, "scenario")
        seed = whole_seed(seed)
        if options and options.get("scenario") is not None:
            self._replace(one_of(options["scenario"]), [True])
        super().reset(seed=seed)
        observation = self._core.reset([seed], [True])
        info: dict[str, Any] = {"seed": self._core.seeds[0]}
        if self._chooses_sensors:
            info["action_mask"] = self.action_masks()
        return observation, info

    def step(self, action: Action) -> Step:
        """Flies one slot; ``info`` contains its ``lost_bits`` and ``delivered_bits``."""
        return self._core.step_one(action)

    def fly(self, decision: Decision, *, transit: bool = False) -> Step:
        """Flies one slot with an exact waypoint [m] and schedule, like a strategy."""
        return self._core.fly(decision, transit)

    def follow(self, strategy: str) -> Step:
        """Flies one slot exactly as a built-in strategy does, with its waypoint, schedule and rules: asked in every slot,
        the episode is the strategy's mission. For rollouts from a :meth:`clone`.
        """
        return self._core.follow(strategy)

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

    @property
    def belief(self) -> Belief:
        """What the UAV knows of the SNs, with standard deviations and ages."""
        return self._core.belief

    def run(self, label: str = "environment") -> Run:
        """The episode so far as a run, which can be saved, shown or compared."""
        return self._core.run(label)


class DataCollectionVectorEnv(NativeEnvironment, VectorEnv[Observation, Action, NDArray[Any]]):
    """An environment for many missions in parallel. See the module for spaces, reward and seeds.

    Autoreset is ``NEXT_STEP``: the step after the end of an episode begins the next episode, with reward 0.
    """

    metadata: dict[str, Any] = {"render_modes": [], "autoreset_mode": AutoresetMode.NEXT_STEP}

    def __init__(
        self,
        num_envs: int = 1,
        scenario: Source | Sequence[Source] | None = None,
        fields: int | None = None,
        observation: Sequence[str] = OBSERVED,
        render_mode: None = None,
        *,
        nearest: int | None = None,
        action: Control = "displacement",
        reward: Reward = "lost",
        arrivals: Model[Arrivals] | None = None,
        channel: Model[Channel] | None = None,
        return_rule: bool = False,
    ) -> None:
        self.num_envs = num_envs
        self.render_mode = render_mode
        rules = (fields, observation, nearest, action, reward, Models(arrivals, channel), return_rule)
        single = self._begin(scenario, False, num_envs, *rules)
        self.single_observation_space, self.single_action_space = single
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begins all episodes, or those selected by ``options["reset_mask"]``, bool [num_envs].
        ``options["scenario"]``, one or a list, replaces their scenarios.
        """
        check_options(options, "reset_mask", "scenario")
        several = [whole_seed(one) for one in seed] if isinstance(seed, Sequence) and not isinstance(seed, str) else None
        first = None if several is not None else whole_seed(seed)
        super().reset(seed=first)
        mask = (options or {}).get("reset_mask")
        mask = [True] * self.num_envs if mask is None else [bool(one) for one in mask]
        if options and options.get("scenario") is not None:
            self._replace(some_of(options["scenario"]), mask)
        if several is not None and len(several) != self.num_envs:
            raise InputError(f"{len(several)} seeds: expected {self.num_envs}")
        observation = self._core.reset(following(first, self.num_envs) if several is None else several, mask)
        return observation, self._info(seed=np.array(self._core.seeds))

    def call(self, name: str, *args: Any, **kwargs: Any) -> tuple[Any, ...]:
        """What each environment has under this name, as the vectors of Gymnasium tell it: ``field``, ``uav``,
        ``queues_bits``, ``sampling_bps`` and ``scenario`` of its own, its spaces, its action of
        ``call("expert", "tour")`` and mask of ``call("action_masks")``, or what all have in common.

        Raises :class:`skysink.InputError` for methods that fly: a vector is flown as a whole.
        """
        if name in OF_EACH:
            return tuple(getattr(self._core.alone(index), name) for index in range(self.num_envs))
        if name in ("expert", "action_masks"):
            return tuple(getattr(self, name)(*args, **kwargs))
        if name == "scenario":
            return tuple(self.scenarios[index % len(self.scenarios)] for index in range(self.num_envs))
        if name in ("observation_space", "action_space"):
            return (getattr(self, f"single_{name}"),) * self.num_envs
        if name in FLYING or callable(getattr(self, name)):
            expected = ", ".join([*OF_EACH, "scenario", "expert", "action_masks"])
            raise InputError(f"call({name!r}): a vector is flown as a whole, by step() and reset(): expected {expected}")
        return (getattr(self, name),) * self.num_envs

    def get_attr(self, name: str) -> tuple[Any, ...]:
        """The attribute of each environment, as :meth:`call` tells it."""
        return self.call(name)

    def _info(self, **arrays: NDArray[Any]) -> dict[str, Any]:
        """The information on all environments, each with its mask of those that it is of."""
        if self._chooses_sensors:
            arrays["action_mask"] = self.action_masks()
        return arrays | {f"_{name}": np.ones(self.num_envs, np.bool_) for name in arrays}

    def step(
        self, actions: Action
    ) -> tuple[Observation, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """Flies one slot of each mission; ``actions`` is float32 [num_envs, 2 or 3], or int64 [num_envs] if they are
        SNs.
        """
        actions = np.asarray(actions) if self._chooses_sensors else np.asarray(actions, np.float32)
        if self._chooses_sensors:
            actions = actions.astype(np.int64, casting="safe", copy=False)
        observation, rewards, terminated, truncated, lost_bits, delivered_bits = self._core.step(actions)
        info = self._info(lost_bits=lost_bits, delivered_bits=delivered_bits)
        return observation, rewards, terminated, truncated, info
