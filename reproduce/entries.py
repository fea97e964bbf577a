"""The tables and figures of the book: a function for each, which computes it with the executables in PATH.

A table is returned as the Markdown between its markers in the book, a figure as the path of its PNG.
"""

import csv
import json
import os
import random
import subprocess
import sys
from collections import defaultdict
from dataclasses import dataclass
from math import floor, inf, log10, sqrt
from pathlib import Path
from statistics import mean, median, stdev
from typing import Callable

import library

OUT = Path("runs/reproduce")
ENTRIES = {}
options = None  # the command line of `run`

BANDWIDTH = "link.bandwidth_hz"
WIDE, NARROW = {BANDWIDTH: 5e6}, {BANDWIDTH: 5e3}
SIDE = "area.side_m"
RATE = "sensors.sampling_bps"


@dataclass
class Entry:
    """A table or figure of the book."""

    function: Callable
    minutes: float  # of CPU time on a virtual machine, after the entries before it
    is_timing: bool
    needs: str | None  # an option of `run`


def entry(name, minutes, *, is_timing=False, needs=None):
    """Registers a table or figure under the name of its markers in the book."""

    def register(function):
        ENTRIES[name] = Entry(function, minutes, is_timing, needs)
        return function

    return register


def run(*words):
    """Runs a command, and returns its standard output."""
    return subprocess.run([str(word) for word in words], check=True, stdout=subprocess.PIPE, text=True).stdout


# Missions and their statistics


class Missions:
    """The results of the missions of a sweep, a row for each, and a part of them."""

    def __init__(self, rows):
        self.rows = rows

    def where(self, **keys):
        """The missions with these values in these columns."""
        return self.at(keys)

    def at(self, keys):
        """The missions with these values of these keys."""
        return Missions([row for row in self.rows if all(is_value(row[key], value) for key, value in keys.items())])

    def values(self, metric):
        """The metric in each mission that has it."""
        return [float(row[metric]) for row in self.rows if row[metric]]

    def fields(self):
        """The number of fields: seeds are counted from 1, or each has a list."""
        return len({(row["seed"], row.get("sensors.file")) for row in self.rows})

    def best_known(self):
        """The least loss in each field."""
        least = defaultdict(lambda: 1.0)
        for row in self.rows:
            least[row["seed"]] = min(least[row["seed"]], float(row["loss_rate"]))
        return list(least.values())

    def loss(self, strategy):
        """The loss of a strategy as a cell. `best-known` and `bound` are of all strategies."""
        if strategy == "best-known":
            return cell(self.best_known())
        if strategy == "bound":
            return cell(self.where(strategy="offline").values("loss_bound"))
        return cell(self.where(strategy=strategy).values("loss_rate"))


def is_value(text, value):
    """Whether the text in a column is this number or word."""
    return text == value if isinstance(value, str) else float(text) == value


def sweep(name, folder=Path("scenarios/sweeps")):
    """The missions of FOLDER/NAME.toml, simulated where they are missing."""
    results = OUT / "sweeps" / name
    run("skysink", "sweep", folder / f"{name}.toml", "--out", results, "--threads", options.threads)
    with open(results / "results.csv") as file:
        return Missions(list(csv.DictReader(file)))


def plot(name, *words):
    """Draws a picture of finished sweeps or runs, and returns the path of its PNG."""
    folder = OUT / "pictures" / name
    run("skysink", "plot", *words, "--out", folder)
    return next(folder.glob("*.png"))


def error_of(values):
    """The standard error of the mean."""
    return stdev(values) / sqrt(len(values)) if len(values) > 1 else 0.0


LEAST = 5e-5  # what four digits show


def cell(values, sign=""):
    """Mean and standard error, with the digits that the error leaves, at most four."""
    if not values:
        return ""
    if not any(values):
        return "0"
    error = error_of(values)
    if max(map(abs, values)) < LEAST or abs(mean(values)) < LEAST and (not sign or error < LEAST):
        return "< 0.0001"
    digits = min(4, max(3, -floor(log10(error)))) if error > 0.0 else 4
    margin = f" ± {error:.{digits}f}" if error >= LEAST else ""
    return f"{mean(values):{sign}.{digits}f}{margin}"


def version():
    """The version of the executable, with its name."""
    return run("skysink", "--version").split(" (")[0].strip().replace("skysink", "Skysink")


