"""Flies the public data harvesting benchmark (Bayerlein, Theile, Caccamo, Gesbert 2021), and replays it in the authors' code.

The random missions are drawn by the authors' environment. Skysink plans them with `horizon` and `planner.objective =
"collect"`, on a grid; the flown moves are then replayed in the authors' environment, whose metrics are printed: landed,
collection ratio, and both (their product in each mission), in percent with standard errors, by UAVs, and for one by budget.

CHECKOUT is a checkout of github.com/hbayerlein/uav_data_harvesting, of which nothing is copied.

Usage: python python/benchmarks/harvesting.py CHECKOUT [--map NAME]... [--uavs U]... [--missions N] [--seed S]
       [--iterations I] [--processes P] [--actions DIR]          Exit codes: 0 done, 1 a mission failed, 2 usage.
"""

import argparse
import copy
import json
import os
import sys
import tempfile
import time
import types
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np
from outlines import outlines

import skysink

HOVER, LAND = 0, 5
MOVES = {(0, 0): HOVER, (0, 1): 1, (1, 0): 2, (0, -1): 3, (-1, 0): 4}  # steps east and, in their rows, down
CELL_M = 10.0
SEPARATION_M = 0.7 * CELL_M  # less than that of two moves around a corner, one after the other
SLOTS = 4  # of an action, each with a step of communication
UNIT_BITS = 1e6  # their unit of data: what log2(1 + SNR) = 1 carries in a step, here 4 MHz · 0.25 s
NOISE_W, REFERENCE_GAIN = 1e-13, 1e-6
PAPER = {"manhattan32": (99.4, 88.0, 87.5), "urban50": (98.2, 88.2, 81.1)}  # their table 4, one to three UAVs
BUDGETS = 4  # classes of equal width


class NoStatistics:
    """Stands for their recorder of statistics, which needs TensorFlow."""

    def __getattr__(self, name):
        return lambda *_args, **_kwargs: None


class Reference:
    """The authors' environment of a map, without TensorFlow."""

    def __init__(self, checkout, name):
        sys.modules.setdefault("tensorflow", types.ModuleType("tensorflow"))
        sys.path.insert(0, str(checkout))
        from src.Grid import Grid
        from src.Physics import Physics

        text = (checkout / "config" / f"{name}.json").read_text()
        self.config = json.loads(text, object_hook=lambda entries: types.SimpleNamespace(**entries))
        channel = self.config.physics_params.channel_params
        for params in (self.config.grid_params, channel):
            params.map_path = str(checkout / params.map_path)
        self.grid = Grid(self.config.grid_params, NoStatistics())
        self.physics = Physics(self.config.physics_params, NoStatistics())
        self.cells = self.grid.map_image.start_land_zone.shape[0]

    def mission(self, seed):
        """A random mission: their initial state."""
        np.random.seed(seed)
        state = copy.deepcopy(self.grid.init_episode())
        self.physics.reset(state)
        return state

    def replay(self, state, actions, seed):
        """Flies the actions of each UAV; returns landed, collection ratio, their product, and refused moves."""
        from src.base.GridActions import GridActions

        np.random.seed(seed)
        theirs = [GridActions.HOVER, GridActions.NORTH, GridActions.EAST, GridActions.SOUTH, GridActions.WEST]
        theirs.append(GridActions.LAND)
        state = copy.deepcopy(state)
        self.physics.reset(state)
        step = 0
        while not state.all_terminal:
            for state.active_agent in range(state.num_agents):
                if not state.terminal:
                    flown = actions[state.active_agent]
                    state = self.physics.step(theirs[flown[step] if step < len(flown) else HOVER])
            step += 1
        physics = self.physics
        metrics = physics.has_landed(), physics.get_collection_ratio(), physics.get_cral()
        return *map(float, metrics), float(physics.get_boundary_counter())


def field_of(reference, name, folder):
    """Writes the scenario of a map, and returns its path."""
    cells = reference.grid.map_image
    no_fly, buildings, landing = (np.flipud(colour) for colour in (cells.nfz, cells.obstacles, cells.start_land_zone))
    places = np.argwhere(landing)[:, ::-1] + 0.5
    start = places[np.hypot(*(places - reference.cells / 2).T).argmin()]  # the missions have their own

    def polygons_m(colour):
        return [[[CELL_M * along for along in corner] for corner in polygon] for polygon in outlines(colour)]

    side_m = CELL_M * reference.cells
    text = f"name = '{name}'\n[area]\nwidth_m = {side_m}\nheight_m = {side_m}\n[uav]\nstart_m = {(CELL_M * start).tolist()}\n"
    text += f"[base]\nareas_m = {polygons_m(landing)}\n"
    text += "".join(f"[[area.no_fly]]\npolygon_m = {polygon}\n" for polygon in polygons_m(no_fly))
    # Their buildings can be flown over and block every link that crosses them, whatever their height.
    text += "".join(f"[[area.building]]\npolygon_m = {polygon}\nheight_m = 10.0\n" for polygon in polygons_m(buildings))
    path = folder / f"{name}.toml"
    path.write_text(text)
    return path


