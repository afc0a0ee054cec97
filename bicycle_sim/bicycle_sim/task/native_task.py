"""One step of `BicycleTask` in one call of `native_task.cpp`, with numpy's result to the bit.

For one bicycle numpy's hundred calls cost a hundred times what they compute; for many, one pass
over blocks of bicycles stays in the processor's cache. Sine, arc tangent and the like differ in
their last bits between libraries and processors, so the library calls numpy's own inner loops,
which every ufunc holds in public (`PyUFuncObject` of numpy's C API). Where the library was not
built, or numpy's ufuncs look otherwise, the task steps in numpy.
"""

from __future__ import annotations

import ctypes
import functools
import operator
from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from bicycle_common.native_library import load_built
from bicycle_sim.plants.base import BodyState, Plant
from bicycle_sim.task.scenario import Scenario

LIBRARY = "_native_task"
"""Name of its file beside this one, without the suffix of Python extensions."""
LOOPS = ("sin", "cos", "arctan", "arcsin", "arctan2", "maximum", "minimum")
"""Ufuncs whose loops the library calls, in the order of `Model`."""
STATES = 11
"""Fields of a BodyState, the first rows of a result."""
ROWS = 24
"""Rows of a result (ROWS, N): BodyState's fields, six observations, the reward, its four terms,
the distance to the goal, and the steps as whole numbers."""
OBSERVED, REWARD, TERMS, DISTANCE, STEPS = 11, 17, 18, 22, 23
"""First row of each."""
POOL = 64
"""Number of results allocated at once for one bicycle."""


class TaskArrays(Protocol):
    """Arrays of a `BicycleTask` that a step reads and writes; shape (N,)."""

    count: int
    """N."""
    steps: np.ndarray
    fallen: np.ndarray
    goal_x: np.ndarray
    """m."""
    goal_y: np.ndarray
    """m."""
    _frozen_reward: np.ndarray


class _Ufunc(ctypes.Structure):
    """The beginning of `PyUFuncObject`."""

    _fields_ = (
        ("head", ctypes.c_char * object.__basicsize__),
        ("inputs", ctypes.c_int),
        ("outputs", ctypes.c_int),
        ("arguments", ctypes.c_int),
        ("identity", ctypes.c_int),
        ("functions", ctypes.POINTER(ctypes.c_void_p)),
        ("data", ctypes.POINTER(ctypes.c_void_p)),
        ("types", ctypes.c_int),
        ("reserved", ctypes.c_int),
        ("name", ctypes.c_char_p),
    )


class _Loop(ctypes.Structure):
    """`Loop` of plants/compiled.h."""

    _fields_ = (("call", ctypes.c_void_p), ("data", ctypes.c_void_p))


class _SpeedLimits(ctypes.Structure):
    """`SpeedLimits` of plants/compiled.h."""

    _fields_ = (("low", ctypes.c_double), ("high", ctypes.c_double), ("given", ctypes.c_int64))


class _Model(ctypes.Structure):
    """`Model` of native_task.cpp."""

    _fields_ = (
        *((name, _Loop) for name in LOOPS),
        ("speed_limits", _SpeedLimits),
        ("plant", ctypes.c_void_p),
        ("lowest", ctypes.c_double * 3),
        ("highest", ctypes.c_double * 3),
        ("fall_angle", ctypes.c_double),
        ("goal_radius", ctypes.c_double),
        ("weights", ctypes.c_double * 4),
        ("most_steps", ctypes.c_int64),
    )


_ACTION, _NOISE, _STATE, _GOAL_X, _GOAL_Y, _STEPS, _FALLEN, _FROZEN, _RESULT, _ENDS = range(10)
_SHARE, _OBSERVATION = 10, 11
"""Indices into `Arrays` of native_task.cpp."""
_ARRAYS = 12


class Face(ctypes.Structure):
    """Scales of an environment's actions and observations, as `Face` of native_task.cpp."""

    _fields_ = (
        ("actions", ctypes.c_int64),
        ("driven", ctypes.c_int64 * 3),
        ("limit", ctypes.c_double * 3),
        ("bound", ctypes.c_double * 6),
        ("scale", ctypes.c_double * 6),
        ("high", ctypes.c_float * 6),
    )

    @classmethod
    def of(
        cls,
        driven: np.ndarray,
        limits: np.ndarray,
        bounds: np.ndarray,
        scale: np.ndarray,
        high: np.ndarray,
    ) -> Face:
        """Prepare it.

        Args:
            driven: (k,) indices of the actions that an environment has.
            limits: (k,) physical value of an action of 1.
            bounds: (6,) largest observations in SI units.
            scale: (6,) divisors of the observations.
            high: (6,) float32 bounds of the scaled observations.
        """
        face = cls(actions=len(driven))
        face.driven[: len(driven)] = [int(index) for index in driven]
        face.limit[: len(driven)] = [float(limit) for limit in limits]
        for name, values in (("bound", bounds), ("scale", scale), ("high", high)):
            getattr(face, name)[:] = [float(value) for value in values]
        return face


