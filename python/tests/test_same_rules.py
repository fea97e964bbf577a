"""Strategies in Python fly by the rules of those in Rust: the same bytes, in this process and in a ring."""

from __future__ import annotations

import copy
import pickle
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import ROOT, run, same_files
from test_ring import place

import skysink

__all__ = ["place"]

TWINS = '''
import skysink

class Greedy(skysink.Strategy):
    """The rule of `gfs`."""

    def plan(self, view):
        reachable = view.reachable
        if not len(reachable):
            return None
        return skysink.Decision(view.field.positions_m[reachable[view.values[reachable].argmax()]])

class InTurn(skysink.Strategy):
    """The rule of `round-robin`."""

    def begin(self, field):
        self.order = field.servable.nonzero()[0].tolist()
        self.turn, self.planned = -1, []

    def plan(self, view):
        field, count = view.field, len(self.order)
        if self.turn < 0:
            own, uavs = (view.neighbours.own, len(view.neighbours.uavs) + 1) if view.neighbours else (0, 1)
            self.turn = own * count // uavs if len(view.queues_bits) == WHOLE else 0
        in_range = set(field.within(view.uav, field.comm_radius_m).tolist())
        served = {id for id in self.planned if id in in_range}
        for _ in range(count):
            if self.order[self.turn] not in served:
                break
            served.remove(self.order[self.turn])
            self.turn = (self.turn + 1) % count
        current = self.order[self.turn]
        waypoint = field.toward(view.uav, field.positions_m[current])
        ids = field.within(waypoint, field.comm_radius_m).tolist()
        ids.sort(key=lambda id: (id != current, -int(view.values[id]), id))
        self.planned = sorted(ids[: field.resource_blocks])
        return skysink.Decision(waypoint, serve=self.planned)

    def save(self):
        return repr((self.turn, self.planned)).encode()

    def restore(self, state):
        self.turn, self.planned = eval(state)

WHOLE = 60

class Nothing(skysink.Strategy):
    """Leaves all slots to transit."""

    def plan(self, view):
        return None

class Transit(skysink.Strategy):
    """The rule of transit."""

    def plan(self, view):
        away_m = ((view.field.positions_m - view.uav[:2]) ** 2).sum(axis=1)
        goal = min(range(len(away_m)), key=lambda id: (-int(view.values[id]), away_m[id], id))
        return skysink.Decision(view.field.toward(view.uav, view.field.positions_m[goal]))
'''

RUST = {"Greedy": "gfs", "InTurn": "round-robin"}

FIELD = """name = "twins"
slots = 100
[area]
side_m = 300.0
{area}
[sensors]
count = 60
sampling_bps = [100.0, 900.0]
{sensors}
[uav]
max_speed_mps = 25.0
{uav}
{more}
[planner]
{planner}
"""

ZONES = (
    "no_fly = [{ polygon_m = [[90, 30], [110, 30], [110, 250], [90, 250]] }, "
    "{ polygon_m = [[180, 180], [280, 180], [280, 290], [180, 290]] }]"
)
"""A wall, and a zone that hides the SNs inside."""

BASE = "[base]\nposition_m = [150.0, 150.0]\nradius_m = 5.0\ncharge_w = 3000.0\n"

BATTERY = BASE + "[uav.battery]\ncapacity_j = 6000.0\n"

FREE = (
    'altitude = "free"\naltitude_m = 40.0\nmin_altitude_m = 20.0\nmax_altitude_m = 80.0\nmax_climb_mps = 5.0\n'
)

PROBABLE = """[link]
model = "probabilistic-los"
environment = "suburban"
bandwidth_hz = 5e3
noise_dbm = -109.0
reference_gain_db = -60.0
los_exponent = 2.5
nlos_exponent = 3.5
nlos_extra_db = -20.0
snr_gap_db = 8.2
comm_radius_m = 30.0
"""

FLEET = 'count = 3\ncoordination = "{}"\n'

