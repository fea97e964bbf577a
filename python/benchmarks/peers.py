"""Planners with common research tools: Algorithm 1 in NumPy, and the waypoint by NumPy, CVXPY or Clarabel.

All peers have the same schedule and differ in the solver of sP2*. Nothing is measured here. Positions are complex
numbers, x + iy [m], so that a quarter turn is a product with i. Equations and decisions Dn are those of docs/src/model.md.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import clarabel
import cvxpy as cp
import numpy as np
from scipy import sparse

from replay import Bits, Field, Ids, Places, Reals, squared, within


@dataclass(frozen=True)
class Expansion:
    """sP2*: maximise −Σ c_i ‖L_i − q‖² subject to ‖q − L_u(t−1)‖ ≤ V τ and ‖q − L_i‖ ≤ d_c for every i."""

    slopes: Reals  # c_i
    centroid: complex  # of the L_i, weighted by c_i: the best point without constraints
    centres: Places  # of the disks: L_u(t−1), then the L_i
    radii_m: Reals  # V τ, then d_c


@dataclass(frozen=True)
class Plan:
    served: Ids  # ascending
    waypoint: complex
    mode: str


Solver = Callable[[Expansion], complex | None]  # the waypoint; None if the problem is infeasible


def plan(field: Field, uav: complex, queues: Bits, solve: Solver) -> Plan:
    """One slot of `uts`: schedule, then waypoint, else transit."""
    served = schedule(field, uav, queues)
    if served is not None:
        waypoint = solve(expand(field, uav, served))
        if waypoint is not None:
            return Plan(served, into_area(field, waypoint), "serve")
    waypoint = into_area(field, transit(field, uav, queues))
    met = np.flatnonzero(within(field.places, waypoint, field.comm_radius_m))
    fullest = met[np.argsort(-queues[met], kind="stable")][: field.blocks]
    return Plan(np.sort(fullest), waypoint, "transit")


def schedule(field: Field, uav: complex, queues: Bits) -> Ids | None:
    """sP1 by Algorithm 1, all anchors and circles at once; None without an anchor. Ties are argmax's (decision D7)."""
    d_c = field.comm_radius_m
    anchor_radius_m = field.reach_m - d_c if field.reach_m > d_c else field.reach_m
    anchors = np.flatnonzero(within(field.places, uav, anchor_radius_m))
    if anchors.size == 0:
        return None
    nearby = np.flatnonzero(within(field.places, uav, (anchor_radius_m + 2 * d_c) * 1.001))  # all candidates
    nearby = nearby[np.argsort(-queues[nearby], kind="stable")]  # fullest first
    bits = queues[nearby]

    meets = field.pairs[anchors[:, None], nearby]
    paired = meets.any(axis=1) & (field.blocks > 1)
    fullest = meets.argmax(axis=1)
    partners = nearby[fullest]  # step 3; meaningless unless `paired`
    centres = circles(field.places[anchors], field.places[partners], d_c)
    others = within(field.places[nearby], centres[:, :, None], d_c)  # step 5: anchor x circle x SN
    others &= ((nearby != anchors[:, None]) & (nearby != partners[:, None]))[:, None, :]
    others &= others.cumsum(axis=2) <= field.blocks - 2  # the n−2 fullest of them
    sums = np.where(others, bits, 0).sum(axis=2)
    chosen = sums.argmax(axis=1)
    best = (queues[anchors] + np.where(paired, bits[fullest] + sums.max(axis=1), 0)).argmax()

    if not paired[best]:
        return anchors[[best]]
    return np.sort(np.concatenate(([anchors[best], partners[best]], nearby[others[best, chosen[best]]])))


def circles(anchors: Places, partners: Places, radius_m: float) -> Places:
    """Step 4: the centres of C1 to C5, a row per anchor. Between SNs at the same place the direction is (1, 0)."""
    between = anchors - partners
    apart_m = np.abs(between)
    along = np.where(apart_m > 0, between / np.where(apart_m > 0, apart_m, 1), 1)
    middle = (anchors + partners) / 2
    across = 1j * along * np.sqrt(np.abs(radius_m**2 - apart_m**2 / 4))
    touch = along * radius_m
    return np.stack([middle + across, middle - across, partners + touch, anchors - touch, middle], axis=1)


def expand(field: Field, uav: complex, served: Ids) -> Expansion:
    """sP2 to first order in d² at the mean of the scheduled positions."""
    places = field.places[served]
    q0 = places.mean()
    gamma = field.gains[served] * field.snr_per_gain
    x_m2 = field.altitude_m**2 + squared(places - q0)
    slopes = field.bandwidth_hz * math.log2(math.e) * gamma / (x_m2 * (x_m2 + gamma))
    centroid = complex(q0 + (slopes * (places - q0)).sum() / slopes.sum())
    radii_m = np.full(len(served) + 1, field.comm_radius_m)
    radii_m[0] = field.reach_m
    return Expansion(slopes, centroid, np.concatenate(([uav], places)), radii_m)


def transit(field: Field, uav: complex, queues: Bits) -> complex:
    """Decision D8: toward the fullest queue, of equals the nearest, as far as a slot allows."""
    goal = complex(field.places[np.lexsort((squared(field.places - uav), -queues))[0]])
    return goal if within(goal, uav, field.reach_m) else uav + (goal - uav) * (field.reach_m / abs(goal - uav))


def into_area(field: Field, place: complex) -> complex:
    return complex(min(max(place.real, 0.0), field.corner.real), min(max(place.imag, 0.0), field.corner.imag))