def table(name, head, rows, seeds):
    """A table in Markdown, with its version, seeds and command below."""
    lines = [head, ["---"] * len(head), *rows]
    text = "\n".join(f"| {' | '.join(str(word) for word in line)} |" for line in lines)
    return f"{text}\n\n*{version()}, {seeds}: `reproduce/run {name}`*"


# The paper's comparison

ONE_SLOT = ["rfs", "gfs", "uts", "uts-wide", "exact"]


def fields_of(cheap, ahead, columns):
    """The seeds of a table with columns of two sweeps."""
    return f"seeds 1 to {cheap.fields()}; 1 to {ahead.fields()} for {columns}"


@entry("area", 25)
def area():
    """The loss against the area, for both radios."""
    cheap, sparse = sweep("loss-area"), sweep("loss-sparse")
    ahead, ahead_sparse = sweep("loss-area-ahead"), sweep("loss-sparse-ahead")
    searched = ["tour", "horizon", "best-known", "bound"]

    def rows(radio, sides, cheap, ahead, keys):
        for side in sides:
            here, there = cheap.at({SIDE: side} | keys), ahead.at({SIDE: side} | keys)
            losses = [here.loss(strategy) for strategy in ONE_SLOT] + [there.loss(strategy) for strategy in searched]
            yield [f"{radio}, {side} m", *losses]

    lines = [
        *rows("5 MHz", [100, 150, 200, 250, 300], cheap, ahead, WIDE),
        *rows("5 MHz", [400, 500, 700, 1000], sparse, ahead_sparse, {}),
        *rows("5 kHz", [100, 150, 200, 250, 300], cheap, ahead, NARROW),
    ]
    head = ["W, side", *ONE_SLOT, "tour", "horizon", "best known", "lower bound"]
    return table("area", head, lines, fields_of(cheap, ahead, "the last four columns"))


@entry("bits", 0.1)
def bits():
    """The bits delivered per waypoint."""
    many, few = sweep("loss-area"), sweep("letter")
    rows = []
    for radio, missions in [("5 MHz", many.at(WIDE)), ("5 kHz", many.at(NARROW)), ("2 kHz", few.at({BANDWIDTH: 2e3}))]:
        for side in [100, 200, 300]:
            here = missions.at({SIDE: side})
            each = {name: here.where(strategy=name).values("bits_per_waypoint") for name in ["rfs", "gfs", "uts"]}
            cells = [f"{mean(values):.0f} ± {error_of(values):.0f}" for values in each.values()]
            ratios = [f"{mean(each['uts']) / mean(each[other]):.2f}" for other in ["rfs", "gfs"]]
            rows.append([f"{radio}, {side} m", *cells, *ratios])
    head = ["W, side", "rfs", "gfs", "uts", "uts ÷ rfs", "uts ÷ gfs"]
    return table("bits", head, rows, fields_of(many, few, "2 kHz"))


@entry("rate", 23)
def rate():
    """The loss against the sampling rate."""
    cheap, ahead = sweep("loss-rate"), sweep("loss-rate-ahead")
    rows = []
    for radio, keys in [("5 MHz", WIDE), ("5 kHz", NARROW)]:
        for rate_bps in [100, 200, 400, 600, 800]:
            here, there = (missions.at({RATE: rate_bps} | keys) for missions in (cheap, ahead))
            losses = [here.loss(strategy) for strategy in ONE_SLOT]
            losses += [there.loss(strategy) for strategy in ["tour", "horizon", "bound"]]
            rows.append([f"{radio}, {rate_bps} bit/s", *losses])
    head = ["W, rate", *ONE_SLOT, "tour", "horizon", "lower bound"]
    return table("rate", head, rows, fields_of(cheap, ahead, "the last three columns"))


@entry("time", 2.5)
def running_time():
    """The loss against the mission time."""
    missions = sweep("loss-time")
    strategies = ["rfs", "gfs", "uts", "exact", "tour", "max-age-first", "horizon"]
    rows = [
        [f"{radio}, {slots} slots", *(missions.at({"slots": slots} | keys).loss(strategy) for strategy in strategies)]
        for radio, keys in [("5 MHz", WIDE), ("5 kHz", NARROW)]
        for slots in [200, 400, 600]
    ]
    return table("time", ["W, mission", *strategies], rows, f"seeds 1 to {missions.fields()}")