CASES: dict[str, dict[str, str]] = {
    "open": {},
    "zones": {"area": ZONES},
    "battery": {"more": BATTERY},
    "must land": {"more": BASE, "uav": "must_land = true\n"},
    "all": {"area": ZONES, "more": BATTERY, "uav": "must_land = true\n"},
    "grid": {"area": ZONES, "more": BATTERY, "uav": 'moves = "grid"\ncell_m = 20.0\n'},
    "slow grid": {"uav": 'moves = "grid"\ncell_m = 50.0\n'},
    "weights": {"area": ZONES, "sensors": 'file = "weighted.csv"\n'},
    "altitude": {"uav": FREE, "more": PROBABLE + BATTERY},
    "wind": {"uav": "wind_mps = [3.0, -2.0]\nposition_error_m = 2.0\nmust_land = true\n", "more": BATTERY},
    "margin": {"uav": "waypoint_margin_m = 1.0\n"},
    "collect": {"planner": 'objective = "collect"\n'},
    "estimated": {"area": ZONES, "planner": 'knowledge = "estimated"\n'},
    "learnt": {"planner": 'knowledge = "estimated"\nrates = "learnt"\n'},
    "independent": {"uav": FLEET.format("independent")},
    "sequential": {"uav": FLEET.format("sequential") + "separation_m = 10.0\n", "more": BATTERY, "area": ZONES},
    "partition": {"uav": FLEET.format("partition") + "must_land = true\n", "more": BASE},
}

RING = ["all", "weights", "altitude", "learnt", "sequential", "partition"]

MODES = {"all": {"return"}, "battery": {"return", "charge"}, "must land": {"return"}, "wind": {"return"}}
"""Modes that must occur in the mission of `gfs`, so that there is something to compare."""


def scenario(folder: Path, case: str, strategy: str) -> skysink.Scenario:
    """The mission of a case, which is left in a file beside the strategies."""
    rng = np.random.default_rng(7)
    lines = ["x_m,y_m,queue_bits,gain_db,sampling_bps,weight"]
    lines += [
        f"{x:.1f},{y:.1f},{int(bits)},-52.5,{rate:.1f},{weight:.2f}"
        for x, y, bits, rate, weight in zip(
            *rng.uniform(0, 300, (2, 60)), rng.uniform(0, 20000, 60), rng.uniform(100, 900, 60), rng.uniform(0.2, 5, 60),
            strict=True,
        )
    ]  # fmt: skip
    (folder / "weighted.csv").write_text("\n".join(lines) + "\n")
    (folder / "twins.py").write_text(TWINS)
    keys = {name: "" for name in ("area", "sensors", "uav", "more", "planner")} | CASES[case]
    keys["planner"] += f'strategy = "{strategy}"\n'
    if "file" in keys["sensors"]:
        text = FIELD.replace("count = 60\nsampling_bps = [100.0, 900.0]\n", "")
    else:
        text = FIELD
    for name, value in keys.items():
        text = text.replace(f"{{{name}}}", value)
    file = folder / "twins.toml"
    file.write_text(text)
    return skysink.Scenario.load(file)


@pytest.mark.parametrize("twin", list(RUST))
@pytest.mark.parametrize("case", list(CASES))
def test_a_strategy_in_python_has_the_bytes_of_its_rust_twin(tmp_path: Path, case: str, twin: str) -> None:
    mission = scenario(tmp_path, case, RUST[twin])
    theirs = skysink.simulate(mission)
    mine = skysink.simulate(mission, f"python:{tmp_path / 'twins.py'}:{twin}")
    theirs.save(tmp_path / "theirs")
    mine.save(tmp_path / "mine")
    same_files(tmp_path / "theirs", tmp_path / "mine", ["slots.csv", "sensors.csv"])
    if twin == "Greedy":
        assert MODES.get(case, set()) <= set(theirs.slots.to_polars()["mode"])


@pytest.mark.parametrize("case", list(CASES))
def test_transit_flies_to_the_greatest_value_and_serves_by_value(tmp_path: Path, case: str) -> None:
    mission = scenario(tmp_path, case, "gfs")
    nothing, transit = (
        skysink.simulate(mission, f"python:{tmp_path / 'twins.py'}:{name}").slots.to_polars().drop("mode")
        for name in ("Nothing", "Transit")
    )
    assert nothing.equals(transit)


