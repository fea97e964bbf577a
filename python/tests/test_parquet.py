"""`skysink.parquet` writes the rows of the CSV files, with types."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import polars
import pyarrow.parquet
import pytest
from conftest import ROOT, run

import skysink

COUNTS = ["slot", "delivered_bits", "lost_bits", "queued_bits"]


def types(path: Path) -> dict[str, str]:
    """The types of the columns of a file, by name."""
    return {field.name: str(field.type) for field in pyarrow.parquet.read_schema(path)}


def test_the_slots_of_a_run_agree_with_slots_csv(smoke: skysink.Scenario, tmp_path: Path) -> None:
    folder = skysink.simulate(smoke, "gfs").save(tmp_path / "run")
    path = skysink.parquet(folder)
    assert path == folder / "slots.parquet"
    table, lines = polars.read_parquet(path), polars.read_csv(folder / "slots.csv", infer_schema_length=None)
    assert table.drop("scheduled", "uploads_bits").rows() == lines.drop("scheduled").rows()
    served = [[int(sensor) for sensor in (ids or "").split()] for ids in lines["scheduled"]]
    assert table["scheduled"].to_list() == served
    uploads = table["uploads_bits"].to_list()
    assert [sum(bits) for bits in uploads] == lines["delivered_bits"].to_list()
    assert [len(bits) for bits in uploads] == [len(ids) for ids in served]
    assert sum(bits > 0 for slot in uploads for bits in slot) > 60
    expected = dict.fromkeys(COUNTS, "uint64") | {"uav": "uint32", "refused": "uint32", "mode": "string"}
    expected |= {"scheduled": "list<element: uint32>", "uploads_bits": "list<element: uint64>"}
    assert types(path) == expected | dict.fromkeys(["x_m", "y_m", "z_m"], "double")
    replaced = path.read_bytes()
    assert skysink.parquet(folder).read_bytes() == replaced
    assert sorted(file.name for file in folder.iterdir() if file.name.startswith(".")) == []
    run("simulate", folder / "scenario.toml", "--out", folder, "--force", cwd=tmp_path)
    assert not path.exists(), "it is a file of the run, which --force replaces"


def test_a_fleet_with_batteries_has_a_row_for_each_uav(tmp_path: Path) -> None:
    scenario = skysink.Scenario.load(ROOT / "scenarios" / "smoke.toml").replace(
        {"slots": 20, "uav.count": 3, "uav.battery.capacity_j": 1e6}
    )
    table = polars.read_parquet(skysink.parquet(skysink.simulate(scenario, "gfs").save(tmp_path / "run")))
    assert table["uav"].to_list()[:4] == [0, 1, 2, 0] and table["energy_j"].dtype == polars.Float64


def test_the_missions_of_a_sweep_have_the_types_of_their_figures(tmp_path: Path) -> None:
    axes = '"area.side_m" = [40, 50.5]\n"slots" = [60]\n"link.gain" = ["static", "per-slot"]\n"planner.offline.steps" = [100]\n'
    text = f'scenario = "{ROOT}/scenarios/smoke.toml"\nstrategies = ["uts", "offline"]\nseeds = 2\n[axes]\n{axes}'
    (tmp_path / "sweep.toml").write_text(text)
    run("sweep", "sweep.toml", "--out", "flown", cwd=tmp_path)
    path = skysink.parquet(tmp_path / "flown")
    table = polars.read_parquet(path)
    found = types(path)
    assert [found[key] for key in ["area.side_m", "slots", "link.gain", "strategy"]] == ["double", "int64", "string", "string"]
    assert [found[key] for key in ["seed", "delivered_bits", "loss_rate", "loss_bound"]] == ["uint64"] * 2 + ["double"] * 2
    assert table.height == 16 and table["loss_bound"].null_count() == 8, "offline alone has bounds"
    assert table.equals(polars.DataFrame(skysink.sweep(tmp_path / "flown")))
    longer = text.replace("seeds = 2", "seeds = 3")
    (tmp_path / "sweep.toml").write_text(longer)
    run("sweep", "sweep.toml", "--out", "flown", cwd=tmp_path)
    assert not path.exists(), "the extended sweep has other rows"
    assert polars.read_parquet(skysink.parquet(tmp_path / "flown")).height == 24


def test_a_folder_without_results_is_refused(smoke: skysink.Scenario, tmp_path: Path) -> None:
    (tmp_path / "sweep.toml").write_text(f'scenario = "{ROOT}/scenarios/smoke.toml"\nstrategies = ["gfs"]\nseeds = 2\n')
    skysink.sweep(tmp_path / "sweep.toml", tmp_path / "flown")
    (tmp_path / "flown" / "results.csv").unlink()
    (tmp_path / "empty").mkdir()
    saved = skysink.simulate(smoke, "gfs").save(tmp_path / "run")
    (saved / "slots.csv").write_text("".join((saved / "slots.csv").read_text().splitlines(keepends=True)[:9]))
    for name, why in [("flown", "no results.csv"), ("empty", "no sweep.json"), ("none", "sweep"), ("run", "slots.csv")]:
        with pytest.raises(skysink.InputError, match=why):
            skysink.parquet(tmp_path / name)
        assert not list((tmp_path / name).glob("*parquet*"))


def test_without_pyarrow_the_error_says_what_to_install(tmp_path: Path) -> None:
    code = f"import sys; sys.modules['pyarrow'] = None; import skysink; skysink.parquet({str(tmp_path)!r})"
    failed = subprocess.run([sys.executable, "-P", "-c", code], capture_output=True, text=True, timeout=60)
    assert "pip install './python[frames]'" in failed.stderr


def test_the_command_line_names_the_call(tmp_path: Path) -> None:
    assert "skysink.parquet(RUN)" in run("export", "run", "--format", "parquet", cwd=tmp_path, code=2).stderr
