"""The native classes of Skysink, with shapes and units."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any, Final, Literal, Self, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skysink.ring import Vehicle
from skysink.strategy import Strategy

__all__ = [
    "STRATEGIES",
    "Base",
    "Belief",
    "Decision",
    "EnvironmentCore",
    "Field",
    "Flight",
    "InputError",
    "Neighbours",
    "Route",
    "Run",
    "Scenario",
    "SweepPlan",
    "SweepRecord",
    "Table",
    "View",
    "__build__",
    "__version__",
    "expected_rates_bps",
    "fly_ring",
    "latex",
    "library_copy",
    "library_instances",
    "library_verify",
    "plan_ring",
    "positions_m",
    "simplified_polygons",
    "simulate",
    "table_of",
    "visits_of",
]

__version__: Final[str]
__build__: Final[str]
STRATEGIES: Final[list[str]]
"""Names of the built-in strategies."""

class InputError(ValueError):
    """Invalid scenario, sweep, folder or value. The message is one line with the value and the expectation."""

@final
class Scenario:
    """A validated scenario: mission, sensor field, channel and strategy.

    The keys are those of a scenario file (``docs/src/scenario-keys.md``). Scenarios are immutable, compare equal if
    their keys do, and can be pickled; a sensor list is stored as the path of its file.
    """

    @staticmethod
    def load(path: str | PathLike[str]) -> Scenario:
        """Reads and checks a file. Raises :class:`InputError`."""

    @staticmethod
    def letter() -> Scenario:
        """The built-in mission of the UTS letter (arXiv 2103.00753)."""

    @staticmethod
    def parse(
        text: str,
        path: str | PathLike[str] = ...,
        arrivals: str | None = None,
        channel: str | None = None,
        rates: str | None = None,
    ) -> Scenario:
        """Parses a scenario file's text. ``path`` is for errors and relative paths. ``arrivals``, ``channel`` and
        ``rates`` are the texts of the files of ``sensors.arrivals.file``, ``link.file`` and ``link.rates``, which are
        then not read. Raises :class:`InputError`.
        """

    def with_channel(
        self,
        distances_m: Sequence[float] | NDArray[np.float64],
        altitudes_m: Sequence[float] | NDArray[np.float64],
        probabilities: Sequence[float] | NDArray[np.float64],
        rates_bps: NDArray[np.float64],
    ) -> Scenario:
        """A copy with a channel of these rates [bit/s], by distance, altitude and probability (``docs/src/model.md``).
        Raises :class:`InputError`.
        """

    def with_links(
        self,
        x_m: Sequence[float] | NDArray[np.float64],
        y_m: Sequence[float] | NDArray[np.float64],
        z_m: Sequence[float] | NDArray[np.float64],
        levels: NDArray[np.float64],
        rates: Sequence[Sequence[float]] | NDArray[np.float64] | None = None,
    ) -> Scenario:
        """A copy with links by place (``docs/src/decisions.md``, D32): ``levels`` [N, z, y, x], for each SN, or with N
        = 1 for all, at the positions ``x_m``, ``y_m`` and ``z_m`` of the UAV, NaN for no link. They are SNRs [dB], of
        which ``rates`` [steps, 2] has the SNR from which on each rate [bit/s] is carried, or without it rates. Raises
        :class:`InputError`.
        """

    def mean_bits(self) -> NDArray[np.float64]:
        """Mean bits that the SNs sample in a slot, [N], as a copy."""

    def with_arrivals(self, bits: NDArray[np.uint32], dispersion_bits: float = 1.0) -> Scenario:
        """A copy whose SNs sample ``bits`` [T, N], by slot and SN. The planner is told ``sensors.sampling_bps``, and
        ``dispersion_bits``: the variance of the bits in a slot divided by their mean. Raises :class:`InputError`.
        """

    def replace(self, changes: Mapping[str, Any]) -> Scenario:
        """A copy with changed keys, for example ``{"area.side_m": 500.0}``. Raises :class:`InputError`."""

    @property
    def name(self) -> str: ...
    @property
    def seed(self) -> int: ...
    @property
    def slots(self) -> int:
        """Number of slots of the mission, T."""

    @property
    def uavs(self) -> list[dict[str, Any]]:
        """For each UAV a dictionary of its keys of ``[uav]``, and its ``resource_blocks``."""

    @property
    def path(self) -> Path:
        """The file, or what stands for it in errors. Files that the scenario names are relative to its folder."""

    @property
    def strategy(self) -> str:
        """The strategy: a built-in one, ``"python:FILE:CLASS"``, or in a saved run ``"python:NAME"`` for an object that
        only its program has.
        """

    def __getitem__(self, key: str, /) -> Any:
        """The value of a dotted key, or a table as a dictionary."""

    def to_dict(self) -> dict[str, Any]:
        """All keys, including defaults."""

    def to_toml(self) -> str:
        """All keys, including defaults, as the text of a scenario file."""

    def sensors(self) -> Table:
        """The sensor nodes by id, with ``x_m``, ``y_m``, ``queue_bits``, ``gain_db``, ``sampling_bps``,
        ``capacity_bits`` and ``weight``; with ``[sensors.energy]`` also ``capacity_j`` and ``harvest_w``.
        """

    def field(self) -> Field:
        """The sensor nodes, with their true sampling rates, and the limits of plans."""

    def __eq__(self, other: object, /) -> bool: ...
    def __hash__(self) -> int: ...

@final
class Field:
    """The constant data of a mission: sensor nodes (SNs) and limits. ``len`` is N."""

    def __len__(self) -> int: ...
    @property
    def positions_m(self) -> NDArray[np.float64]:
        """Positions of the SNs, east and north [m], [N, 2]. Every access creates a new array."""

    @property
    def gains(self) -> NDArray[np.float64]:
        """Reference channel gain at 1 m, a linear ratio, [N]."""

    @property
    def sampling_bps(self) -> NDArray[np.float64]:
        """Sampling rates [bit/s], [N]. In a mission where they are learnt, all are the scenario's mean."""

    @property
    def capacity_bits(self) -> int:
        """The largest buffer of an SN, B [bit]."""

    @property
    def capacities_bits(self) -> NDArray[np.uint32]:
        """Buffers B_i of the SNs [bit], [N]."""

    @property
    def weights(self) -> NDArray[np.float64]:
        """Weights w_i of the bits of the SNs, [N]; 1 without weights in the sensor list."""

    @property
    def servable(self) -> NDArray[np.bool_]:
        """Whether each SN has a place in its range that the UAV can fly to, and so can be served, [N]. Zones hide
        others.
        """

    @property
    def base(self) -> Base | None:
        """The base that the UAV has to come back to; None if it need not."""

    @property
    def move_slots(self) -> int:
        """Slots of a move on a grid; 1 without one."""

    @property
    def area_m(self) -> tuple[float, float]:
        """Width and height of the area [m]."""

    @property
    def reach_m(self) -> float:
        """Maximum horizontal distance flown in a slot, V_max tau [m]."""

    @property
    def comm_radius_m(self) -> float:
        """Maximum horizontal distance for serving an SN, d_c [m]."""

    @property
    def resource_blocks(self) -> int:
        """Maximum number of SNs served in a slot, n."""

    @property
    def altitudes_m(self) -> tuple[float, float]:
        """Minimum and maximum altitude [m]; equal if the altitude is fixed."""

    @property
    def climb_m(self) -> float:
        """Maximum climb or descent in a slot [m]; 0 if the altitude is fixed."""

    @property
    def slots(self) -> int:
        """Number of slots of the mission, T."""

    @property
    def slot_s(self) -> float:
        """Duration of a slot, tau [s]."""

    @property
    def comm_s(self) -> float:
        """Communication time in a slot, tau_c [s]."""

    def within(self, point: ArrayLike, radius_m: float) -> NDArray[np.uint32]:
        """Ids of the SNs within ``radius_m`` [m] of ``point`` on the ground, ascending; tolerance as in decision D5."""

    def fullest(self, point: ArrayLike, queues_bits: NDArray[np.uint32]) -> NDArray[np.uint32]:
        """Ids of the n SNs with the fullest queues within d_c of ``point``, by their values, ascending. Ties go to the
        lowest id.
        """

    def toward(self, from_: ArrayLike, to: ArrayLike, /) -> NDArray[np.float64]:
        """The point that one slot at full speed reaches from ``from_`` toward ``to``, at most ``to`` [m], [2]."""

    def route(self, from_: ArrayLike, goal: ArrayLike | int, /) -> Route | None:
        """The route from ``from_`` to ``goal``: a point [m], or the id of an SN, into whose range it leads. None if
        there is none.
        """