@entry("acceleration", 5)
def acceleration():
    """The loss against the area, with a UAV that accelerates and noise by its density."""
    missions = sweep("acceleration")
    strategies = [*ONE_SLOT, "tour", "horizon"]
    rows = [
        [f"{radio}, {side} m", *(missions.at({SIDE: side} | keys).loss(strategy) for strategy in strategies)]
        for radio, keys in [("5 MHz", WIDE), ("5 kHz", NARROW)]
        for side in [100, 200, 300, 1000]
    ]
    return table("acceleration", ["W, side", *strategies], rows, f"seeds 1 to {missions.fields()}")


@entry("look-ahead", 0)
def look_ahead():
    """The loss of every strategy at five settings."""
    columns = [
        ("300 m", "loss-sparse", {SIDE: 300}),
        ("500 m", "loss-sparse", {SIDE: 500}),
        ("1 000 m", "loss-sparse", {SIDE: 1000}),
        ("100 m, 600 bit/s", "loss-rate", {RATE: 600} | WIDE),
        ("200 m, 5 kHz", "loss-area", {SIDE: 200} | NARROW),
    ]
    cheap = [sweep(name).at(keys) for _, name, keys in columns]
    ahead = [sweep(f"{name}-ahead").at(keys) for _, name, keys in columns]
    rows = [
        [label, *(missions.loss(strategy) for missions in ahead)]
        for label, strategy in [("lower bound", "bound"), ("best known", "best-known")]
        + [(f"`{name}`", name) for name in ["horizon", "offline", "tour", "drift-plus-penalty", "hover"]]
    ]
    others = "mes edf whittle max-age-first max-weight exact uts gfs".split()
    rows += [[f"`{strategy}`", *(missions.loss(strategy) for missions in cheap)] for strategy in others]
    head = ["", *(label for label, _, _ in columns)]
    return table("look-ahead", head, rows, fields_of(cheap[0], ahead[0], "the first seven rows"))


# Beyond the paper


@entry("altitude-gain", 7)
def altitude_gain():
    """The loss in three dimensions, at fixed and free altitudes."""
    missions, ahead = sweep("altitude-free"), sweep("altitude-ahead")
    start = {"uav.altitude_m": 50, "uav.altitude": "free"}
    heights = [20, 50, 80, 120]
    rows = []
    for environment in ["suburban", "urban", "dense-urban", "high-rise"]:
        here = missions.at({"link.environment": environment})
        fixed = [here.at({"uav.altitude": "fixed", "uav.altitude_m": height}).loss("uts-wide") for height in heights]
        free = [here.at(start).loss(strategy) for strategy in ["uts-wide", "gfs"]]
        there = ahead.at({"link.environment": environment})
        searched = [there.at({"uav.altitude": kind}).loss("horizon") for kind in ["fixed", "free"]]
        rows.append([environment, *fixed, *free, *searched])
    head = ["environment", *(f"uts-wide, {height} m" for height in heights)]
    head += ["uts-wide, free", "gfs, free", "horizon, 50 m", "horizon, free"]
    return table("altitude-gain", head, rows, fields_of(missions, ahead, "the last two columns"))


@entry("return-cost", 28)
def return_cost():
    """The loss of UAVs that return to a base, by battery and charger."""
    missions, ahead = sweep("return"), sweep("return-ahead")
    strategies = ["gfs", "exact", "edf", "mes", "tour"]
    rows = []
    for side in [300, 1000]:
        for label, capacity_j, charge_w in [
            ("no limit", 1e9, 1000),
            ("10 min, 200 W", 112000, 200),
            ("20 min, 200 W", 224000, 200),
            ("10 min, 1 000 W", 112000, 1000),
            ("20 min, 1 000 W", 224000, 1000),
        ]:
            keys = {SIDE: side, "uav.battery.capacity_j": capacity_j, "base.charge_w": charge_w}
            here = missions.at(keys)
            losses = [here.loss(strategy) for strategy in strategies]
            rows.append([f"{side} m, {label}", *losses, ahead.at(keys).loss("horizon")])
    head = ["side, battery, charger", *strategies, "horizon"]
    return table("return-cost", head, rows, f"seeds 1 to {missions.fields()}")


