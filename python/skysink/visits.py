"""Repeated visits without a mission around them: who is visited when, and from where."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._skysink import InputError, Scenario, visits_of

#: What a place gathers in a slot [bit], in the mission that is planned.
SLOT_BITS = 1000.0
#: The longest time in which a place fills [slots].
MOST_FILL_SLOTS = 4e6


@dataclass(frozen=True)
class VisitPlan:
    """Visits in the order of time."""

    slots: NDArray[np.uint64]
    """The slot at whose end each visit is; the first is 1. [M]"""
    visited: NDArray[np.uint32]
    """The place that is visited, by its index. [M]"""
    positions_m: NDArray[np.float64]
    """From where it is visited. [M, 2]"""
    cost: float
    """What the visits cost by the objective."""
    bound: float
    """No plan costs less."""


def plan_visits(
    positions_m: ArrayLike,
    radius_m: float,
    fill_slots: ArrayLike,
    weights: ArrayLike | None = None,
    *,
    reach_m: float,
    slots: int,
    objective: str | Mapping[str, float] = "loss",
    deadline_slots: int | None = None,
    blocks: int = 4,
    start_m: tuple[float, float] | None = None,
    waited_slots: ArrayLike = 0.0,
    steps: int = 1_000_000,
    seed: int = 1,
) -> VisitPlan:
    """Plans repeated visits to places, by the search of ``horizon`` and ``offline``.

    A vehicle flies up to ``reach_m`` in each of ``slots`` slots, and at the end of a slot visits up to ``blocks`` of the
    places at ``positions_m`` [N, 2] within ``radius_m``. A place fills in ``fill_slots`` (one number or [N]; ``inf``:
    never), and what it gathers when it is full is lost: with the objective ``"loss"`` each such slot costs its weight.
    With it, places were last visited ``waited_slots`` slots before. The other objectives are ``"age"``, ``"peak-age"``,
    ``"deadline"`` (with ``deadline_slots``), and sums such as ``{"loss": 1.0, "age": 0.1}``; see
    ``docs/src/objectives.md``. The start is the middle of the places, unless it is given.

    Raises :class:`InputError` for arrays of other shapes and impossible numbers.
    """
    for name, value, least, most in (
        ("radius_m", radius_m, 1e-9, 1e9),
        ("reach_m", reach_m, 1e-9, 1e9),
        ("slots", slots, 1, 10**6),
        ("blocks", blocks, 1, 64),
        ("steps", steps, 0, 10**12),
        ("seed", seed, 0, 2**63 - 1),
        ("deadline_slots", 1 if deadline_slots is None else deadline_slots, 1, 10**9),
    ):
        kind = (int, np.integer) if isinstance(least, int) else (int, float, np.integer, np.floating)
        if not isinstance(value, kind) or isinstance(value, bool) or not least <= value <= most:
            number = "a whole number" if isinstance(least, int) else "a number"
            raise InputError(f"{name} = {value}: expected {number} from {least:g} to {most:g}")
    if deadline_slots is None and (objective == "deadline" or isinstance(objective, Mapping) and objective.get("deadline")):
        raise InputError("deadline_slots = None: expected the limit of the objective, in slots")
    places = np.asarray(positions_m, dtype=np.float64)
    if places.ndim != 2 or places.shape[1:] != (2,) or len(places) == 0 or not np.isfinite(places).all():
        raise InputError(f"positions_m of shape {places.shape}: expected finite numbers [N, 2], N of at least 1")

    def each(name: str, values: ArrayLike, least: float) -> NDArray[np.float64]:
        array = np.asarray(values, dtype=np.float64)
        if array.shape not in ((), (len(places),)) or not (array >= least).all():
            raise InputError(f"{name} of shape {array.shape}: expected a number, or [{len(places)}], from {least:g}")
        return np.broadcast_to(array, len(places))

    # A sum of losses alone is planned as the loss, whatever its weight.
    factor = 1.0
    if isinstance(objective, Mapping) and not any(weight for name, weight in objective.items() if name != "loss"):
        loss = objective.get("loss")
        if isinstance(loss, (int, float)) and loss > 0.0:
            Scenario.letter().replace({"planner.objective": dict(objective)})  # refuses unknown names and impossible weights
            factor, objective = float(loss), "loss"
    fills = each("fill_slots", fill_slots, 1e-3)
    waited = np.minimum(each("waited_slots", waited_slots, 0.0), fills)
    if objective != "loss" and waited.any():
        raise InputError("waited_slots: expected 0 unless the objective is the loss")
    if not np.isfinite(waited).all():
        raise InputError("waited_slots: expected finite numbers")
    gathers = np.isfinite(fills)
    if (fills[gathers] > MOST_FILL_SLOTS).any():
        raise InputError(f"fill_slots: expected up to {MOST_FILL_SLOTS:g}, or inf")
    start = np.asarray(start_m if start_m is not None else (places.min(0) + places.max(0)) / 2.0, dtype=np.float64)
    if start.shape != (2,) or not np.isfinite(start).all():
        raise InputError(f"start_m = {start_m}: expected two finite numbers")
    corner = np.minimum(places.min(0), start)
    sides = np.maximum(np.maximum(places.max(0), start) - corner, 1e-3)
    sums = dict(objective) if isinstance(objective, Mapping) else objective
    if sums == "collect":
        raise InputError('objective = "collect": expected costs of the time between visits')
    keys = {
        "name": "visits",
        "seed": seed,
        "slots": slots,
        "slot_s": 1.0,
        "area.width_m": float(sides[0]),
        "area.height_m": float(sides[1]),
        "uav.max_speed_mps": float(reach_m),
        "uav.endurance_s": float(slots),
        "uav.start_m": (start - corner).tolist(),
        "link.comm_radius_m": float(radius_m),
        "link.resource_blocks": blocks,
        "link.bandwidth_hz": 1e12,
        "planner.objective": sums,
        **({} if deadline_slots is None else {"sensors.deadline_s": float(deadline_slots)}),
    }
    scenario = Scenario.letter().replace(keys)
    capacity = np.where(gathers, np.maximum(np.round(np.where(gathers, fills, 1.0) * SLOT_BITS), 1.0), 1.0)
    queues = np.minimum(np.round(waited * SLOT_BITS), capacity)
    shares = np.array(each("weights", 1.0 if weights is None else weights, 1e-6))
    if not (shares <= 1e6).all():
        raise InputError("weights: expected numbers from 1e-06 to 1e+06")
    # Equal weights are taken as 1.
    scale = (SLOT_BITS if objective == "loss" else 1.0) / (shares[0] if (shares == shares[0]).all() else 1.0)
    if isinstance(sums, dict) and "loss" in sums:
        # A slot of loss costs its weight, not a bit.
        scenario = scenario.replace({"planner.objective": {**sums, "loss": sums["loss"] / SLOT_BITS}})
    rates = np.where(gathers, SLOT_BITS, 0.0)
    gathering = np.column_stack((places - corner, capacity, rates, shares, queues))
    visits, cost, bound = visits_of(scenario, gathering, steps)
    cost, bound = factor * cost, factor * bound
    numbers = visits[:, 0].astype(np.uint64)
    return VisitPlan(numbers, visits[:, 1].astype(np.uint32), visits[:, 2:] + corner, cost / scale, bound / scale)
