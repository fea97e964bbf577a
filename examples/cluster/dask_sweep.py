"""A sweep on a Dask cluster: the workers fly the missions, this process keeps what was flown.

python dask_sweep.py area.toml runs/area                           # two worker processes here
python dask_sweep.py area.toml runs/area tcp://scheduler:8786      # a cluster that runs
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
