"""A sweep on a Dask cluster: the workers simulate the missions, this process writes the results.

python dask_sweep.py area.toml runs/area                           # two local worker processes
python dask_sweep.py area.toml runs/area tcp://scheduler:8786      # a running cluster
"""

import sys

import distributed
import skysink


def main(file: str, out: str, address: str | None = None) -> None:
    cluster = address or distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None)
    with distributed.Client(cluster) as client:
        results = skysink.sweep(file, out, executor=client.get_executor())
    print(f"{len(results)} missions: {out}/results.csv")


if __name__ == "__main__":
    main(*sys.argv[1:])