@pytest.mark.parametrize("case", RING)
def test_a_strategy_in_python_has_the_bytes_of_its_rust_twin_in_a_ring(place: Path, case: str) -> None:
    scenario(place, case, "round-robin")
    (place / "mine.py").write_text("import skysink.ring, twins\nskysink.ring.planner(twins.InTurn)\n")
    planner = ["--planner", f"{sys.executable} mine.py"]
    run("run", "twins.toml", "--no-viewer", "--out", "mine", *planner, cwd=place)
    run("simulate", "twins.toml", "--out", "theirs", cwd=place)
    same_files(place / "theirs", place / "mine", ["slots.csv", "sensors.csv"])


def test_the_class_of_the_readme_comes_home_in_a_ring_as_in_a_process(place: Path) -> None:
    readme = (ROOT / "README.md").read_text()
    begin = readme.index("class ToFullest")
    source = "import skysink\n\n" + readme[begin : readme.index("\nskysink.simulate", begin)]
    (place / "fullest.py").write_text(source)
    (place / "mine.py").write_text("import skysink.ring, fullest\nskysink.ring.planner(fullest.ToFullest)\n")
    base = str(ROOT / "scenarios" / "base.toml")
    alone = skysink.simulate(base, f"python:{place / 'fullest.py'}:ToFullest")
    assert alone.metrics["landed"] == 1.0
    alone.save(place / "alone")
    run("run", base, "--no-viewer", "--out", "run", "--planner", f"{sys.executable} mine.py", cwd=place)
    same_files(place / "alone", place / "run", ["slots.csv"])


class Watch(skysink.Strategy):
    """Keeps its views and what it observes; stays, or flies to the fullest queue in reach."""

    def __init__(self, flies: bool = False) -> None:
        self.flies = flies
        self.views: list[skysink.View] = []
        self.observed: list[tuple[int, list[skysink.Flight]]] = []

    def observe(self, slot: int, flights: list[skysink.Flight]) -> None:
        self.observed.append((slot, flights))

    def plan(self, view: skysink.View) -> skysink.Decision:
        self.views.append(view)
        near = view.reachable
        if not self.flies or not len(near):
            return skysink.Decision(view.uav[:2])
        return skysink.Decision(view.field.positions_m[near[view.values[near].argmax()]])


def watched(mission: skysink.Scenario, flies: bool = False) -> list[Watch]:
    """The strategies of the UAVs after a mission."""
    made: list[Watch] = []

    def make() -> Watch:
        made.append(Watch(flies))
        return made[-1]

    skysink.simulate(mission, make)
    return made


def test_a_view_knows_energy_base_and_the_way_home(tmp_path: Path) -> None:
    mission = scenario(tmp_path, "all", "gfs").replace({"uav.start_m": [60.0, 150.0], "slots": 60})
    views = watched(mission)[0].views
    first = views[0]
    assert first.energy_j == 6000.0 and not first.is_charging
    base = first.field.base
    assert base is not None and base.radius_m == 5.0 and base.places_m == [(150.0, 150.0)]
    assert base.contains((153.0, 150.0)) and not base.contains(first.uav)
    assert first.neighbours is None
    # Around the wall from (60, 150): by (90, 30) or (90, 250), 104 or 128 m and more, at 25 m a slot.
    home = first.route_to((150.0, 150.0))
    assert home is not None and home.length_m > 230.0 and 10 <= home.slots <= 13
    assert home.energy_j > 9 * 100.0 and home.end_m == pytest.approx((150.0, 150.0))
    assert first.slots_left_home is not None and 60 - 13 <= first.slots_left_home <= 60 - 9
    assert 0.0 < first.energy_left_home_j < 6000.0 - 600.0
    assert [view.slots_left_home for view in views[:3]] == [first.slots_left_home - count for count in range(3)]


def test_routes_lead_into_the_range_of_sensor_nodes(tmp_path: Path) -> None:
    mission = scenario(tmp_path, "zones", "gfs")
    field = mission.field()
    assert not field.servable.all() and field.move_slots == 1 and field.base is None
    for sensor, is_servable in enumerate(field.servable):
        route = field.route((20.0, 20.0), sensor)
        assert (route is not None) == is_servable
        if route is not None:
            assert route.slots >= route.length_m / field.reach_m - 1e-9
            assert sensor in field.within(route.end_m, field.comm_radius_m)
    with pytest.raises(skysink.InputError, match="goal 60: expected the id of a sensor node, below 60"):
        field.route((20.0, 20.0), 60)


