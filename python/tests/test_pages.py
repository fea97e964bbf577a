"""The Python blocks of the book and of the READMEs run as they stand, in the order of their page."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import ROOT

PAGES = [*sorted((ROOT / "docs" / "src").glob("*.md")), ROOT / "README.md", ROOT / "python" / "README.md"]

BLOCK = re.compile(r"(?P<before>[^\n]*)\n```(?P<kind>[\w,]+)\n(?P<text>.*?)^```$", re.MULTILINE | re.DOTALL)

NAME = re.compile(r"# ([\w-]+\.(?:py|toml))\n")
"""The first line of a block that a reader writes to a file."""

QUOTED = "<!-- from "
"""What begins the line before a block of a file that other tests run."""

REASON = re.compile(r"<!-- not run: .+ -->")

READ = ["scenarios", "examples", "python"]
"""Folders of the repository that blocks read."""

AFTER_COMMANDS = ["data.md"]
"""Pages with commands that write what their Python blocks read."""


def blocks(page: Path, language: str) -> list[re.Match[str]]:
    """The blocks of a page in this language, also those that are not run."""
    return [block for block in BLOCK.finditer(page.read_text()) if block["kind"].split(",")[0] == language]


def is_run(block: re.Match[str]) -> bool:
    """Whether the block is run as it stands on the page."""
    return "," not in block["kind"] and not block["before"].startswith(QUOTED)


def printed(page: Path) -> list[str]:
    """The lines that the page says its Python prints: `text` behind a block that is run, or behind `python3 FILE`."""
    lines: list[str] = []
    follows = False
    for block in BLOCK.finditer(page.read_text()):
        if block["kind"] == "text" and follows:
            lines += block["text"].splitlines()
        follows = block["kind"] == "python" and is_run(block) or block["text"].startswith("python3 ")
    return lines


def script(page: Path) -> str:
    """The blocks that are run, each at its lines of the page, so that tracebacks have these."""
    text = page.read_text()
    lines = [""] * (text.count("\n") + 1)
    for block in filter(is_run, blocks(page, "python")):
        first = text.count("\n", 0, block.start("text"))
        code = block["text"].splitlines()
        lines[first : first + len(code)] = code
    return "\n".join(lines)


WITH_PYTHON = [page for page in PAGES if script(page).strip()]


@pytest.mark.parametrize("page", WITH_PYTHON, ids=lambda page: str(page.relative_to(ROOT)))
def test_the_blocks_of_a_page_run(page: Path, tmp_path: Path) -> None:
    """All blocks of a page share a namespace, and a folder with links to the repository's folders."""
    for folder in READ:
        (tmp_path / folder).symlink_to(ROOT / folder)
    for block in [*blocks(page, "python"), *blocks(page, "toml")]:
        if named := NAME.match(block["text"]):
            (tmp_path / named[1]).write_text(block["text"])
    environment = {**os.environ, "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}"}
    commands = [["bash", "-euc", block["text"]] for block in blocks(page, "sh") if is_run(block)]
    (tmp_path / page.name).write_text(script(page))
    for command in [*(commands if page.name in AFTER_COMMANDS else []), [sys.executable, page.name]]:
        ended = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=3600)
        assert ended.returncode == 0, ended.stdout + ended.stderr
    lines = iter(ended.stdout.splitlines())
    missing = [line for line in printed(page) if line not in lines]
    assert not missing, f"{missing}: expected them in\n{ended.stdout}"


def test_blocks_that_are_not_run_state_the_reason() -> None:
    """A block is `python` and run, or `python,no_run` with the reason before it."""
    for page in PAGES:
        for block in blocks(page, "python"):
            expected = "python,no_run" if REASON.fullmatch(block["before"]) else "python"
            assert block["kind"] == expected, f"{page.name}: {block['before']}\n{block['text']}"


def test_most_blocks_are_run() -> None:
    """A pattern that finds no blocks would run none."""
    assert sum(len(list(filter(is_run, blocks(page, "python")))) for page in PAGES) > 15