@final
class View:
    """The input of a strategy in one slot."""

    @property
    def slot(self) -> int:
        """The slot to plan, t, from 1."""

    @property
    def uav(self) -> NDArray[np.float64]:
        """Position of the UAV at the start of the slot, L_u(t-1) [m], [3], read-only."""

    @property
    def queues_bits(self) -> NDArray[np.uint32]:
        """Queues at the start of the slot, true or estimated, B_i(t-1) [bit], [N], read-only. Those of SNs that other
        UAVs have scheduled in this slot count as empty.

        It is unsigned: use ``astype(np.int64)`` for differences.
        """

    @property
    def answers(self) -> NDArray[np.uint8]:
        """What each SN is known to do when it is served in this slot, uint8 [N], read-only: 0 sends its queue, 1 is
        silent, and sends later, 2 is dead. All are 0 without ``sensors.energy`` and ``link.duty_cycle``.
        """

    @property
    def sampling_bps(self) -> NDArray[np.float64]:
        """Sampling rates as known at the start of the slot, true or learnt [bit/s], [N], read-only."""

    @property
    def belief(self) -> Belief:
        """Queues and rates as known at the start of the slot, each with its standard deviation, and the ages of the
        contacts.
        """

    @property
    def field(self) -> Field:
        """What stays the same."""

    @property
    def links(self) -> NDArray[np.float32] | None:
        """SNR of each SN that the UAV hears at the start of the slot [dB], float32 [N], read-only: NaN for those that
        it does not. None without ``link.beacon_radius_m``.
        """

    @property
    def energy_j(self) -> float:
        """Energy in the battery at the start of the slot, E(t-1) [J]; infinite without a battery."""

    @property
    def is_charging(self) -> bool:
        """Whether the UAV has charged in the slot before."""

    @property
    def energy_left_home_j(self) -> float:
        """Energy beyond the way home and the reserve [J]: minus infinity if the way takes too long, infinite without a
        battery.
        """

    @property
    def slots_left_home(self) -> int | None:
        """Slots left beyond those of the way home at full speed, below 0 if it takes too long; None if the UAV need not
        be home in time.
        """

    @property
    def neighbours(self) -> Neighbours | None:
        """The other UAVs; None for a UAV that plans alone."""

    @property
    def values(self) -> NDArray[np.uint32]:
        """The values of the queues by which built-in strategies compare them, w_i B_i in a common unit, uint32 [N],
        read-only: the queues themselves if all weights are equal, and 0 for SNs that zones hide, or that do not send.
        """

    @property
    def servable(self) -> NDArray[np.bool_]:
        """Whether each SN can be served in this slot, [N], read-only: it has a place in its range that the UAV can fly
        to, and is not known to be silent or dead.
        """

    @property
    def reachable(self) -> NDArray[np.uint32]:
        """Ids of the SNs that send and whose range one slot leads into, around zones, of those that are nearer than the
        reach of a slot; ascending.
        """

    def answer(self, id: int) -> Literal["queue", "silent", "dead"]:
        """What SN ``id`` is known to do when it is served in this slot: ``queue`` if it sends, ``silent``, or ``dead``.
        """

    def route_to(self, goal: ArrayLike | int) -> Route | None:
        """The route from the UAV to ``goal``: a point [m], or the id of an SN, into whose range it leads. None if there
        is none.
        """