def middle_m(cell, cells):
    """The middle of a cell: their rows count from the north."""
    x, y = cell
    return [CELL_M * (x + 0.5), CELL_M * (cells - y - 0.5)]


def keys_of(reference, state, sensors, seed, iterations):
    """The keys of a mission."""
    channel = reference.config.physics_params.channel_params
    cells = reference.cells
    # Their signal-to-noise ratio at the edge of the map fixes that at 1 m.
    edge_m = 0.5**0.5 * CELL_M * cells
    snr = 10 ** (channel.cell_edge_snr / 10) * edge_m**channel.los_path_loss_exp
    own = [SLOTS * (int(budget) - 1) for budget in state.movement_budgets]
    slots = max(own)
    step_s = 1.0 / SLOTS
    several = {
        "uav.count": len(own),
        "uav.coordination": "sequential",
        "uav.starts_m": [middle_m(position, cells) for position in state.positions],
        "uav.endurances_s": [slots * step_s for slots in own],
        "uav.separation_m": SEPARATION_M,
    }
    return {
        **(several if len(own) > 1 else {"uav.start_m": middle_m(state.positions[0], cells)}),
        "seed": seed,
        "slots": slots,
        "slot_s": step_s,
        "sensors.file": str(sensors),
        "sensors.sampling_bps": 0.0,
        "sensors.capacity_bits": int(30 * UNIT_BITS),
        "uav.altitude_m": channel.uav_altitude,
        "uav.max_speed_mps": CELL_M,
        "uav.moves": "grid",
        "uav.cell_m": CELL_M,
        "uav.must_land": True,
        "uav.endurance_s": slots * step_s,
        "link.model": "buildings",
        "link.bandwidth_hz": UNIT_BITS / step_s,
        "link.tx_power_w": snr * NOISE_W / REFERENCE_GAIN,
        "link.noise_dbm": -100.0,
        "link.reference_gain_db": -60.0,
        "link.snr_gap_db": 0.0,
        "link.los_exponent": channel.los_path_loss_exp,
        "link.nlos_exponent": channel.nlos_path_loss_exp,
        "link.nlos_extra_db": 0.0,
        "link.shadowing_db": [channel.los_shadowing_variance**0.5, channel.nlos_shadowing_variance**0.5],
        "link.comm_radius_m": 2.0 * edge_m,
        "link.comm_s": step_s,
        "link.resource_blocks": 1,
        "planner.strategy": "horizon",
        "planner.objective": "collect",
        "planner.horizon.iterations": iterations,
    }


def sensors_csv(state, cells):
    lines = ["x_m,y_m,queue_bits"]
    for device in state.device_list.devices:
        x_m, y_m = middle_m(device.position, cells)
        lines.append(f"{x_m},{y_m},{round(device.data * UNIT_BITS)}")
    return "\n".join(lines) + "\n"


def fly(task):
    """Flies a mission; returns the actions of each UAV and the processor time."""
    path, keys, cells, starts, budgets = task
    begin = time.process_time()
    run = skysink.simulate(skysink.Scenario.load(path).replace(keys))
    seconds = time.process_time() - begin
    actions = []
    for uav, ((x, y), budget) in enumerate(zip(starts, budgets, strict=True)):
        own = {axis: np.asarray(run.slots[axis])[uav :: len(starts)] for axis in ("x_m", "y_m", "mode")}
        ends = [own[axis][SLOTS - 1 :: SLOTS] for axis in ("x_m", "y_m")]
        columns = np.rint(ends[0] / CELL_M - 0.5).astype(int)
        rows = np.rint(cells - ends[1] / CELL_M - 0.5).astype(int)
        flown = []
        for column, row in list(zip(columns.tolist(), rows.tolist(), strict=True))[: budget - 1]:
            flown.append(MOVES[column - x, row - y])
            x, y = column, row
        # It lands where it stays for good: one that has landed is in nobody's way.
        while flown and flown[-1] == HOVER and own["mode"][SLOTS * len(flown) - 1] == "charge":
            flown.pop()
        actions.append([*flown, LAND])
    return actions, seconds


