"""Converts results to data frames, Parquet files and rerun recordings."""

from __future__ import annotations

import importlib
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from skysink._skysink import Run, Table, table_of

RAMP = 256
"""Number of colours."""

ROWS_PER_GROUP = 65_536
"""Maximum number of rows of a row group of a Parquet file, which readers hold in memory."""


def need(module: str, extra: str) -> Any:
    """Imports a module of an optional dependency. Raises ImportError with the command that installs it."""
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        raise ImportError(f"{error}: pip install './python[{extra}]' in Skysink's sources") from error


def to_pandas(table: Table) -> Any:
    """The table as a ``pandas.DataFrame``; numeric columns share memory."""
    pyarrow = need("pyarrow", "frames")
    return pyarrow.table(table).to_pandas(split_blocks=True)


def to_polars(table: Table) -> Any:
    """The table as a ``polars.DataFrame``, which shares memory."""
    polars = need("polars", "frames")
    return polars.DataFrame(table)


def parquet(folder: str | PathLike[str]) -> Path:
    """Writes the results in a folder as Parquet, beside the CSV file with the same rows, and returns the path.

    For a run that is ``slots.parquet``: the rows of ``slots.csv``, with lists in ``scheduled`` and ``uploads_bits``,
    the bits uploaded by each of these SNs. For a sweep it is ``results.parquet``. An existing file is replaced. Needs
    pyarrow (``pip install './python[frames]'``).

    Raises :class:`skysink.InputError` for another folder, an incomplete run, or a sweep without results.
    """
    pyarrow = need("pyarrow", "frames")
    writer = need("pyarrow.parquet", "frames")
    name, table = table_of(folder)
    rows = pyarrow.table(table)
    rows = rows.cast(pyarrow.schema([field.with_nullable(True) for field in rows.schema]))  # in every file of a kind
    path = (Path(folder) / name).with_suffix(".parquet")
    unfinished = path.with_name(f".{path.name}.new")
    try:
        writer.write_table(rows, unfinished, row_group_size=ROWS_PER_GROUP)
        unfinished.replace(path)
    finally:
        unfinished.unlink(missing_ok=True)
    return path


def show(run: Run, width: int | None = None, height: int | None = None) -> None:
    """Shows a run in the notebook, or in rerun's viewer."""
    rr = need("rerun", "notebook")
    stream = record(run)
    try:
        get_ipython()  # type: ignore[name-defined]
    except NameError:
        rr.spawn(recording=stream)
    else:
        rr.notebook_show(width=width, height=height, recording=stream)


def record(run: Run) -> Any:
    """The run as a rerun stream: sensor nodes coloured by queue fill, the UAV, its path, and the loss over the slots."""
    rr = need("rerun", "notebook")
    rrb = need("rerun.blueprint", "notebook")

    field, slots, queues = run.field, run.slots, run.queues
    stream = rr.RecordingStream("skysink")
    height_m = field.area_m[1]
    path = np.column_stack((slots["x_m"], height_m - slots["y_m"]))  # y points down in 2D views; this makes north up
    sensors = np.column_stack((field.positions_m[:, 0], height_m - field.positions_m[:, 1]))
    full = (queues[1:].astype(np.float64) / np.maximum(field.capacities_bits, 1) * (RAMP - 1)).astype(np.uint32)
    colours = _ramp()[full].ravel()
    time = [rr.TimeColumn("slot", sequence=slots["slot"])]
    rr.log("field/area", rr.Boxes2D(mins=[0, 0], sizes=[field.area_m]), static=True, recording=stream)
    rr.log("field/sensors", rr.Points2D(sensors, radii=rr.Radius.ui_points(4)), static=True, recording=stream)
    rr.log("field/path", rr.LineStrips2D([path]), static=True, recording=stream)
    counts = [len(field)] * len(run)
    rr.send_columns("field/sensors", time, rr.Points2D.columns(colors=colours).partition(counts), recording=stream)
    rr.send_columns("field/uav", time, rr.Points2D.columns(positions=path), recording=stream)
    lost = np.cumsum(slots["lost_bits"])
    for name, values in [("lost_bits", lost), ("queued_bits", slots["queued_bits"])]:
        rr.send_columns(name, time, rr.Scalars.columns(scalars=values.astype(np.float64)), recording=stream)
    curves = rrb.Vertical(rrb.TimeSeriesView(origin="lost_bits"), rrb.TimeSeriesView(origin="queued_bits"))
    views = rrb.Horizontal(rrb.Spatial2DView(origin="field"), curves)
    rr.send_blueprint(rrb.Blueprint(views, collapse_panels=True), recording=stream)
    return stream


def _ramp() -> np.ndarray[Any, np.dtype[np.uint32]]:
    """Colours 0xRRGGBBAA from empty (blue) to full (yellow), which also differ in lightness."""
    fraction = np.linspace(0.0, 1.0, RAMP)
    ends = np.array([[0, 34, 78], [254, 232, 56]])
    red, green, blue = (ends[0] + fraction[:, None] * (ends[1] - ends[0])).astype(np.uint32).T
    colours: np.ndarray[Any, np.dtype[np.uint32]] = (red << 24) | (green << 16) | (blue << 8) | 0xFF
    return colours