def weighted_fields(count):
    """Missions over random fields in which one sensor node in five has the weight 10, and over the same without weights."""
    folder = OUT / "weighted"
    folder.mkdir(parents=True, exist_ok=True)
    names = {kind: [f"{kind}-{field}.csv" for field in range(1, count + 1)] for kind in ["heavy", "equal"]}
    for field, (heavy, equal) in enumerate(zip(*names.values()), 1):
        drawn = random.Random(field)
        spots = [f"{drawn.uniform(0, 300):.1f},{drawn.uniform(0, 300):.1f}" for _ in range(200)]
        weights = [10 if drawn.random() < 0.2 else 1 for _ in spots]
        (folder / equal).write_text("\n".join(["x_m,y_m", *spots, ""]))
        rows = [f"{spot},{weight}" for spot, weight in zip(spots, weights)]
        (folder / heavy).write_text("\n".join(["x_m,y_m,weight", *rows, ""]))
    scenario = Path("scenarios/weighted/weighted.toml").read_text()
    (folder / "weighted.toml").write_text(scenario.replace('"sensors.csv"', f'"{names["heavy"][0]}"'))
    files = [name for kind in names.values() for name in kind]
    lines = [
        'scenario = "weighted.toml"',
        'strategies = ["gfs", "uts", "exact", "edf", "tour", "horizon"]',
        "seeds = 1",
        "[axes]",
        '"planner.horizon.iterations" = [500]',
        f'"sensors.file" = {json.dumps(files)}',
    ]
    (folder / "models-weights.toml").write_text("\n".join(lines))
    missions = sweep("models-weights", folder)
    return (Missions([row for row in missions.rows if row["sensors.file"] in kind]) for kind in names.values())


@entry("models", 14)
def models():
    """The loss under models that are off by default."""
    strategies = ["gfs", "uts", "exact", "edf", "tour", "horizon"]
    knowledge, learnt = sweep("knowledge"), sweep("learnt-rates")
    arrivals, sight, noise = (sweep(f"models-{name}") for name in ["arrivals", "los", "noise"])
    heavy, equal = weighted_fields(20)
    cases = [
        ("all queues known, 1 000 m", knowledge.at({"planner.knowledge": "oracle"}), "loss_rate"),
        ("queues estimated", knowledge.at({"planner.knowledge": "estimated"}), "loss_rate"),
        ("rates learnt, too", learnt, "loss_rate"),
    ]
    for label, model in [("constant arrivals, 500 m", "constant"), ("packets", "poisson"), ("bursts", "on-off")]:
        cases.append((label, arrivals.at({"sensors.arrivals.model": model}), "loss_rate"))
    for label, length_m in [("line of sight redrawn", 0), ("correlated over 200 m", 200)]:
        cases.append((label, sight.at({"link.los_correlation_m": length_m}), "loss_rate"))
    for label, side, bandwidth_hz in [
        ("noise by density, 5 kHz, 200 m", 200, 5e3),
        ("5 kHz, 300 m", 300, 5e3),
        ("2 kHz, 200 m", 200, 2e3),
    ]:
        cases.append((label, noise.at({SIDE: side, BANDWIDTH: bandwidth_hz}), "loss_rate"))
    cases.append(("without weights, η", equal, "loss_rate"))
    cases.append(("with weights, η", heavy, "loss_rate"))
    cases.append(("with weights, η_w", heavy, "weighted_loss_rate"))
    rows = [
        [label, missions.fields(), *(cell(missions.where(strategy=strategy).values(metric)) for strategy in strategies)]
        for label, missions, metric in cases
    ]
    return table("models", ["model", "n", *strategies], rows, "seeds 1 to n")


