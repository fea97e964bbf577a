"""The command line ``skysink``: the executable of the package, which contains all programs of a ring."""

from __future__ import annotations

import os
import sys
from pathlib import Path

from skysink._skysink import InputError

OWN = Path(__file__).with_name("bin") / "skysink"
"""The executable in the wheels of a release."""

ELF = b"\x7fELF"
"""How an executable begins; a script that starts one begins otherwise."""


def executable() -> Path:
    """The executable ``skysink`` of this package; without one the first in PATH.

    Raises :class:`skysink.InputError` if there is none.
    """
    others = [Path(folder) / "skysink" for folder in os.get_exec_path()]
    for file in [OWN, *others]:
        if os.access(file, os.X_OK) and file.is_file():
            with file.open("rb") as opened:
                if opened.read(len(ELF)) == ELF:
                    return file
    raise InputError(
        "this package was built without the executable: expected a wheel of a release or of .ci/wheel, or the skysink of "
        "`cargo build --release` in PATH"
    )


def main() -> int:
    """Replaces this process by the executable."""
    try:
        file = executable()
    except InputError as error:
        print(f"skysink: {error}", file=sys.stderr)
        return 2
    os.execv(file, [str(file), *sys.argv[1:]])


if __name__ == "__main__":
    sys.exit(main())
