"""Links by place from SNRs that were measured at some places: means by bin, and between bins a law of the distance with
the residuals of the bins about it.

At a node of the grid without a bin, ``SNR = a - 10 n lg D + sum(w_k r_k) / (1 + sum(w_k))`` with the residual ``r_k`` of
each bin about the law and ``w_k = exp(-d_k / l)`` of its distance, of which the length ``l`` is the one that predicts bins
best from all others. The sum is that of kriging with one weight, as by arXiv 2603.10362.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skysink.drafts import Floats, MapGrid

Ids = NDArray[np.int64]

EXPONENTS = (1.0, 10.0)
"""Path loss exponents of a law."""

USUAL_EXPONENT = 2.5
"""Path loss exponent of a law of bins that are all at one distance."""

LENGTHS = (0.5, 1.0, 2.0, 4.0, 8.0, 16.0)
"""Lengths over which residuals are similar, in sides of a bin."""

MOST_PREDICTED = 2000
"""Bins that are predicted from the others."""

AT_ONCE = 500
"""Places that are predicted at once."""


@dataclass(frozen=True)
class Bins:
    """What was measured of a sensor node, by node of the grid."""

    nodes: Ids
    at_m: Floats
    mean_db: Floats
    counts: Ids
    squares_db2: Floats
    """Sums of the squares of the differences from the mean [dB²]."""
    log_ranges: Floats
    """lg of the slant range in metres."""

    def sums(self) -> Floats:
        """Sums from which a law is fitted: count, lg D, SNR, (lg D)², lg D · SNR."""
        terms = [np.ones_like(self.mean_db), self.log_ranges, self.mean_db]
        terms += [self.log_ranges**2, self.log_ranges * self.mean_db]
        return np.stack(terms, axis=-1)


def law_of(sums: Floats) -> tuple[Any, Any]:
    """SNR at 1 m [dB] and exponent of the law of least squares of these sums, with an exponent in ``EXPONENTS``."""
    count, logs, levels, squares, products = np.moveaxis(sums, -1, 0)
    spread = squares - logs * logs / count
    is_spread = spread > 1e-9 * squares
    slope = (products - logs * levels / count) / np.where(is_spread, spread, 1.0)
    exponent = np.where(is_spread, np.clip(-slope / 10.0, *EXPONENTS), USUAL_EXPONENT)
    return (levels + 10.0 * exponent * logs) / count, exponent


def log_range(place_m: Floats, at_m: Floats, altitude_m: float) -> Floats:
    """lg of the slant range in metres, of at least 1 m."""
    ground_m = np.hypot(at_m[:, 0] - place_m[0], at_m[:, 1] - place_m[1])
    found: Floats = np.log10(np.maximum(np.hypot(ground_m, altitude_m), 1.0))
    return found


@dataclass
class Measured:
    """What was measured of all sensor nodes."""

    grid: MapGrid
    altitude_m: float
    places_m: Floats
    bins: list[Bins]
    length_m: float = 0.0
    """Over which residuals are similar [m]."""
    errors_db: tuple[float, float] = (np.inf, np.inf)
    """Root mean square of the errors of bins that are predicted from all others [dB], with residuals and by the law."""

    @staticmethod
    def of(grid: MapGrid, altitude_m: float, places_m: Floats, sensors: Ids, at_m: Floats, snrs_db: Floats) -> Measured:
        """What was measured of sensor nodes at ``places_m``: their ids, the positions of the UAV [m], and SNRs [dB]."""
        columns, rows = grid.nodes
        nearest = np.maximum(np.floor(at_m / grid.step_m + 0.5), 0).astype(np.int64)
        node = np.minimum(nearest[:, 1], rows - 1) * columns + np.minimum(nearest[:, 0], columns - 1)
        positions_m = grid.positions_m
        bins = []
        for sensor, place_m in enumerate(places_m):
            of_sensor = sensors == sensor
            nodes, index = np.unique(node[of_sensor], return_inverse=True)
            counts = np.bincount(index, minlength=nodes.size)
            mean_db = np.bincount(index, snrs_db[of_sensor], minlength=nodes.size) / np.maximum(counts, 1)
            squares_db2 = np.bincount(index, (snrs_db[of_sensor] - mean_db[index]) ** 2, minlength=nodes.size).astype(float)
            at = positions_m[nodes]
            bins.append(Bins(nodes, at, mean_db, counts, squares_db2, log_range(place_m, at, altitude_m)))
        measured = Measured(grid, altitude_m, places_m, bins)
        for length_m in (sides * grid.step_m for sides in LENGTHS):
            errors_db = measured.errors_over(length_m)
            if errors_db[0] < measured.errors_db[0]:
                measured.length_m, measured.errors_db = length_m, errors_db
        return measured

    @property
    def count(self) -> int:
        """Number of bins of all sensor nodes."""
        return sum(len(bins.nodes) for bins in self.bins)

    def law(self) -> tuple[float, float]:
        """SNR at 1 m [dB] and exponent of the law of all bins, whatever the sensor node."""
        snr_db, exponent = law_of(sum(bins.sums().sum(axis=0) for bins in self.bins if bins.nodes.size))
        return float(snr_db), float(exponent)

    def residual_db(self) -> float | None:
        """Standard deviation of SNRs about the mean of their bin [dB]; None if no bin has several."""
        freedom = sum(int((bins.counts - 1).sum()) for bins in self.bins)
        squares_db2 = sum(float(bins.squares_db2.sum()) for bins in self.bins)
        return float(np.sqrt(squares_db2 / freedom)) if freedom else None

    def errors_over(self, length_m: float) -> tuple[float, float]:
        """Root mean squares of the errors with which bins follow from all others of their sensor node [dB], with
        residuals over ``length_m`` and by the law alone; 0 without a sensor node of two bins.
        """
        every = max(-(-self.count // MOST_PREDICTED), 1)
        squares = np.zeros(2)
        predicted = 0
        for bins in (bins for bins in self.bins if bins.nodes.size > 1):
            sums = bins.sums()
            for left_out in np.array_split(np.arange(0, bins.nodes.size, every), -(-bins.nodes.size // (every * AT_ONCE))):
                snr_db, exponent = law_of(sums.sum(axis=0) - sums[left_out])
                residuals_db = bins.mean_db - (snr_db[:, None] - 10.0 * exponent[:, None] * bins.log_ranges)
                own = np.arange(left_out.size), left_out
                error_db = residuals_db[own]
                weights = self.weights(bins, bins.at_m[left_out], length_m)
                weights[own] = 0.0
                corrected_db = error_db - (weights * residuals_db).sum(axis=1) / (1.0 + weights.sum(axis=1))
                squares += [np.sum(corrected_db**2), np.sum(error_db**2)]
                predicted += left_out.size
        with_residuals, of_law = np.sqrt(squares / max(predicted, 1)).tolist()
        return with_residuals, of_law

    def weights(self, bins: Bins, at_m: Floats, length_m: float) -> Floats:
        """The weights of the bins at some places, [places, bins]."""
        east_m, north_m = (at_m[:, None, axis] - bins.at_m[None, :, axis] for axis in (0, 1))
        weights: Floats = np.exp(-np.hypot(east_m, north_m) / length_m)
        return weights

    def levels_db(self) -> Floats:
        """The SNRs [dB] of all sensor nodes, [N, nodes], NaN for a sensor node without a bin."""
        positions_m = self.grid.positions_m
        levels_db = np.full((len(self.bins), len(positions_m)), np.nan)
        for sensor, (bins, place_m) in enumerate(zip(self.bins, self.places_m, strict=True)):
            if not bins.nodes.size:
                continue
            snr_db, exponent = law_of(bins.sums().sum(axis=0))
            residuals_db = bins.mean_db - (snr_db - 10.0 * exponent * bins.log_ranges)
            for first in range(0, len(positions_m), AT_ONCE):
                at_m = positions_m[first : first + AT_ONCE]
                weights = self.weights(bins, at_m, self.length_m)
                corrections_db = weights @ residuals_db / (1.0 + weights.sum(axis=1))
                law_db = snr_db - 10.0 * exponent * log_range(place_m, at_m, self.altitude_m)
                levels_db[sensor, first : first + AT_ONCE] = law_db + corrections_db
            levels_db[sensor, bins.nodes] = bins.mean_db
        return levels_db