@entry("wrong-link", 16)
def wrong_link():
    """What plans lose by a wrong law of the link: the loss with the true one, and paired changes."""
    sight, snr, fading = sweep("wrong-los"), sweep("wrong-snr"), sweep("wrong-k")
    strategies = ["gfs", "uts-wide", "exact", "horizon"]
    environment, offset, factor = (f"planner.link.{key}" for key in ["environment", "snr_offset_db", "k_db"])
    cases = []
    for altitude, link in [("fixed", "dense urban, 50 m"), ("free", "dense urban, free altitude")]:
        here = sight.at({"uav.altitude": altitude})
        others = ["suburban", "urban", "high-rise"]
        cases.append((link, here, environment, "dense-urban", [(f"as {other}", other) for other in others]))
    cases.append(("5 kHz, 300 m", snr, offset, 0, [(f"{shift:+d} dB", shift) for shift in [-10, -3, 3, 10]]))
    taken = [("as Rayleigh", -inf), ("as K = 20 dB", 20)]
    cases.append(("the same with Rician fading, K = 0 dB", fading, factor, 0, taken))

    def change(known, wrong):
        before, after = ({row["seed"]: float(row["loss_rate"]) for row in part.rows} for part in [known, wrong])
        return cell([after[seed] - before[seed] for seed in before], "+")

    rows = []
    for link, missions, key, true, wrong in cases:
        known = missions.at({key: true})
        rows.append([link, *(known.loss(strategy) for strategy in strategies)])
        for label, value in wrong:
            mistaken = missions.at({key: value})
            changes = (change(known.where(strategy=name), mistaken.where(strategy=name)) for name in strategies)
            rows.append([label, *changes])
    return table("wrong-link", ["the link, and what plans take it for", *strategies], rows, f"seeds 1 to {snr.fields()}")


@entry("fleet", 0.5)
def fleet():
    """The loss of one to three UAVs, by how they share a field."""
    missions = sweep("fleet")
    modes = ["independent", "sequential", "partition"]
    fleets = [(uavs, mode) for uavs in [2, 3] for mode in modes]
    each = [missions.at({"uav.count": uavs, "uav.coordination": mode}) for uavs, mode in [(1, modes[0]), *fleets]]
    strategies = ["uts", "edf", "mes", "tour"]
    rows = [[f"`{strategy}`", *(here.loss(strategy) for here in each)] for strategy in strategies]
    head = ["", "one UAV", *(f"{uavs}, `{mode}`" for uavs, mode in fleets)]
    return table("fleet", head, rows, f"seeds 1 to {missions.fields()}")


@entry("fleet-load", 7)
def fleet_load():
    """The loss of three UAVs that cannot serve all in time, by how they share the field."""
    missions = sweep("fleet-load")
    rows = []
    for strategy in "uts gfs max-age-first whittle edf mes tour horizon".split():
        here = missions.where(strategy=strategy)
        shared, cut = (here.at({"uav.coordination": mode}) for mode in ["sequential", "partition"])
        changes = [after - before for before, after in zip(shared.values("loss_rate"), cut.values("loss_rate"))]
        rows.append([f"`{strategy}`", shared.loss(strategy), cut.loss(strategy), cell(changes, "+")])
    head = ["three UAVs", "`sequential`", "`partition`", "paired difference"]
    return table("fleet-load", head, rows, f"seeds 1 to {missions.fields()}")


@entry("ages", 4)
def ages():
    """The mean age and the loss by what is minimised."""
    missions = sweep("ages")
    cases = [(f"`{strategy}`", strategy, "loss") for strategy in ["max-age-first", "whittle", "tour"]]
    cases += [(f'`horizon`, `"{objective}"`', "horizon", objective) for objective in ["loss", "age"]]

    def of(strategy, objective):
        return missions.at({"strategy": strategy, "planner.objective": objective})

    def seconds(values):
        return f"{mean(values):.1f} ± {error_of(values):.1f}"

    least = of("horizon", "age").values("aoi_mean_s")
    rows = []
    for label, strategy, objective in cases:
        here = of(strategy, objective)
        ages_s = here.values("aoi_mean_s")
        changes = [best - age for best, age in zip(least, ages_s)]
        rows.append([label, seconds(ages_s), here.loss(strategy), seconds(changes) if any(changes) else ""])
    head = ["", "`aoi_mean_s`", "loss rate", '`"age"` less this [s]']
    seeds = f"seeds {missions.rows[0]['seed']} to {missions.rows[-1]['seed']}"
    return table("ages", head, rows, seeds)


