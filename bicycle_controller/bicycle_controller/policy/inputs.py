"""Names of an actor's inputs, and how they are gathered.

A name is one of `past.ROW_FIELDS` as it is now (`lean_rate`, `speed`), one of them k control
periods ago (`lean_rate[-3]`, `torque[-1]`: the command sent in the last period), or a parameter of
the ridden bicycle as `Plant.to_json` has it (`plant.motor.lag`).
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import cached_property

import numpy as np

from bicycle_common.observation import ACTION_FIELDS, OBSERVATION_FIELDS
from bicycle_common.validation import nearest
from bicycle_controller.control.past import PARAMETER, ROW_FIELDS, Past

MOST_INPUTS = 4096
MOST_MEMORY = 400
"""Control periods: 10 s at 40 Hz."""

UNITS = dict(
    zip(
        ROW_FIELDS,
        ("rad", "rad/s", "rad", "rad/s", "rad/s^2", "rad", "m/s", "N m", "m", "N"),
        strict=True,
    )
)
_NAME = re.compile(r"([a-z_]+)(?:\[-([1-9][0-9]{0,3})\])?")
_TOLD = re.compile(r"plant(?:\.[A-Za-z_][A-Za-z_0-9]*)+")


def parse(name: str) -> tuple[str, int]:
    """Return the field of an input and its age in periods; of a parameter itself and 0.

    Raises:
        ValueError: on a name that is none.
    """
    if _TOLD.fullmatch(name):
        return name, 0
    found = _NAME.fullmatch(name)
    if found is None or found[1] not in ROW_FIELDS:
        hint = nearest(name.partition("[")[0], ROW_FIELDS)
        raise ValueError(f"there is no input {name!r}{hint}; known: {', '.join(ROW_FIELDS)}")
    field, age = found[1], int(found[2] or 0)
    if age == 0 and field in ACTION_FIELDS:
        raise ValueError(f"input {name!r} is what the policy chooses: write {field}[-1]")
    if age > MOST_MEMORY:
        raise ValueError(f"input {name!r} lies more than {MOST_MEMORY} control periods back")
    return field, age


def with_history(now: Sequence[str], before: Sequence[str], periods: int) -> tuple[str, ...]:
    """Return the names `now`, then the names `before` for each of the last periods."""
    past = (f"{name}[-{age}]" for age in range(1, periods + 1) for name in before)
    return (*now, *past)


class Inputs:
    """The inputs of one actor.

    Attributes:
        names: as in the policy file.
        plain: True for the paper's six states and nothing else.
        memory: number of past periods that are needed.
        plant_parameters: names of the bicycle's parameters that are needed.
    """

    def __init__(self, names: Sequence[str]) -> None:
        """Check the names.

        Raises:
            ValueError: on an unknown name, on the same name twice, or on too many.
        """
        self.names = tuple(names)
        if not 1 <= len(self.names) <= MOST_INPUTS or len(set(self.names)) < len(self.names):
            raise ValueError(f"a policy has 1 to {MOST_INPUTS} inputs, each once")
        parsed = [parse(name) for name in self.names]
        self.plain = self.names == OBSERVATION_FIELDS
        self.memory = max(age for _, age in parsed)
        self.plant_parameters = tuple(name for name, _ in parsed if name.startswith(PARAMETER))
        self._parsed = parsed

    @cached_property
    def _columns(self) -> np.ndarray:
        """Place of each input in the row that `gather` makes."""
        width = len(ROW_FIELDS)
        first = width * (self.memory + 1)
        return np.array(
            [
                first + self.plant_parameters.index(name)
                if name in self.plant_parameters
                else width * age + ROW_FIELDS.index(name)
                for name, age in self._parsed
            ]
        )

    def gather(
        self, observation: np.ndarray, speed: np.ndarray | None, past: Past | None
    ) -> np.ndarray:
        """Return the inputs, (N, n), in SI units.

        Args:
            observation: (N, 6), see OBSERVATION_FIELDS.
            speed: (N,) m/s; needed unless `plain`.
            past: of N rides; None for rides that begin.

        Raises:
            ValueError: if something that is needed is missing.
        """
        if self.plain:
            return observation
        count = len(observation)
        if speed is None or (past is None and self.plant_parameters):
            missing = "speed" if speed is None else "parameters of the bicycle"
            raise ValueError(
                f"this policy needs the {missing}; see bicycle_controller.control.past"
            )
        if past is None:
            past = Past.of_start(observation, speed, self.memory)
        if past.rows.shape[1] < self.memory:
            raise ValueError(f"this policy needs {self.memory} past control periods")
        whole = np.concatenate(
            [
                observation,
                speed[:, None],
                np.zeros((count, len(ACTION_FIELDS))),
                past.rows[:, : self.memory].reshape(count, -1),
                past.plant_parameters,
            ],
            axis=1,
        )
        return whole[:, self._columns]
