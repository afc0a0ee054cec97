"""The task's step in C++ against the one in numpy: the same bits, whatever happens between."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from state_maker import rows

from bicycle_common import native_library
from bicycle_sim.plants.choi.compiled import Numbers
from bicycle_sim.plants.choi.parameters import Constants, Physics
from bicycle_sim.plants.choi.plant import ChoiPlant
from bicycle_sim.task import native_task
from bicycle_sim.task.native_task import NativeStep
from bicycle_sim.task.scenario import SCENARIOS, Scenario, named
from bicycle_sim.task.task import BicycleTask, Step

PLANTS = {
    "faithful": ChoiPlant(),
    "corrected": ChoiPlant.named("corrected"),
    "noisy": ChoiPlant(Physics(displacement_noise=0.02)),
    "another bicycle": ChoiPlant(
        Physics(Constants(wheelbase=1.3, time_step=0.01, steer_stop=0.3))
    ),
}


def pair(scenario: Scenario, plant: ChoiPlant, count: int, seed: int = 1) -> list[BicycleTask]:
    """Return the same task twice: stepped in C++, and in numpy."""
    tasks = [
        BicycleTask(scenario, plant, count, np.random.default_rng(seed), native)
        for native in (True, False)
    ]
    assert [type(task._native) for task in tasks] == [NativeStep, type(None)]
    return tasks


def bits(task: BicycleTask, step: Step) -> dict[str, bytes]:
    """Everything that a step gives and leaves behind; bytes, since -0 equals 0."""
    arrays = {f"state {name}": value for name, value in vars(task.state).items()}
    arrays |= {name: value for name, value in vars(step).items() if name != "terms"}
    arrays |= {f"term {name}": value for name, value in step.terms.items()}
    for name in ("steps", "fallen", "_frozen_reward", "goal_x", "goal_y"):
        arrays[f"task {name}"] = getattr(task, name)
    return {name: value.dtype.str.encode() + value.tobytes() for name, value in arrays.items()}


def actions(count: int, rng: np.random.Generator) -> Iterator[np.ndarray]:
    """Hard and gentle ones, some beyond every limit, and zeros of both signs."""
    while True:
        action = rng.normal(size=(count, 3)) * [2.0, 0.1, 100.0] * rng.choice([0.1, 1.0, 3.0])
        action[rng.random((count, 3)) < 0.1] = 0.0
        action[rng.random((count, 3)) < 0.1] = -0.0
        yield action


def ride(tasks: list[BicycleTask], steps: int, seed: int = 2) -> None:
    """Step both and hold one against the other after each step."""
    rng = np.random.default_rng(seed)
    for action, _ in zip(actions(tasks[0].count, rng), range(steps), strict=False):
        result, wanted = (bits(task, task.step(action)) for task in tasks)
        assert result == wanted
        if rng.random() < 0.05:
            mask = rng.random(tasks[0].count) < 0.5
            for task in tasks:
                task.reset(mask)


def test_set_up_has_built_it() -> None:
    assert native_task.load() is not None


@pytest.mark.parametrize("count", [1, 16, 127, 128, 129, 1000])
@pytest.mark.parametrize("plant", PLANTS.values(), ids=PLANTS)
def test_it_gives_the_bits_of_numpy(plant: ChoiPlant, count: int) -> None:
    scenario = replace(named("learned-speed"), max_steps=70)
    ride(pair(scenario, plant, count), 150 if count < 200 else 60)


@pytest.mark.parametrize("name", SCENARIOS)
def test_it_gives_the_bits_of_numpy_in_every_scenario(name: str) -> None:
    ride(pair(named(name), ChoiPlant(), 64), 100)


def test_thousands_of_bicycles_have_the_bits_of_numpy() -> None:
    ride(pair(named("random-start-random-goal"), ChoiPlant(), 4096), 40)


def test_the_steering_stop_and_the_goal_were_met() -> None:
    """The rides above take each branch of a step."""
    task = pair(replace(named("fixed-start-fixed-goal"), goal_radius=17.0), ChoiPlant(), 64)[0]
    met = dict.fromkeys(("stop", "goal", "fall", "limit"), False)
    for action, _ in zip(actions(64, np.random.default_rng(2)), range(450), strict=False):
        step = task.step(action)
        met["stop"] |= bool((np.abs(step.observation[:, 0]) == 1.3963).any())
        met["goal"] |= bool(step.terminated.any())
        met["fall"] |= bool(step.fallen.any())
        met["limit"] |= bool(step.truncated.any())
    assert all(met.values())


@pytest.mark.parametrize("count", [1, 3])
def test_it_sees_what_was_changed_between_steps(count: int) -> None:
    tasks = pair(named("random-start-random-goal"), ChoiPlant(), count)
    one = np.arange(count) == 0

    def whole(task: BicycleTask) -> None:
        task.state = replace(task.state, steer_angle=np.full(count, 0.2))

    def field(task: BicycleTask) -> None:
        task.state.lean_rate = task.state.lean_rate + 0.3

    def in_place(task: BicycleTask) -> None:
        task.state.lean_angle[0] += 0.05

    def single_precision(task: BicycleTask) -> None:
        task.state.heading = task.state.heading.astype(np.float32)

    def strided(task: BicycleTask) -> None:
        task.goal_x = np.repeat(task.goal_x + 1.0, 2)[::2]

    def goal(task: BicycleTask) -> None:
        task.goal_y[0] += 7.0

    def late(task: BicycleTask) -> None:
        task.steps = np.where(one, 3999, task.steps)

    def down(task: BicycleTask) -> None:
        task.fallen = task.fallen | one

    def up(task: BicycleTask) -> None:
        task.place(one, *(np.array([value]) for value in (1.0, 2.0, 0.3, 40.0, 50.0)))

    for change in (*(whole, field, in_place, single_precision, strided, goal, late, down, up),):
        ride(tasks, 3)
        for task in tasks:
            change(task)
        ride(tasks, 2)


def test_fewer_bicycles_go_on() -> None:
    tasks = pair(named("learned-speed"), ChoiPlant(), 150)
    for left in (140, 12, 1):
        ride(tasks, 10)
        for task in tasks:
            task.keep(np.arange(task.count) < left)
    ride(tasks, 10)


def test_a_result_stays_as_it_was() -> None:
    task, _ = pair(named("learned-speed"), ChoiPlant(), 5)
    kept = []
    for action, _ in zip(actions(5, np.random.default_rng(0)), range(200), strict=False):
        step = task.step(action)
        kept.append((task.state, rows(task.state).copy(), step, step.observation.copy()))
    for state, before, step, seen in kept:
        np.testing.assert_array_equal(rows(state), before)
        np.testing.assert_array_equal(step.observation, seen)


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda it: pickle.loads(pickle.dumps(it))])
def test_a_copy_goes_its_own_way(copied: object) -> None:
    tasks = pair(named("learned-speed"), ChoiPlant(), 4)
    ride(tasks, 5)
    assert callable(copied)
    other = copied(tasks[0])
    other.step(np.ones((4, 3)))
    ride(tasks, 20)
    again = [copied(task) for task in tasks]
    ride(again, 20)


def test_what_is_not_finite_changes_nothing() -> None:
    task, _ = pair(named("learned-speed"), ChoiPlant(), 3)
    task.step(np.zeros((3, 3)))
    before = rows(task.state).copy()
    for value in (np.nan, np.inf, -np.inf):
        action = np.zeros((3, 3))
        action[2, 2] = value
        with pytest.raises(ValueError, match="not finite"):
            task.step(action)
    np.testing.assert_array_equal(rows(task.state), before)
    assert task.steps.tolist() == [1, 1, 1]


def test_without_the_library_the_task_steps_in_numpy(monkeypatch: pytest.MonkeyPatch) -> None:
    with_it = BicycleTask(named("learned-speed"), count=2, rng=np.random.default_rng(1))
    monkeypatch.setattr(native_task, "load", lambda: None)
    without = BicycleTask(named("learned-speed"), count=2, rng=np.random.default_rng(1))
    assert without._native is None
    ride([with_it, without], 50)
    with pytest.raises(RuntimeError, match=r"not built: call ros2_ws/setup\.sh"):
        NativeStep(without.scenario, Numbers())


@pytest.mark.parametrize("name", ["_no_such_library", "native_task"])
def test_a_library_that_does_not_load_is_none(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(native_task, "LIBRARY", name)
    monkeypatch.setattr(native_library, "EXTENSION_SUFFIXES", [".cpp"])
    assert native_task.load.__wrapped__() is None


@pytest.fixture
def unknown_loops() -> Iterator[None]:
    """numpy's loops are looked up anew."""
    native_task._loops.cache_clear()
    yield
    native_task._loops.cache_clear()


@pytest.mark.usefixtures("unknown_loops")
def test_ufuncs_of_another_layout_are_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(native_task._Ufunc, "inputs", 7)
    with pytest.raises(LookupError, match=r"numpy\.sin is laid out in another way"):
        native_task._loops()
    assert native_task.load.__wrapped__() is None