def solve_numpy(problem: Expansion) -> complex | None:
    """The exact solution: the centroid, or its projection onto one disk, or an intersection of two circles."""
    centres, radii_m, target = problem.centres, problem.radii_m, problem.centroid
    missed = ~within(centres, target, radii_m)
    if not missed.any():
        return target
    away = target - centres[missed]
    waypoint = nearest_allowed(problem, centres[missed] + away * (radii_m[missed] / np.abs(away)))
    return nearest_allowed(problem, crossings(centres, radii_m)) if waypoint is None else waypoint


def crossings(centres: Places, radii_m: Reals) -> Places:
    """Intersections of circles, pair by pair; a gap within the slack of decision D5 is divided by the radii."""
    i, k = np.triu_indices(len(centres), 1)
    i, k = i[centres[i] != centres[k]], k[centres[i] != centres[k]]
    between, r_i, r_k = centres[k] - centres[i], radii_m[i], radii_m[k]
    apart_m = np.abs(between)
    apart = apart_m > r_i + r_k
    foot_m = np.where(apart, apart_m * (r_i / (r_i + r_k)), (apart_m + (r_i - r_k) * ((r_i + r_k) / apart_m)) / 2)
    half_chord_m = np.where(apart, 0, np.sqrt(np.maximum((r_i - foot_m) * (r_i + foot_m), 0)))
    foot, across = centres[i] + between / apart_m * foot_m, 1j * between / apart_m * half_chord_m
    return np.concatenate((foot + across, foot - across))


def nearest_allowed(problem: Expansion, candidates: Places) -> complex | None:
    """The candidate in all disks that is nearest to the centroid."""
    allowed = candidates[within(candidates[:, None], problem.centres, problem.radii_m).all(axis=1)]
    return complex(allowed[squared(allowed - problem.centroid).argmin()]) if allowed.size else None


def solve_cvxpy_anew(problem: Expansion) -> complex | None:
    """sP2* as stated in the paper, with a problem built for each slot."""
    q = cp.Variable(2)
    places = [np.array([place.real, place.imag]) for place in problem.centres]
    loss = sum(c * cp.sum_squares(place - q) for c, place in zip(problem.slopes, places[1:], strict=True))
    ranges = [cp.norm(q - place) <= radius_m for place, radius_m in zip(places, problem.radii_m, strict=True)]
    cp.Problem(cp.Minimize(loss), ranges).solve(solver=cp.CLARABEL)
    return None if q.value is None else complex(*q.value)


class KeptCvxpy:
    """sP2* as the point nearest to the centroid: one problem per number of disks, only its Parameters change (DPP)."""

    def __init__(self) -> None:
        self.kept: dict[int, tuple[cp.Problem, cp.Variable, cp.Parameter, cp.Parameter]] = {}

    def __call__(self, problem: Expansion) -> complex | None:
        disks = len(problem.centres)
        if disks not in self.kept:
            self.kept[disks] = self.build(problem.radii_m)
        program, q, target, centres = self.kept[disks]
        target.value = np.array([problem.centroid.real, problem.centroid.imag])
        centres.value = np.column_stack((problem.centres.real, problem.centres.imag))
        program.solve(solver=cp.CLARABEL, enforce_dpp=True)
        return None if q.value is None else complex(*q.value)

    @staticmethod
    def build(radii_m: Reals) -> tuple[cp.Problem, cp.Variable, cp.Parameter, cp.Parameter]:
        q, target, centres = cp.Variable(2), cp.Parameter(2), cp.Parameter((len(radii_m), 2))
        ranges = [cp.norm(q - centres[disk]) <= radius_m for disk, radius_m in enumerate(radii_m)]
        return cp.Problem(cp.Minimize(cp.sum_squares(q - target)), ranges), q, target, centres


class KeptClarabel:
    """The same without CVXPY: one solver per number of disks, only its data change.

    Minimises ½‖v‖², v = q − centroid, with a cone (r_j, v − v_j) per disk. Lengths from the centroid keep the
    objective small, and with it the gap that Clarabel's relative tolerance allows.
    """

    ACCEPTED = (clarabel.SolverStatus.Solved, clarabel.SolverStatus.AlmostSolved)  # as by CVXPY

    def __init__(self) -> None:
        self.kept: dict[int, clarabel.DefaultSolver] = {}

    def __call__(self, problem: Expansion) -> complex | None:
        disks = len(problem.centres)
        if disks not in self.kept:
            self.kept[disks] = self.build(disks)
        from_centroid = problem.centres - problem.centroid
        limits = np.column_stack((problem.radii_m, -from_centroid.real, -from_centroid.imag)).ravel()
        self.kept[disks].update(b=limits)
        solution = self.kept[disks].solve()
        return problem.centroid + complex(*solution.x) if solution.status in self.ACCEPTED else None

    @staticmethod
    def build(disks: int) -> clarabel.DefaultSolver:
        settings = clarabel.DefaultSettings()
        settings.verbose = False
        settings.presolve_enable = False  # with it, the data could not be replaced
        cone = sparse.csc_matrix([[0.0, 0.0], [-1.0, 0.0], [0.0, -1.0]])
        rows, cones = sparse.vstack([cone] * disks, format="csc"), [clarabel.SecondOrderConeT(3)] * disks
        limits = np.tile([1.0, 0.0, 0.0], disks)
        return clarabel.DefaultSolver(sparse.eye(2, format="csc"), np.zeros(2), rows, limits, cones, settings)
