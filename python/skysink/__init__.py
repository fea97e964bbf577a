"""Skysink: a UAV as a mobile data sink over wireless sensor nodes (SNs), in Python.

>>> import skysink
>>> scenario = skysink.Scenario.letter().replace({"area.side_m": 300.0, "seed": 7})
>>> run = skysink.simulate(scenario, "exact")
>>> run.loss_rate, run.slots["lost_bits"].sum(), run.queues.shape   # doctest: +SKIP

Units are in the names: ``_m``, ``_s``, ``_bits``, ``_bps``. Results are those of the command line, to the bit.
"""

from contextlib import suppress

from skysink._skysink import STRATEGIES, Decision, Field, InputError, Run, Scenario, Table, View, __version__
from skysink.flight import compare, simulate
from skysink.strategy import Strategy
from skysink.sweeps import sweep

with suppress(ImportError):  # without Gymnasium, or beside one before 1.1, there are no environments
    from skysink.environment import register

    register()

__all__ = [
    "STRATEGIES",
    "Decision",
    "Field",
    "InputError",
    "Run",
    "Scenario",
    "Strategy",
    "Table",
    "View",
    "__version__",
    "compare",
    "simulate",
    "sweep",
]