@final
class Route:
    """A route at full speed, straight or around zones, and on a grid along its lines."""

    @property
    def length_m(self) -> float:
        """Its length [m]."""

    @property
    def slots(self) -> int:
        """Its slots, at least 1."""

    @property
    def energy_j(self) -> float:
        """The energy that it takes [J]; 0 without a battery."""

    @property
    def end_m(self) -> tuple[float, float]:
        """Where it ends [m]."""

@final
class Base:
    """Where UAVs land and charge (decision D9)."""

    @property
    def places_m(self) -> list[tuple[float, float]]:
        """A place well inside of each of its areas [m], [K, 2]; the centre of a disk."""

    @property
    def radius_m(self) -> float | None:
        """Its radius [m]; None if it is made of polygons or of several sites."""

    def contains(self, point: ArrayLike) -> bool:
        """Whether ``point`` [m] lies in it."""

@final
class Neighbours:
    """What the other UAVs of a fleet tell a UAV before it plans a slot."""

    @property
    def own(self) -> int:
        """The number of the UAV that plans."""

    @property
    def uavs(self) -> list[int]:
        """The numbers of the others, ascending."""

    @property
    def positions_m(self) -> NDArray[np.float64]:
        """Their positions at the start of the slot [m], [U - 1, 3], read-only."""

    @property
    def scheduled(self) -> NDArray[np.uint32]:
        """Ids of the SNs that they have scheduled in this slot, uint32, read-only. Empty where each has a part of the
        field.
        """