def table(name, rows):
    """Prints means and standard errors of all missions, by UAVs, and of one UAV by budget."""
    columns = np.array([row[2:5] for row in rows]) * 100
    uavs = np.array([row[0] for row in rows])
    budgets = np.array([row[1] for row in rows])

    def line(label, chosen):
        means, count = columns[chosen].mean(axis=0), int(chosen.sum())
        errors = columns[chosen].std(axis=0, ddof=1) / count**0.5 if count > 1 else [float("nan")] * 3
        cells = " | ".join(f"{mean:.1f} ± {error:.1f}" for mean, error in zip(means, errors, strict=True))
        print(f"| {label} | {count} | {cells} |")

    print(f"\n| {name} | missions | landed | collected | both |\n|---|---|---|---|---|")
    line("all", uavs > 0)
    for count in sorted(set(uavs.tolist())):
        line(f"{count} UAV" + "s" * (count > 1), uavs == count)
    if (uavs == 1).any():
        alone = budgets[uavs == 1]
        edges = np.linspace(alone.min(), alone.max() + 1, BUDGETS + 1)
        for low, high in zip(edges, edges[1:]):
            chosen = (uavs == 1) & (budgets >= low) & (budgets < high)
            line(f"1 UAV, budget {int(np.ceil(low))} to {int(np.ceil(high)) - 1}", chosen)
    landed, collected, both = PAPER[name]
    print(f"| the authors' table 4, one to three UAVs | 1000 | {landed} | {collected} | {both} |")


def arguments():
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("checkout", type=Path, help="a checkout of github.com/hbayerlein/uav_data_harvesting")
    parser.add_argument("--map", action="append", choices=sorted(PAPER), help="both unless given")
    parser.add_argument("--uavs", action="append", type=int, choices=[1, 2, 3], help="numbers of UAVs that are flown")
    parser.add_argument("--missions", type=int, default=1000, help="random missions")
    parser.add_argument("--seed", type=int, default=7, help="mission e is drawn from the seed 100000 S + e")
    parser.add_argument("--iterations", type=int, default=1000, help="planner.horizon.iterations")
    parser.add_argument("--processes", type=int, default=os.cpu_count())
    parser.add_argument("--actions", type=Path, help="write the actions of each map into this folder")
    return parser.parse_args()


def main():
    chosen = arguments()
    checkout = chosen.checkout.resolve()
    if not (checkout / "config").is_dir():
        print(f"harvesting.py: {checkout}: expected a checkout of uav_data_harvesting", file=sys.stderr)
        return 2
    for name in chosen.map or sorted(PAPER):
        reference = Reference(checkout, name)
        seeds = range(100000 * chosen.seed, 100000 * chosen.seed + chosen.missions)
        counts = chosen.uavs or [1, 2, 3]
        missions = [(seed, state) for seed in seeds if (state := reference.mission(seed)).num_agents in counts]
        with tempfile.TemporaryDirectory() as folder:
            path = field_of(reference, name, Path(folder))
            tasks = []
            for seed, state in missions:
                sensors = Path(folder) / f"{seed}.csv"
                sensors.write_text(sensors_csv(state, reference.cells))
                keys = keys_of(reference, state, sensors, seed, chosen.iterations)
                starts = [tuple(map(int, position)) for position in state.positions]
                tasks.append((path, keys, reference.cells, starts, [int(budget) for budget in state.movement_budgets]))
            with ProcessPoolExecutor(chosen.processes) as pool:
                flown = list(pool.map(fly, tasks, chunksize=4))
        rows = []
        for (seed, state), (actions, _) in zip(missions, flown, strict=True):
            flown_there = reference.replay(state, actions, seed)
            rows.append((state.num_agents, int(state.movement_budgets[0]), *flown_there))
        table(name, rows)
        print(f"refused moves {sum(row[5] for row in rows):.0f}; {sum(seconds for _, seconds in flown):.0f} s of CPU to plan and fly")
        if chosen.actions:
            chosen.actions.mkdir(parents=True, exist_ok=True)
            (chosen.actions / f"{name}.jsonl").write_text("".join(json.dumps(actions) + "\n" for actions, _ in flown))
    return 0


if __name__ == "__main__":
    sys.exit(main())
