"""Skysink: planning for a UAV as mobile data sink over wireless sensor nodes (SNs).

>>> import skysink
>>> scenario = skysink.Scenario.letter().replace({"area.side_m": 300.0, "seed": 7})
>>> run = skysink.simulate(scenario, "exact")
>>> run.loss_rate, run.slots["lost_bits"].sum(), run.queues.shape   # doctest: +SKIP

Names end with their units: ``_m``, ``_s``, ``_bits``, ``_bps``. Results equal those of the command line exactly.
"""

from contextlib import suppress

from skysink import library, ring
from skysink._skysink import (
    STRATEGIES,
    Base,
    Belief,
    Decision,
    Field,
    Flight,
    InputError,
    Neighbours,
    Route,
    Run,
    Scenario,
    Table,
    View,
    __build__,
    __version__,
)
from skysink.flight import Comparison, compare, simulate
from skysink.models import Arrivals, Channel
from skysink.recording import parquet
from skysink.strategy import Strategy
from skysink.sweeps import sweep
from skysink.visits import VisitPlan, plan_visits

__all__ = [
    "STRATEGIES",
    "Arrivals",
    "Base",
    "Belief",
    "Channel",
    "Comparison",
    "Decision",
    "Field",
    "Flight",
    "InputError",
    "Neighbours",
    "Route",
    "Run",
    "Scenario",
    "Strategy",
    "Table",
    "View",
    "VisitPlan",
    "__build__",
    "__version__",
    "compare",
    "library",
    "parquet",
    "plan_visits",
    "ring",
    "simulate",
    "sweep",
]

with suppress(ImportError):  # the environments need Gymnasium 1.1 or newer
    from skysink.agents import FleetBatch, parallel_env
    from skysink.environment import register

    register()
    __all__ += ["FleetBatch", "parallel_env"]
