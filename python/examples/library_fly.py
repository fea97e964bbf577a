"""Flies the policies of rl_train.py --task library over the library, and has the flights verified.

    python python/examples/library_fly.py                                # prints instance,strategy,value
    python python/examples/library_fly.py sks-500-200 --policy dqn --out mine       # the same of one, and keeps the runs

It only needs skysink and NumPy. Both policies learnt the loss on other fields: objectives, zones, altitudes and links of an
instance are new to them. UAVs of a fleet fly the policy of one UAV, each in its part of the field.
"""

from __future__ import annotations

import argparse
import csv
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import skysink
from ppo_fly import Learnt
from skysink import library


class DQN(Learnt):
    """The policy that DQN trained for the library."""

    path = Path(__file__).with_name("dqn_library_weights.npz")


class PPO(Learnt):
    """The policy that PPO trained for the library."""

    path = Path(__file__).with_name("ppo_library_weights.npz")


POLICIES: dict[str, type[Learnt]] = {"dqn": DQN, "ppo": PPO}


def fly(name: str, seeds: int, policy: str, folder: Path) -> dict[str, Any]:
    """The verified value and place of a policy over an instance with so many seeds. Its runs are kept as `folder`/SEED."""
    runs = [folder / str(seed) for seed in range(1, seeds + 1)]
    with TemporaryDirectory() as copies:
        scenario = library.copy(name, copies)
        for seed, run in enumerate(runs, 1):
            skysink.simulate(scenario, POLICIES[policy], seed=seed, label=policy).save(run, force=True)
    return library.verify(*runs)


def main() -> None:
    seeds = {instance["name"]: instance["seeds"] for instance in library.instances()}
    parser = argparse.ArgumentParser(description="Flies learnt policies over the library.")
    parser.add_argument("instances", nargs="*", metavar="INSTANCE", help="[all]")
    parser.add_argument("--policy", choices=POLICIES, action="append", help="one of them [both]")
    parser.add_argument("--out", type=Path, help="folder for the runs [not kept]")
    args = parser.parse_args()
    for name in args.instances:
        if name not in seeds:
            parser.error(f"{name}: expected an instance, as `skysink library list` shows them")
    rows = csv.writer(sys.stdout, lineterminator="\n")
    rows.writerow(["instance", "strategy", "value"])
    for name in args.instances or seeds:
        for policy in args.policy or POLICIES:
            with TemporaryDirectory() as unkept:
                folder = (args.out or Path(unkept)) / f"{name}-{policy}"
                rows.writerow([name, policy, fly(name, seeds[name], policy, folder)["value"]])
                sys.stdout.flush()


if __name__ == "__main__":
    main()