@final
class Flight:
    """The flight of a UAV in a slot."""

    @property
    def position_m(self) -> NDArray[np.float64]:
        """Where it ended [m], [3], read-only."""

    @property
    def energy_j(self) -> float:
        """Energy in the battery after it [J]; infinite without a battery."""

    @property
    def mode(self) -> str:
        """What was flown, as in the column ``mode`` of ``slots.csv``."""

    @property
    def served(self) -> list[int]:
        """Ids of the SNs that it served, ascending."""

@final
class Belief:
    """What the UAV knows of the sensor nodes at the start of a slot: queues and rates, each with its standard
    deviation, and the ages of its contacts.
    """

    @property
    def queue_bits(self) -> NDArray[np.float64]:
        """Mean of each queue [bit], float64 [N], read-only. The queue itself if queues are known."""

    @property
    def queue_sd_bits(self) -> NDArray[np.float64]:
        """Standard deviation of each queue [bit], float64 [N], read-only. 0 if queues are known."""

    @property
    def rate_bps(self) -> NDArray[np.float64]:
        """Mean of each sampling rate [bit/s], float64 [N], read-only. The rate itself if rates are known."""

    @property
    def rate_sd_bps(self) -> NDArray[np.float64]:
        """Standard deviation of each sampling rate [bit/s], float64 [N], read-only. 0 if rates are known."""

    @property
    def age_slots(self) -> NDArray[np.int64]:
        """Slots since each SN was last served, or since the mission's start, int64 [N], read-only. 0 if the last slot
        served it.
        """

@final
class Decision:
    """The decision of a strategy: ``Decision((x, y))`` or ``Decision((x, y, z), serve=[3, 7])``."""

    def __new__(cls, waypoint: ArrayLike, serve: Iterable[int] | None = None) -> Self:
        """``waypoint`` [m]; without z, a free altitude is the best for the SNs served. ``serve`` contains ids, by default
        those of the n fullest in range, by weight and queue.

        Raises :class:`InputError` for a waypoint of another shape, or with NaN or infinity, and for more than 64 SNs.
        """

    @property
    def waypoint(self) -> list[float]: ...
    @property
    def serve(self) -> list[int] | None: ...

@final
class Table:
    """A table of columns that other libraries import without a copy, by Arrow's C stream interface.

    ``polars.DataFrame(table)``, ``pyarrow.table(table)`` and others accept it. ``table["name"]`` is a read-only NumPy
    array over the same memory, or a list for columns with text or lists.
    """

    @property
    def columns(self) -> list[str]: ...
    def __len__(self) -> int: ...
    def __getitem__(self, name: str, /) -> Any: ...
    def to_pandas(self) -> Any:
        """As a ``pandas.DataFrame``."""

    def to_polars(self) -> Any:
        """As a ``polars.DataFrame``."""

    def __arrow_c_stream__(self, requested_schema: object | None = None) -> Any: ...

