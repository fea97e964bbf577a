"""Named instances with the best known flight of each (``docs/src/library.md``)."""

from __future__ import annotations

from os import PathLike
from pathlib import Path
from typing import Any

from ._skysink import library_copy, library_instances, library_verify

__all__ = ["copy", "instances", "verify"]


def instances() -> list[dict[str, Any]]:
    """All instances, as ``skysink library list --json`` prints them: ``name``, ``about``, ``family``, ``seeds`` (the
    number over which a policy is compared), ``sensors``, ``uavs``, ``slots``, ``best`` (the best known flight: ``measure``,
    ``value``, ``bound``, ``by``, ``cost``, ...), and its ``gap`` to the bound, or None.
    """
    return library_instances()


def copy(name: str, folder: str | PathLike[str] = ".") -> Path:
    """Copies the scenario of an instance and its lists into a folder, and returns the path of the scenario.

    Raises :class:`skysink.InputError` for an unknown name, or if a file exists and differs.
    """
    return Path(library_copy(name, Path(folder)))


def verify(*flights: str | PathLike[str], instance: str | None = None) -> dict[str, Any]:
    """Flies runs or plan files again, as ``skysink library verify`` does, and returns their value and place.

    ``flights`` are run folders, such as of :meth:`skysink.Run.save`, or plan files; of a policy instance one for each
    seed. ``instance`` is the name for plan files that do not have it. Raises :class:`skysink.InputError` for a flight
    that cannot be flown, or one over another scenario.
    """
    return library_verify([Path(flight) for flight in flights], instance)