def test_a_copied_field_keeps_zones_base_and_weights(tmp_path: Path) -> None:
    for case in ("all", "weights", "grid"):
        field = scenario(tmp_path, case, "gfs").field()
        for again in (copy.deepcopy(field), pickle.loads(pickle.dumps(field))):
            assert repr(again.base) == repr(field.base)
            assert again.toward((85.0, 150.0), (150.0, 150.0)).tolist() == field.toward((85.0, 150.0), (150.0, 150.0)).tolist()
            assert again.weights.tolist() == field.weights.tolist()
            assert again.servable.tolist() == field.servable.tolist()
        if case != "grid":
            assert field.toward((85.0, 150.0), (150.0, 150.0))[0] < 91.0, "it does not cross the wall"


def test_weights_and_hidden_sensor_nodes_count_in_values_and_defaults(tmp_path: Path) -> None:
    mission = scenario(tmp_path, "weights", "gfs")
    view = watched(mission)[0].views[0]
    weighted = view.queues_bits * view.field.weights * view.field.servable
    assert np.array_equal(weighted.argsort(kind="stable"), view.values.argsort(kind="stable"))
    point = view.field.positions_m[0]
    near = view.field.within(point, view.field.comm_radius_m)
    best = sorted(near[np.argsort(-view.values[near].astype(np.int64), kind="stable")][: view.field.resource_blocks])
    assert view.field.fullest(point, view.queues_bits).tolist() == best


@pytest.mark.parametrize("coordination", ["independent", "sequential", "partition"])
def test_uavs_of_a_fleet_have_objects_of_their_own(tmp_path: Path, coordination: str) -> None:
    mission = scenario(tmp_path, coordination, "gfs").replace({"slots": 5})
    made = watched(mission, flies=True)
    assert len(made) == 3
    for uav, watch in enumerate(made):
        flights = [len(flights) for _, flights in watch.observed]
        assert [slot for slot, _ in watch.observed] == [0, 1, 2, 3, 4]
        assert flights == [3 if coordination == "sequential" else 1] * 5
        met = watch.views[-1].neighbours
        if met is None:
            assert coordination == "independent"
        else:
            assert met.own == uav and met.uavs == [other for other in range(3) if other != uav]
            assert met.positions_m.shape == (2, 3)
    if coordination == "sequential":
        taken = 0
        for view in made[2].views:
            assert view.neighbours is not None
            assert (view.queues_bits[view.neighbours.scheduled] == 0).all()
            taken += len(view.neighbours.scheduled)
        assert taken > 0
    if coordination == "partition":
        assert sum(len(watch.views[0].queues_bits) for watch in made) == 60


def test_one_object_for_several_uavs_is_refused(tmp_path: Path) -> None:
    mission = scenario(tmp_path, "independent", "gfs").replace({"slots": 5})
    one = Watch()
    wrong: list[Any] = [one, lambda: one]
    for strategy in wrong:
        with pytest.raises(skysink.InputError, match="expected a class, so that each of the 3 UAVs has an object"):
            skysink.simulate(mission, strategy)
    with pytest.raises(skysink.InputError, match=r"expected a skysink\.Strategy"):
        skysink.simulate(mission, dict)  # type: ignore[arg-type]


def test_fleets_in_python_are_compared(tmp_path: Path) -> None:
    mission = scenario(tmp_path, "partition", "gfs").replace({"slots": 40})
    standings = skysink.compare(mission, ["gfs", f"python:{tmp_path / 'twins.py'}:Greedy"], seeds=2)
    losses = [entry for entry in standings if entry["metric"] == "loss_rate"]
    assert losses[0]["mean"] == losses[1]["mean"] and losses[1]["difference"] == 0.0


def test_an_unknown_sensor_node_in_a_decision_is_refused(tmp_path: Path) -> None:
    class Wrong(skysink.Strategy):
        def plan(self, view: skysink.View) -> skysink.Decision:
            return skysink.Decision(view.uav, serve=[3, 60])

    with pytest.raises(skysink.InputError, match="serve: 60: expected the id of a sensor node, below 60") as raised:
        skysink.simulate(scenario(tmp_path, "open", "gfs"), Wrong())
    assert raised.value.__notes__ == ["while planning slot 1"]