@final
class Run:
    """A finished mission. ``len`` is its number of slots."""

    @staticmethod
    def load(folder: str | PathLike[str]) -> Run:
        """Loads a run folder and checks every slot by simulation. Raises :class:`InputError` if it is invalid."""

    @staticmethod
    def _check(folder: str | PathLike[str]) -> None:
        """Refuses a run folder whose scenario, sensor list or source files were changed."""

    @property
    def loss_rate(self) -> float:
        """Data loss rate: lost bits as a fraction of the sampled bits."""

    @property
    def strategy(self) -> str:
        """The name of the strategy in the results: a built-in one, or the label of a Python strategy or an external
        planner.
        """

    @property
    def summary(self) -> dict[str, Any]:
        """The content of ``summary.json`` without its check value."""

    @property
    def metrics(self) -> dict[str, float]:
        """All metrics, as in the results of a sweep (``docs/src/metrics.md``)."""

    @property
    def scenario(self) -> Scenario:
        """The scenario as flown; its ``planner.strategy`` names what flew."""

    @property
    def field(self) -> Field:
        """The sensor nodes, with their true sampling rates, and the limits of plans."""

    @property
    def slots(self) -> Table:
        """One row per slot and UAV with the columns of ``slots.csv``; ``scheduled`` contains lists of ids."""

    @property
    def sensors(self) -> Table:
        """One row per SN with the columns of ``sensors_out.csv``. Every access simulates the run."""

    @property
    def queues(self) -> NDArray[np.uint32]:
        """The queue of every SN before slot 1 and after each slot [bit], [slots + 1, N]. Every access simulates the
        run.

        It is unsigned: use ``astype(np.int64)`` for differences.
        """

    def save(self, folder: str | PathLike[str], force: bool = False) -> Path:
        """Writes a run folder like ``skysink simulate``, and returns its path. ``force`` replaces an existing run.

        Raises :class:`InputError` if the folder contains other files, :class:`OSError` if it cannot be written.
        """

    def show(self, width: int | None = None, height: int | None = None) -> None:
        """Shows the run in the notebook, or in a window, with rerun (``pip install skysink[notebook]``)."""

    def __len__(self) -> int: ...

def latex(text: str) -> str:
    """The text in LaTeX, for every engine and encoding of fonts."""

def table_of(folder: str | PathLike[str]) -> tuple[str, Table]:
    """The table of :func:`skysink.parquet`, and the name of the CSV file with its rows."""

def simulate(
    scenario: Scenario,
    strategy: Strategy | Callable[[], Strategy] | str | None = None,
    *,
    seed: int | None = None,
    label: str | None = None,
    origin: tuple[str, Sequence[tuple[str, bytes]]] | None = None,
) -> Run: ...
def visits_of(
    scenario: Scenario, places: NDArray[np.float64], steps: int
) -> tuple[NDArray[np.float64], float, float]:
    """The visits of :func:`skysink.plan_visits`, a row each: slot, SN, x and y [m]; their cost, and a bound.

    ``places`` has a row for each SN: x and y [m], buffer [bit], rate [bit/s], weight, queue [bit].
    """

def expected_rates_bps(
    scenario: Scenario, gain: float, d2_m2: NDArray[np.float64], rise_m: float
) -> NDArray[np.float64]:
    """The expected rates [bit/s] of the links of a sensor node with this ``gain`` to UAVs at the squares of horizontal
    distances ``d2_m2`` [m²], ``rise_m`` [m] above it.
    """

def positions_m(origin_deg: Sequence[float], positions_deg: NDArray[np.float64]) -> NDArray[np.float64]:
    """Latitudes and longitudes [°], [N, 2], as x and y [m] in the area whose south-west corner is at ``origin_deg``."""

def simplified_polygons(
    polygons: Sequence[Sequence[tuple[float, float]]], most: int, tolerance_m: float, kept: Sequence[tuple[float, float]]
) -> list[list[tuple[float, float]]]:
    """Polygons [m] that grow by at most ``tolerance_m``, but not over the places ``kept``, until they have at most
    ``most`` corners altogether.
    """

def library_instances() -> list[dict[str, Any]]: ...
def library_copy(name: str, folder: Path) -> Path: ...
def library_verify(paths: Sequence[Path], instance: str | None) -> dict[str, Any]: ...
def plan_ring(strategy: Strategy | Callable[[], Strategy], ring: Path, scenario: Path) -> int: ...
def fly_ring(vehicle: Vehicle, ring: Path, scenario: Path, reached_m: float) -> int: ...