@entry("ablation", 11)
def ablation():
    """What parts and search steps of `horizon` change."""
    parts, steps = sweep("ablation"), sweep("ablation-steps")
    columns = [{SIDE: 300}, {SIDE: 1000}]
    settings = [parts.at(keys) for keys in columns]
    everything = [missions.at({"planner.horizon.without": "nothing"}) for missions in settings]
    rows = [["all parts", *(missions.loss("horizon") for missions in everything)]]
    for part in ["annealing", "groups"]:
        cells = []
        for missions, whole in zip(settings, everything):
            without = missions.at({"planner.horizon.without": part}).values("loss_rate")
            changes = [loss - all_parts for loss, all_parts in zip(without, whole.values("loss_rate"))]
            cells.append(cell(changes, "+"))
        rows.append([f"without {part}, change", *cells])
    for count in [0, 100, 1000]:
        at_steps = steps.at({"planner.horizon.iterations": count})
        rows.append([f"{count} steps", *(at_steps.at(keys).loss("horizon") for keys in columns)])
    head = ["`horizon`, 5 kHz", "300 m", "1 000 m"]
    return table("ablation", head, rows, f"seeds 1 to {parts.fields()}")


MISSIONS = 300  # of the benchmark, on each map


@entry("harvesting", 7, needs="harvesting")
def harvesting():
    """The public data harvesting benchmark."""
    script = "python/benchmarks/harvesting.py"
    processes = options.threads or os.cpu_count()
    text = run(sys.executable, script, options.harvesting, "--missions", MISSIONS, "--processes", processes)
    rows = []
    for line in text.splitlines():
        cells = [word.strip() for word in line.strip("|").split("|")]
        if line.startswith("| ") and "budget" not in line:
            if cells[1] == "missions":
                name = cells[0]
            else:
                rows.append([name, *cells])
    head = ["map", "UAVs", "missions", "landed [%]", "collected [%]", "both [%]"]
    return table("harvesting", head, rows, f"missions 700000 to {700000 + MISSIONS - 1}")


@entry("rounds", 135, is_timing=True, needs="instances")
def rounds():
    """Rounds over disks on public instances, one and several; limited by time."""
    script = [sys.executable, "python/benchmarks/cetsp.py", options.instances]
    times, seeds = [1, 10, 100], [10, 10, 2]
    single = run(*script, "--seconds", *times, "--seeds", *seeds, "--bound", 60)
    several = run(*script, "--uavs", 2, 3, 5, "--seconds", 4)

    def cells(text):
        lines = [line.strip("|").split("|") for line in text.splitlines() if line.startswith("| ")]
        return {name.strip(): [word.strip() for word in words] for name, *words in lines[1:]}

    fleets = cells(several)
    rows = [[name, *row, *fleets[name]] for name, row in cells(single).items()]
    head = ["instance", "disks", "points", *(f"{time} s ÷ best known" for time in times), "least ÷"]
    head += ["bound ÷ best known", "published bound ÷"]
    head += [word for count in [2, 3, 5] for word in (f"U = {count}: longest ÷ best known", "÷ bound")]
    summary = [line for text in [single, several] for line in text.splitlines() if "median" in line]
    note = f"means of {seeds[0]} seeds, at {times[-1]} s of {seeds[-1]}, 60 s for the bound, 4 s for several rounds"
    return table("rounds", head, rows, note) + "\n\n" + "  \n".join(summary)


@entry("library", 16)
def standings():
    """The mean gap of strategies to the best known flights of the library, by version; writes library/standings.csv."""
    folder = OUT / "library"
    if options.earlier:
        library.Standings(folder, None, options.threads, options.earlier).write()
    own = library.Standings(folder, version().split()[1], options.threads)
    if not options.check:
        own.submit_better()
    own.write()
    gaps = library.gaps()
    columns = library.columns(gaps)

    def percent(values):
        return f"{100 * mean(values):.1f} ± {100 * error_of(values):.1f} ({len(values)})" if values else ""

    rows = [[f"`{flyer}`", *(percent(values[flyer]) for values in columns.values())] for flyer in library.FLYERS]
    ahead = list(gaps[own.version, "horizon 100"].values())
    medians = [f"{100 * median(values):.1f} %" for values in [ahead, library.gaps_to_bounds()]]
    note = f"in brackets the number of instances; medians of {own.version}: `horizon 100` {medians[0]}, best known to bound "
    note += f"{medians[1]}; with `horizon 100` {library.better_before(gaps, 'horizon 100')}"
    return table("library", ["gap [%]", *columns], rows, note)


