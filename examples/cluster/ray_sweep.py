"""A sweep on a Ray cluster: the workers simulate the missions, this process writes the results.

python ray_sweep.py area.toml runs/area            # on this machine
python ray_sweep.py area.toml runs/area auto       # on the running cluster
"""

import sys
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any

import ray
import skysink


class Executor:
    """Ray as an executor."""

    def submit(self, task: Callable[..., Any], *arguments: Any) -> Future[Any]:
        return ray.remote(task).remote(*arguments).future()


def main(file: str, out: str, address: str | None = None) -> None:
    ray.init(address, include_dashboard=None if address else False)
    results = skysink.sweep(file, out, executor=Executor())
    print(f"{len(results)} missions: {out}/results.csv")


if __name__ == "__main__":
    main(*sys.argv[1:])
