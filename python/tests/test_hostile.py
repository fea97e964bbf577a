"""Misuse is refused with a one-line message, and has no other effect."""

from __future__ import annotations

import multiprocessing
import warnings
from concurrent.futures import Executor, Future
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import ROOT

import skysink
from skysink.environment import DataCollectionEnv, DataCollectionVectorEnv

SWEEP = f"""
scenario = "{ROOT}/scenarios/smoke.toml"
strategies = ["uts"]
seeds = 4
"""


def test_a_recursive_value_is_refused() -> None:
    endless: list[Any] = []
    endless.append(endless)
    table: dict[str, Any] = {}
    table["a"] = table
    for value in (endless, table, {"a": [[[[[[[[[[1]]]]]]]]]]}):
        with pytest.raises(TypeError, match="expected a number"):
            skysink.Scenario.letter().replace({"seed": value})


def test_recursive_missions_are_refused(smoke: skysink.Scenario) -> None:
    class Endless(skysink.Strategy):
        def plan(self, view: skysink.View) -> skysink.Decision | None:
            skysink.simulate(smoke, Endless())
            return None

    with pytest.raises(RecursionError):
        skysink.simulate(smoke, Endless())


def test_modifying_a_view_has_no_effect(smoke: skysink.Scenario) -> None:
    class Bends(skysink.Strategy):
        def plan(self, view: skysink.View) -> skysink.Decision | None:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                view.queues_bits.dtype = np.dtype(np.uint8)  # type: ignore[misc, assignment]
            return None

    class Waits(skysink.Strategy):
        def plan(self, view: skysink.View) -> skysink.Decision | None:
            return None

    traces = [skysink.simulate(smoke, strategy).summary["trace_hash"] for strategy in (Bends, Waits)]
    assert traces[0] == traces[1]


@pytest.mark.parametrize("count", [0, 100_001, 2**62])
def test_a_vector_of_an_impossible_size_is_refused(smoke: skysink.Scenario, count: int) -> None:
    with pytest.raises(skysink.InputError, match="num_envs"):
        DataCollectionVectorEnv(count, smoke)


def test_seeds_have_the_range_of_skysink(smoke: skysink.Scenario) -> None:
    env, envs = DataCollectionEnv(smoke), DataCollectionVectorEnv(3, smoke)
    for seed in (2**63, 2**64 - 1):
        with pytest.raises(skysink.InputError, match="seed"):
            env.reset(seed=seed)
        with pytest.raises(skysink.InputError, match="seed"):
            envs.reset(seed=[5, seed, 6])
    assert envs._core.seeds == [1, 2, 3], "nothing was reset"
    with pytest.raises(skysink.InputError, match="fields"):
        DataCollectionEnv(smoke, fields=2**63)
    with pytest.raises(skysink.InputError, match=r"replace seed=-1"):
        skysink.simulate(smoke, seed=-1)


@pytest.mark.parametrize("seed", [-1, 2**63, 2**64, 1.5, "1", True, np.float64(2), np.bool_(True), [1]])
def test_every_environment_refuses_the_same_seeds(smoke: skysink.Scenario, seed: Any) -> None:
    one, agents = DataCollectionEnv(smoke), skysink.parallel_env(smoke)
    vector = DataCollectionVectorEnv(2, smoke)
    for reset in (one.reset, agents.reset, vector.reset) if seed != [1] else (one.reset, agents.reset):
        with pytest.raises(skysink.InputError) as refused:
            reset(seed=seed)
        assert str(refused.value) == f"seed {seed!r}: expected 0 to 9223372036854775807"
    with pytest.raises(skysink.InputError, match="expected 0 to"):
        vector.reset(seed=[5, seed])
    whole: Any = np.int64(7)
    assert vector.reset(seed=whole)[1]["seed"].tolist() == [7, 8]


def test_environments_that_are_not_reset_together_have_seeds_of_their_own(smoke: skysink.Scenario) -> None:
    envs = DataCollectionVectorEnv(4, smoke)
    assert envs._core.seeds == [1, 2, 3, 4], "also without a reset"
    assert envs.reset(options={"reset_mask": [True, True, False, False]})[1]["seed"].tolist() == [1, 2, 3, 4]
    assert envs.reset(options={"reset_mask": [False, False, True, True]})[1]["seed"].tolist() == [1, 2, 3, 4]
    assert envs.reset(options={"reset_mask": [True, False, True, False]})[1]["seed"].tolist() == [5, 2, 7, 4]


def step(size: int) -> None:
    """A step of many environments, in a child."""
    envs = DataCollectionVectorEnv(size, skysink.Scenario.letter())
    envs.reset()
    envs.step(np.zeros((size, 2), np.float32))


@pytest.mark.filterwarnings("ignore")
def test_a_forked_child_has_its_own_threads() -> None:
    step(64)
    child = multiprocessing.get_context("fork").Process(target=step, args=(64,))
    child.start()
    child.join(60)
    code = child.exitcode
    child.kill()
    assert code == 0


class Answers(Executor):
    """Answers every task with the same."""

    def __init__(self, answer: Any) -> None:
        self.answer = answer

    def submit(self, function: Any, /, *arguments: Any, **keywords: Any) -> Any:
        if self.answer == "no future":
            return 7
        future: Future[Any] = Future()
        future.set_result(self.answer)
        return future


@pytest.mark.parametrize("answer", [[], [((0, 0, 99), [0.0] * 16)], [((99, 99, 1), [0.0] * 16)], "no future"])
def test_an_invalid_answer_of_an_executor_changes_nothing(tmp_path: Path, answer: Any) -> None:
    (tmp_path / "sweep.toml").write_text(SWEEP)
    with pytest.raises(skysink.InputError, match="executor"):
        skysink.sweep(tmp_path / "sweep.toml", tmp_path / "out", executor=Answers(answer))
    assert len(skysink.sweep(tmp_path / "sweep.toml", tmp_path / "out")) == 4


@pytest.mark.parametrize("arguments", [{"executor": "processes"}, {"threads": 20_000}, {"threads": -1}])
def test_invalid_executors_and_threads_are_refused(tmp_path: Path, arguments: dict[str, Any]) -> None:
    (tmp_path / "sweep.toml").write_text(SWEEP)
    with pytest.raises(skysink.InputError, match="executor|threads"):
        skysink.sweep(tmp_path / "sweep.toml", tmp_path / "out", **arguments)
    assert not (tmp_path / "out").exists()


def test_a_strategy_file_is_reloaded_after_a_change(
    smoke: skysink.Scenario, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.dont_write_bytecode", False)
    text = (
        "import skysink, neighbour\nclass Stay(skysink.Strategy):\n    def plan(self, view):\n"
        "        return skysink.Decision((view.uav[0] + neighbour.STEP, view.uav[1]))\n"
    )
    (tmp_path / "mine.py").write_text(text)
    ends = []
    for step_m in (1, 2):
        (tmp_path / "neighbour.py").write_text(f"STEP = 0.{step_m}\n")
        ends.append(skysink.simulate(smoke, f"python:{tmp_path}/mine.py:Stay").slots["x_m"][-1])
    assert np.allclose(ends, [30 + 6, 30 + 12])
