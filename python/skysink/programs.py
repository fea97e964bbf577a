"""The command line ``skysink`` of this package, and the processes that it starts."""

from __future__ import annotations

import signal
import sys

from skysink._skysink import run_program


def run(name: str, arguments: list[str]) -> int:
    """Runs the program ``name`` with these arguments, program name first."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # the program installs its own handlers
    return run_program(name, arguments, [sys.executable, "-P", "-m", "skysink.programs"])


def main() -> int:
    """The command line."""
    return run("skysink", ["skysink", *sys.argv[1:]])


if __name__ == "__main__":
    sys.exit(run(sys.argv[1], sys.argv[1:]))