_Observation = dict[str, NDArray[np.float32]]
_Step = tuple[_Observation, float, bool, bool, dict[str, Any]]
_Steps = tuple[
    _Observation,
    NDArray[np.float64],
    NDArray[np.bool_],
    NDArray[np.bool_],
    NDArray[np.uint64],
    NDArray[np.uint64],
]
_Key = tuple[int, int, int]
_Row = tuple[_Key, list[float]]
_External = tuple[str, str, Sequence[tuple[str, bytes]]]

@final
class EnvironmentCore:
    def __new__(
        cls,
        scenarios: Sequence[Scenario],
        agents: bool,
        count: int | None,
        fields: int | None,
        observation: Sequence[str],
        nearest: int | None,
        action: str,
        reward: str,
        prepare: Callable[[Scenario], Scenario] | None,
        return_rule: bool,
    ) -> Self: ...
    @property
    def observed(self) -> list[tuple[str, list[int], float]]: ...
    @property
    def action_size(self) -> int: ...
    @property
    def agents(self) -> int: ...
    @property
    def seeds(self) -> list[int]: ...
    @property
    def numbers(self) -> list[int]: ...
    @property
    def field(self) -> Field: ...
    @property
    def belief(self) -> Belief: ...
    @property
    def uav(self) -> tuple[float, float, float]: ...
    @property
    def queues_bits(self) -> NDArray[np.uint32]: ...
    @property
    def sampling_bps(self) -> NDArray[np.float64]: ...
    @property
    def totals(self) -> tuple[NDArray[np.uint64], NDArray[np.uint64]]: ...
    def replace(self, scenarios: Sequence[Scenario], mask: Sequence[bool]) -> None: ...
    def reset(self, seeds: Sequence[int | None], mask: Sequence[bool]) -> _Observation: ...
    def reset_into(self, seeds: Sequence[int | None], observations: NDArray[np.float32]) -> None: ...
    def step_one(self, action: Any) -> _Step: ...
    def fly(self, decision: Decision, transit: bool) -> _Step: ...
    def follow(self, strategy: str) -> _Step: ...
    def step(self, actions: NDArray[Any]) -> _Steps: ...
    def step_into(
        self,
        actions: NDArray[Any],
        observations: NDArray[np.float32],
        rewards: NDArray[np.float32],
        terminated: NDArray[np.bool_],
        truncated: NDArray[np.bool_],
    ) -> None: ...
    def action_masks(self) -> NDArray[np.bool_]: ...
    def expert(self, strategy: str) -> Any: ...
    def state(self) -> NDArray[np.float32]: ...
    def clone(self) -> EnvironmentCore: ...
    def alone(self, index: int) -> EnvironmentCore: ...
    def save(self) -> tuple[list[bytes], bytes]: ...
    def restore(self, saved: tuple[Sequence[bytes], bytes]) -> None: ...
    def run(self, label: str) -> Run: ...

@final
class SweepPlan:
    @staticmethod
    def read(
        path: str | PathLike[str], external: Sequence[_External], models: Sequence[tuple[str, str]]
    ) -> SweepPlan: ...
    @staticmethod
    def compare(
        scenario: Scenario,
        names: Sequence[str],
        seeds: Sequence[int],
        external: Sequence[_External],
        models: Sequence[tuple[str, str]],
    ) -> SweepPlan: ...
    @property
    def identity(self) -> str: ...
    @property
    def missions(self) -> list[_Key]: ...
    def open(self, out: str | PathLike[str]) -> SweepRecord: ...
    def fly(
        self,
        missions: Sequence[_Key],
        strategies: Mapping[str, Callable[[], Strategy]],
        prepare: Callable[[Scenario], Scenario] | None,
    ) -> list[_Row]: ...
    def fly_all(
        self, out: str | PathLike[str], threads: int, progress: Callable[[int, int], object] | None
    ) -> Table: ...
    def rows(self, all: Sequence[_Row]) -> Table: ...
    def standings(self, all: Sequence[_Row]) -> Any: ...
    def finish(self, record: SweepRecord, comparison: str | PathLike[str] | None) -> tuple[Any, Table]: ...

@final
class SweepRecord:
    @property
    def missing(self) -> list[_Key]: ...
    def add(self, mission: _Row) -> None: ...
    def close(self) -> None: ...
