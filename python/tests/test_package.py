"""The package itself: its stubs, its types, its documentation."""

from __future__ import annotations

import doctest
import inspect
import subprocess
import sys
from pathlib import Path

import pytest

import skysink
from skysink import programs

PYTHON = Path(__file__).resolve().parents[1]


def tool(*arguments: str, cwd: Path = PYTHON) -> None:
    """Runs a program with the installed package, not its sources, which must accept everything."""
    result = subprocess.run([sys.executable, "-P", *arguments], cwd=cwd, capture_output=True, text=True, timeout=600)
    assert result.returncode == 0, result.stdout + result.stderr


def test_the_stubs_are_those_of_the_module(tmp_path: Path) -> None:
    tool("-m", "mypy.stubtest", "skysink._skysink", "--concise", cwd=tmp_path)


def test_the_type_hints_pass_the_type_checker() -> None:
    tool("-m", "mypy", "skysink", "tests", "examples", "--exclude", "rl_")  # which need JAX


def test_the_examples_of_the_documentation_run() -> None:
    tried = doctest.testmod(skysink)
    assert tried.attempted > 2 and tried.failed == 0


def test_the_stub_and_the_reference_have_the_docstrings_of_the_module() -> None:
    tool("reference.py", "--check")


@pytest.mark.parametrize("name", skysink.__all__)
def test_every_public_name_is_documented(name: str) -> None:
    assert inspect.getdoc(getattr(skysink, name)) or name in {"STRATEGIES", "__build__", "__version__"}


def test_the_command_line_is_the_executable_of_the_package_or_of_the_path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    own = programs.executable()
    assert (own == programs.OWN) == programs.OWN.exists()
    monkeypatch.setattr(programs, "OWN", tmp_path / "none")
    (tmp_path / "bin").mkdir()
    script = tmp_path / "bin" / "skysink"
    script.write_text("#!/bin/sh\n")
    script.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path / "bin"))
    with pytest.raises(skysink.InputError, match=r"built without the executable: expected a wheel .* or the skysink of"):
        programs.executable()  # a script is another package's
    assert programs.main() == 2
    (tmp_path / "built").mkdir()
    (tmp_path / "built" / "skysink").symlink_to(own)
    monkeypatch.setenv("PATH", f"{tmp_path / 'bin'}:{tmp_path / 'built'}")
    assert programs.executable() == tmp_path / "built" / "skysink"


def test_the_notebook_runs(tmp_path: Path) -> None:
    nbformat = pytest.importorskip("nbformat")
    nbclient = pytest.importorskip("nbclient")
    notebook = nbformat.read(PYTHON / "examples" / "tutorial.ipynb", as_version=4)
    nbclient.NotebookClient(notebook, timeout=300, resources={"metadata": {"path": str(tmp_path)}}).execute()
