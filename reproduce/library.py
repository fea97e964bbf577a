"""The standings of the library: what strategies reach on its instances, and their gaps to the best known flights."""

import csv
import hashlib
import importlib.metadata
import json
import os
import shutil
import subprocess
import sys
from collections import defaultdict
from concurrent.futures import ThreadPoolExecutor
from importlib.util import find_spec
from pathlib import Path

LIBRARY = Path("library")
STANDINGS = LIBRARY / "standings.csv"
COLUMNS = ["instance", "strategy", "version", "value"]
CHEAP = "rfs gfs uts uts-wide exact edf whittle mes max-age-first tour".split()
POLICIES = ["dqn", "ppo"]  # of python/examples/rl_train.py
LONGEST_S = 60  # for a mission of an earlier release
LEARNT = "python/examples/library_fly.py"
FLYERS = {name: (name, []) for name in CHEAP} | {
    f"horizon {steps}": ("horizon", ["--set", f"planner.horizon.iterations={steps}"]) for steps in [5, 20, 100]
} | {policy: (f"{LEARNT} --policy {policy}", []) for policy in POLICIES}


def command(*words, refused=None):
    """The JSON that `skysink library` prints; `refused` if it refuses its input."""
    words = ["skysink", "library", "--library", LIBRARY, *words, "--json"]
    done = subprocess.run([str(word) for word in words], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    if done.returncode == 2 and refused is not None:
        return refused
    if done.returncode:
        sys.exit(f"reproduce/run: {' '.join(map(str, words))}: {done.stderr.strip()}")
    return json.loads(done.stdout)


def python_version():
    """The version of Skysink that Python has; `None` without it."""
    return importlib.metadata.version("skysink") if find_spec("skysink") else None


def of_seeds(folder):
    """The runs of all seeds in a folder."""
    return sorted(folder.iterdir(), key=lambda run: int(run.name))


def flown_in_python(instance, policy, folder):
    """Flies a learnt policy over an instance, and returns the runs."""
    words = [sys.executable, LEARNT, instance, "--policy", policy, "--out", folder.parent]
    subprocess.run(words, check=True, stdout=subprocess.DEVNULL)
    return of_seeds(folder)


def is_better(measure, value, other):
    """Whether a value is better than another."""
    return value > other if measure == "score" else value < other


def gap(measure, value, reference):
    """The fraction of a value that separates it from a reference."""
    less, more = (value, reference) if measure == "score" else (reference, value)
    return 0.0 if less == more else 1.0 - less / more


def gaps_to_bounds():
    """The gaps of the best known flights to their bounds, of the instances that have one."""
    return [row["gap"] for row in command("list") if row["gap"] is not None]


def standings():
    """The rows of standings.csv, none without the file."""
    if not STANDINGS.exists():
        return []
    with open(STANDINGS) as file:
        return list(csv.DictReader(file))


def label_of(version):
    """Under what values stand: the version, or `unreleased` while the changelog has changes that no version has."""
    changes = Path("CHANGELOG.md").read_text().partition("## [Unreleased]")[2].partition("\n## [")[0]
    return "unreleased" if changes.strip() else version


def version_of(executable):
    """The version of an executable."""
    return subprocess.run([executable, "--version"], check=True, capture_output=True, text=True).stdout.split()[1]


def digest_of(executable):
    """What tells builds of a version apart: flights of another build are not those of this one."""
    return hashlib.sha256(Path(executable).read_bytes()).hexdigest()[:12]


def flown_by(executable, instance, seeds, strategy, options, folder):
    """The runs that the executable of an earlier release leaves; none if it cannot fly the instance in time."""
    runs = []
    for seed in range(1, seeds + 1) if seeds > 1 else [None]:
        run = folder / str(seed) if seed else folder
        words = [executable, "simulate", LIBRARY / f"{instance}.toml", "--strategy", strategy, *options]
        words += ["--seed", seed] * bool(seed) + ["--out", run, "--force"]
        try:
            done = subprocess.run([str(word) for word in words], capture_output=True, text=True, timeout=LONGEST_S)
        except subprocess.TimeoutExpired:
            return []
        if done.returncode == 2:
            return []
        if done.returncode:
            sys.exit(f"reproduce/run: {' '.join(map(str, words))}: {done.stderr.strip()}")
        runs.append(run)
    return runs


class Standings:
    """The values of the strategies of a version over all instances, flown where they are missing in `folder`: those of
    the `skysink` in PATH, or of the executable `earlier` of an earlier release, whose flights it verifies.
    """

    def __init__(self, folder, version, threads, earlier=None):
        self.earlier = earlier
        self.version = version_of(earlier) if earlier else label_of(version)
        self.folder = folder / f"{self.version}-{digest_of(earlier or shutil.which('skysink'))}"
        self.folder.mkdir(parents=True, exist_ok=True)
        self.seeds = {row["name"]: row["seeds"] for row in command("list")}
        self.instances = list(self.seeds)
        self.flyers = [flyer for flyer in FLYERS if not earlier or flyer not in POLICIES]
        if not earlier and python_version() != version:
            print(f"reproduce/run: {', '.join(POLICIES)}: left as they are, as Python has no skysink {version}", file=sys.stderr)
            self.flyers = [flyer for flyer in FLYERS if flyer not in POLICIES]
            is_stale = "unreleased" in [row["version"] for row in standings() if row["strategy"] in POLICIES]
            if self.version != "unreleased" and is_stale:
                sys.exit(f"reproduce/run: library: expected Python with skysink {version}, for {', '.join(POLICIES)}")
        pairs = [(instance, flyer) for instance in self.instances for flyer in self.flyers]
        with ThreadPoolExecutor(threads or os.cpu_count()) as pool:
            verdicts = dict(zip(pairs, pool.map(lambda pair: self.flown(*pair), pairs)))
        self.verdicts = {pair: verdict for pair, verdict in verdicts.items() if verdict}

    def run_folder(self, instance, flyer):
        """The folder of a run, or of those of all seeds."""
        return self.folder / f"{instance}-{flyer.replace(' ', '-')}"

    def flown(self, instance, flyer):
        """The verdict of a strategy over an instance; empty if it cannot fly there."""
        folder = self.run_folder(instance, flyer)
        kept = Path(f"{folder}.json")
        if kept.exists():
            return json.loads(kept.read_text())
        strategy, options = FLYERS[flyer]
        if self.earlier:
            runs = flown_by(self.earlier, instance, self.seeds[instance], strategy, options, folder)
            verdict = command("verify", *runs, refused={}) if runs else {}
        elif flyer in POLICIES:
            verdict = command("verify", *flown_in_python(instance, flyer, folder))
        else:
            verdict = command("fly", instance, strategy, *options, "--out", folder, "--force", refused={})
        if verdict:
            Path(f"{kept}.new").write_text(json.dumps(verdict))
            Path(f"{kept}.new").rename(kept)
        return verdict

    def submit_better(self):
        """Makes the best flight of an instance its best known one, if it is better."""
        known = {row["name"]: row["best"] for row in command("list")}
        for instance, best in known.items():
            own = [(flyer, verdict) for (name, flyer), verdict in self.verdicts.items() if name == instance]
            for flyer, verdict in own:
                if best is None or is_better(verdict["measure"], verdict["value"], best["value"]):
                    folder = self.run_folder(instance, flyer)
                    runs = [folder] if (folder / "slots.csv").exists() else of_seeds(folder)
                    strategy, options = FLYERS[flyer]
                    by = ", ".join([strategy, *(key.replace("=", " = ") for key in options[1::2])])
                    best = command("submit", *runs, "--by", by)

    def write(self):
        """Writes the values of this version into standings.csv, behind those of others."""
        is_outdated = {self.version} if self.earlier else {self.version, "unreleased"}
        kept = [row for row in standings() if row["version"] not in is_outdated or row["strategy"] not in self.flyers]
        own = [
            dict(zip(COLUMNS, [*pair, self.version, verdict["value"]])) for pair, verdict in self.verdicts.items()
        ]
        new = STANDINGS.with_suffix(".new")
        with open(new, "w") as file:
            writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
            writer.writeheader()
            writer.writerows(kept + own)
        new.rename(STANDINGS)


def gaps():
    """By version and strategy the gaps to the best known flights, by instance, from standings.csv."""
    best = {row["name"]: row["best"] for row in command("list")}
    found = defaultdict(dict)
    for row in standings():
        known = best[row["instance"]]
        own = gap(known["measure"], float(row["value"]), known["value"])
        found[row["version"], row["strategy"]][row["instance"]] = own
    return found


def in_order(versions):
    """The distinct versions, the newest last."""

    def age(version):
        number, _, candidate = version.partition("-")
        return (1,) if version == "unreleased" else (0, *map(int, number.split(".")), not candidate, candidate)

    return sorted(set(versions), key=age)


def columns(gaps):
    """The heads of the columns of a table of gaps with what each has by strategy: a column for each version, behind those
    before it the newest over the same instances.
    """
    versions = in_order(version for version, _ in gaps)
    newest = versions[-1]
    found = {}
    for version in versions:
        own = {flyer: gaps.get((version, flyer), {}) for flyer in FLYERS}
        found[version] = {flyer: list(values.values()) for flyer, values in own.items()}
        if version != newest:
            found[f"{newest}, the same"] = {
                flyer: [value for instance, value in gaps.get((newest, flyer), {}).items() if instance in own[flyer]]
                for flyer in FLYERS
            }
    return found


def better_before(gaps, flyer):
    """Of the instances that an earlier version flies, on how many its flight is better than that of the newest."""
    *earlier, newest = in_order(version for version, own in gaps if own == flyer)
    counts = []
    for version in earlier:
        values, others = gaps[version, flyer], gaps[newest, flyer]
        same = [instance for instance in values if instance in others]
        better = sum(values[instance] < others[instance] for instance in same)
        counts.append(f"{version} is better on {better} of {len(same)}")
    return "; ".join(counts)