# Figures


@entry("loss-area", 0)
def loss_area():
    """The loss against the area at 5 MHz."""
    sweep("loss-area")
    words = ["--x", SIDE, "--x-label", "side of the area [m]", "--where", "link.bandwidth_hz=5e6"]
    title = "Data loss against the area · W = 5 MHz, the paper's"
    return plot("loss-area", OUT / "sweeps/loss-area", *words, "--title", title, "--strategies", ",".join(ONE_SLOT))


@entry("loss-sparse", 0)
def loss_sparse():
    """The loss in sparse fields, with the best known and the bound."""
    sweep("loss-sparse-ahead")
    words = ["--x", SIDE, "--x-label", "side of the area [m]", "--bounds"]
    words += ["--strategies", "tour,round-robin,max-age-first,horizon"]
    words += ["--title", "Data loss in sparse fields · W = 5 MHz, the paper's"]
    return plot("loss-sparse", OUT / "sweeps/loss-sparse-ahead", *words)


@entry("map-sparse", 0.3)
def map_sparse():
    """The trajectories of eight strategies over one field."""
    runs = []
    for strategy in "rfs gfs uts uts-wide exact tour max-age-first horizon".split():
        runs.append(OUT / "map-sparse" / strategy)
        keys = ["slots=500", f"{SIDE}=300", "planner.horizon.iterations=2000"]
        words = [word for key in keys for word in ("--set", key)]
        words += ["--out", runs[-1], "--force"]
        run("skysink", "simulate", "scenarios/letter.toml", "--strategy", strategy, *words)
    return plot("map-sparse", *runs, "--title", "Trajectories over 500 slots · 300 m × 300 m")


@entry("objectives", 0.3)
def objectives():
    """The trajectories of `horizon` over one field, by what it minimises."""
    runs = []
    for objective in "loss age peak-age collect".split():
        runs.append(OUT / "objectives" / objective)
        keys = ["slots=300", f"{SIDE}=500", "sensors.count=60", "sensors.sampling_bps=[20.0, 600.0]"]
        keys += ["planner.horizon.iterations=2000", f'planner.objective="{objective}"']
        words = [word for key in keys for word in ("--set", key)]
        words += ["--out", runs[-1], "--force"]
        run("skysink", "simulate", "scenarios/letter.toml", "--strategy", "horizon", *words)
    return plot("objectives", *runs, "--title", "Trajectories over 300 slots · 500 m × 500 m")


@entry("mixed-fleet", 0.2)
def mixed_fleet():
    """The trajectories of a slow and a fast UAV that divide a field."""
    flown = OUT / "mixed-fleet"
    keys = ["slots=400", f"{SIDE}=600", "sensors.count=120", "planner.horizon.iterations=500"]
    keys += ["uav.each=[{max_speed_mps=10.0},{max_speed_mps=30.0}]"]
    words = [word for key in keys for word in ("--set", key)]
    words += ["--out", flown, "--force"]
    run("skysink", "simulate", "scenarios/letter.toml", "--strategy", "horizon", *words)
    return plot("mixed-fleet", flown, "--title", "UAV 0 at 10 m/s, UAV 1 at 30 m/s · 400 slots")


@entry("altitude", 0)
def altitude():
    """The loss against the altitude in a dense urban environment."""
    sweep("altitude-free")
    words = ["--x", "uav.altitude_m", "--x-label", "altitude [m]", "--by", "uav.altitude"]
    words += ["--strategies", "uts-wide", "--where", "link.environment=dense-urban"]
    words += ["--title", "Data loss against altitude · dense-urban"]
    return plot("altitude", OUT / "sweeps/altitude-free", *words)


@entry("return", 0)
def return_figure():
    """The loss against the power of the charger, by battery."""
    sweep("return")
    words = ["--x", "base.charge_w", "--x-label", "charger [W]", "--by", "uav.battery.capacity_j"]
    words += ["--where", f"{SIDE}=1000", "--strategies", "mes,tour"]
    return plot("return", OUT / "sweeps/return", *words)


@entry("plot", 0)
def plot_example():
    """The example of the page on figures."""
    sweep("letter")
    return plot("plot", OUT / "sweeps/letter", "--x", SIDE, "--where", "link.bandwidth_hz=5e3", "--width", "88mm")
