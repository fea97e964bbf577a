"""The library of instances: copied, flown by a strategy in Python, and verified."""

from pathlib import Path

import pytest

import skysink
from skysink import library


class Fullest(skysink.Strategy):
    """Serves the fullest sensor nodes in reach, straight above the first."""

    def plan(self, view: skysink.View) -> skysink.Decision | None:
        near = view.field.within(view.uav, view.field.reach_m)
        if not len(near):
            return None
        return skysink.Decision(view.field.positions_m[near[view.queues_bits[near].argmax()]])


def test_the_instances_have_names_families_and_seeds() -> None:
    """Every policy instance has several seeds."""
    instances = library.instances()
    assert len(instances) >= 70 and len({one["name"] for one in instances}) == len(instances)
    assert all((one["seeds"] > 1) == (one["family"] == "policy") for one in instances)
    paper = next(one for one in instances if one["name"] == "sks-1000-200")
    assert (paper["sensors"], paper["uavs"]) == (200, 1) and 0.0 < paper["best"]["bound"] < paper["best"]["value"]
    assert paper["gap"] == pytest.approx(1.0 - paper["best"]["bound"] / paper["best"]["value"])


def test_a_flight_is_verified_and_placed(tmp_path: Path) -> None:
    """A run of a strategy in Python, and its trace as a plan file."""
    path = library.copy("sks-300-200", tmp_path)
    run = skysink.simulate(path, Fullest)
    run.save(tmp_path / "run")
    placement = library.verify(tmp_path / "run")
    assert placement == library.verify(tmp_path / "run" / "slots.csv", instance="sks-300-200")
    assert (placement["measure"], placement["value"]) == ("loss_rate", run.loss_rate)
    assert placement["place"] > 1 and placement["bound"] <= placement["best"] < placement["value"]
    assert placement["gap_to_best"] == pytest.approx(1.0 - placement["best"] / run.loss_rate)


def test_what_is_no_flight_of_an_instance_is_refused(tmp_path: Path) -> None:
    """Unknown names, changed scenarios, plans that cannot be flown."""
    with pytest.raises(skysink.InputError, match="did you mean `sks-small-5a`"):
        library.copy("sks-small-5", tmp_path)
    path = library.copy("sks-small-5a", tmp_path)
    changed = skysink.Scenario.load(path).replace({"link.resource_blocks": 2})
    skysink.simulate(changed, "gfs").save(tmp_path / "run")
    with pytest.raises(skysink.InputError, match="link.resource_blocks = 2: expected 1, as in sks-small-5a"):
        library.verify(tmp_path / "run")
    rows = "".join(f"{slot},55.0,55.0,\n" for slot in range(1, 31))
    (tmp_path / "plan.csv").write_text(f"# instance: sks-small-5a\nslot,x_m,y_m,scheduled\n{rows}")
    with pytest.raises(skysink.InputError, match="line 3: slot 1: position"):
        library.verify(tmp_path / "plan.csv")
