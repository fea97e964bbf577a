"""Common fixtures."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

import skysink

ROOT = Path(__file__).resolve().parents[2]


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begins with the pages of the book, which take longest."""
    items.sort(key=lambda item: item.path.stem != "test_pages")


GFS = '''
import skysink

class GFS(skysink.Strategy):
    def plan(self, view):
        reachable = view.field.within(view.uav, view.field.reach_m)
        if not len(reachable):
            return None
        return skysink.Decision(view.field.positions_m[reachable[view.queues_bits[reachable].argmax()]])
'''
"""The rule of `gfs`."""


@pytest.fixture
def smoke() -> skysink.Scenario:
    """A quick mission."""
    return skysink.Scenario.load(ROOT / "scenarios" / "smoke.toml")


@pytest.fixture
def gfs(tmp_path: Path) -> Path:
    """A file with the rule of `gfs`."""
    file = tmp_path / "mine.py"
    file.write_text(GFS)
    return file


def run(*arguments: str | Path, cwd: Path, code: int = 0) -> subprocess.CompletedProcess[str]:
    """Runs the command line of the package, which must end with this exit code."""
    words = [str(Path(sys.executable).with_name("skysink")), *map(str, arguments)]
    result = subprocess.run(words, cwd=cwd, capture_output=True, text=True, timeout=300)
    assert result.returncode == code, result.stderr
    return result


def same_files(one: Path, other: Path, names: list[str]) -> None:
    """Fails unless both folders hold the same bytes under these names."""
    for name in names:
        assert (one / name).read_bytes() == (other / name).read_bytes(), name