_GIVEN: dict[int, tuple[str, type]] = {
    _GOAL_X: ("goal_x", np.float64),
    _GOAL_Y: ("goal_y", np.float64),
    _STEPS: ("steps", np.int64),
    _FALLEN: ("fallen", np.bool_),
    _FROZEN: ("_frozen_reward", np.float64),
}
"""Arrays (N,) of a task that others may replace between steps."""


class NativeStep:
    """Steps the bicycles of one task, and remembers the memory of its last result.

    Attributes:
        result: (ROWS, N) float64 of the last step, in memory of its own.
        wholes: the same memory as integers.
        ends: (3, N) bool: terminated, truncated, fallen.
        observation: (N, 6) float32 of the last `step_shares`.
    """

    def __init__(
        self, scenario: Scenario, numbers: ctypes.Structure, face: Face | None = None
    ) -> None:
        """Prepare the values that stay constant from step to step.

        Args:
            scenario: limits and ends.
            numbers: of the plant, see `Plant.compiled_numbers`.
            face: how an environment scales, for `step_shares`.

        Raises:
            RuntimeError: if the library cannot be used.
        """
        library = load()
        if library is None:
            raise RuntimeError("the native step was not built: call ros2_ws/setup.sh")
        self._made_of = scenario, numbers
        self._face = face
        self._model = _model(scenario, numbers)
        self._size = ctypes.c_long(0)
        arrays = np.zeros(_ARRAYS, dtype=np.uintp)
        self._at = arrays.data
        self._known: tuple[np.ndarray | None, ...]
        self._views: tuple[np.ndarray, ...]
        self._results: np.ndarray
        self._observations: np.ndarray
        self._results_at = self._ends_at = self._observations_at = self._next = 0
        given = ctypes.byref(self._model), ctypes.c_void_p(_address(arrays))
        size = ctypes.byref(self._size)
        self._call = functools.partial(library.task_step, *given, size)
        if face is not None:
            shares = functools.partial(library.env_step, *given, size, ctypes.byref(face))
            self._call_with_shares = shares
        self._resize(0)

    def __reduce__(self) -> tuple[Any, ...]:
        """Return the constructor arguments, so that a stepper can be copied and pickled."""
        face = None if self._face is None else bytes(self._face)
        return _remade, (*self._made_of, face)

    def state(self) -> BodyState:
        """Return the bicycles after the last step, as views of its result."""
        self._views = tuple(self.result[:STATES])
        return BodyState(*self._views)

    def step(
        self,
        task: TaskArrays,
        state: BodyState | None,
        action: np.ndarray,
        noise: np.ndarray | None,
    ) -> bool:
        """Step the bicycles of `task`.

        Args:
            task: with its goals, steps, falls and frozen rewards.
            state: of its bicycles; None if nobody has requested it since the last step.
            action: (N, 3) float64.
            noise: (N,) added to the displacement, if any.

        Returns:
            False, with nothing done, if an action is not finite.
        """
        if task.count != self._count:
            self._resize(task.count)
        self._action[:] = action
        return self._make(self._call, task, state, noise)

    def step_shares(
        self,
        task: TaskArrays,
        state: BodyState | None,
        shares: np.ndarray,
        noise: np.ndarray | None,
    ) -> bool:
        """Step by an environment's actions (N, k), as its `Face` says."""
        if task.count != self._count:
            self._resize(task.count)
        self._shares[:] = shares
        if not self._make(self._call_with_shares, task, state, noise):
            return False
        self.observation = self._observations[self._next - 1]
        return True

    def _make(
        self,
        call: Callable[[], int],
        task: TaskArrays,
        state: BodyState | None,
        noise: np.ndarray | None,
    ) -> bool:
        """Step by one of the library's calls, whose actions are in place."""
        if self._next == len(self._results):
            self._refill()
        at, number, count = self._at, self._next, self._count
        if state is not None:
            self._take(state)
        if not self._follows(task):
            self._meet(task)
        at[_NOISE] = 0 if noise is None else _address(noise)
        at[_RESULT] = result = self._results_at + number * 8 * ROWS * count
        at[_ENDS] = ends = self._ends_at + number * 3 * count
        at[_OBSERVATION] = self._observations_at + number * 24 * count
        if call():
            return False
        self._next = number + 1
        self.result, self.wholes = self._results[number], self._wholes[number]
        self.ends, self._views = self._ends[number], ()
        at[_STATE], at[_STEPS] = result, result + STEPS * 8 * count
        at[_FROZEN], at[_FALLEN] = result + REWARD * 8 * count, ends + 2 * count
        return True

    def follow(self, task: TaskArrays) -> None:
        """Remember that `Arrays` points to the task's arrays."""
        self._known = task.steps, task.fallen, task._frozen_reward, task.goal_x, task.goal_y

    def _follows(self, task: TaskArrays) -> bool:
        """Return True if the task's arrays are still those of the last step."""
        steps, fallen, frozen, goal_x, goal_y = self._known
        return (
            task.steps is steps
            and task.fallen is fallen
            and task._frozen_reward is frozen
            and task.goal_x is goal_x
            and task.goal_y is goal_y
        )

    def _take(self, state: BodyState) -> None:
        """Copy the bicycles, unless they are the last result."""
        values = vars(state).values()
        if len(self._views) == STATES and all(map(operator.is_, values, self._views)):
            return
        for row, array in zip(self._rows, values, strict=True):
            row[:] = array
        self._at[_STATE] = self._input_at

    def _meet(self, task: TaskArrays) -> None:
        """Update the pointers after somebody has replaced an array of the task."""
        for place, (name, kind) in _GIVEN.items():
            array: np.ndarray = np.ascontiguousarray(getattr(task, name), kind)
            setattr(task, name, array)
            self._at[place] = _address(array)
        self.follow(task)

    def _resize(self, count: int) -> None:
        """Allocate for `count` bicycles."""
        self._count = self._size.value = count
        self._action, self._input = np.zeros((count, 3)), np.zeros((STATES, count))
        self._rows, self._input_at = list(self._input), _address(self._input)
        self._at[_ACTION] = _address(self._action)
        self._shares = np.zeros((count, 0 if self._face is None else self._face.actions))
        self._at[_SHARE] = _address(self._shares)
        self._known, self._views = (None,) * 5, ()
        self._results = np.empty((0, ROWS, count))
        self._next = 0

    def _refill(self) -> None:
        """Allocate memory for further results; earlier results belong to the callers."""
        pooled = max(1, POOL // self._count)
        self._results = np.empty((pooled, ROWS, self._count))
        self._wholes: np.ndarray = self._results.view(np.int64)
        self._ends: np.ndarray = np.empty((pooled, 3, self._count), dtype=bool)
        self._results_at, self._ends_at = _address(self._results), _address(self._ends)
        self._observations = np.empty((pooled, self._count, 6), dtype=np.float32)
        self._observations_at = _address(self._observations)
        self._next = 0


def stepper(scenario: Scenario, plant: Plant[Any], face: Face | None = None) -> NativeStep | None:
    """Return a stepper for such bicycles in one call; None if none is available."""
    numbers, library = plant.compiled_numbers, load()
    if numbers is None or library is None:
        return None
    sizes = (ctypes.c_long(ctypes.sizeof(kind)) for kind in (_Model, type(numbers)))
    if not library.task_fits(plant.name.encode(), *map(ctypes.byref, sizes)):
        return None
    return NativeStep(scenario, numbers, face)


def _remade(scenario: Scenario, numbers: ctypes.Structure, face: bytes | None) -> NativeStep:
    """Return the stepper that was pickled."""
    return NativeStep(scenario, numbers, None if face is None else Face.from_buffer_copy(face))


def _address(array: np.ndarray) -> int:
    return int(array.__array_interface__["data"][0])


def _model(scenario: Scenario, numbers: ctypes.Structure) -> _Model:
    """Return all numbers, those of the reward and the ends as in reward.py and task.py.

    The plant's stay where they are: the caller keeps them.
    """
    weights, limits = scenario.reward, scenario.action_limits.tolist()
    low, high = scenario.speed_limits or (0.0, 0.0)
    return _Model(
        **_loops(),
        speed_limits=_SpeedLimits(low, high, scenario.speed_limits is not None),
        plant=ctypes.addressof(numbers),
        lowest=(ctypes.c_double * 3)(*(-limit for limit in limits)),
        highest=(ctypes.c_double * 3)(*limits),
        fall_angle=scenario.fall_angle,
        goal_radius=scenario.goal_radius,
        weights=(ctypes.c_double * 4)(
            weights.lean_angle, weights.lean_rate, weights.lean_acceleration, weights.heading_error
        ),
        most_steps=scenario.max_steps,
    )


@functools.cache
def _loops() -> dict[str, _Loop]:
    """Return numpy's inner loops for doubles, as numpy selected them for this processor.

    Raises:
        LookupError: if a ufunc's layout differs from numpy's C API.
    """
    found = {}
    for name in LOOPS:
        ufunc = getattr(np, name)
        raw = _Ufunc.from_address(id(ufunc))
        kind = "d" * ufunc.nin + "->d"
        shape = (raw.inputs, raw.outputs, raw.arguments, raw.types)
        if shape != (ufunc.nin, 1, ufunc.nin + 1, len(ufunc.types)) or raw.name != name.encode():
            raise LookupError(f"numpy.{name} is laid out in another way")
        index = ufunc.types.index(kind)
        found[name] = _Loop(raw.functions[index], raw.data[index] if raw.data else None)
    return found


@functools.cache
def load() -> ctypes.PyDLL | None:
    """Return the library built with the package, or None if it is missing or fails to load."""
    try:
        _loops()
        # PyDLL keeps the interpreter's lock: to reacquire it would cost more than the call.
        library = load_built(Path(__file__).parent, LIBRARY, lambda path: ctypes.PyDLL(str(path)))
    except (OSError, LookupError, ValueError):
        return None
    return library if hasattr(library, "task_fits") else None  # else it was built before
