"""Rides as the nodes make them, without DDS: the same loop, driver, conversion and bag writer."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from bicycle_msgs.msg import EpisodeInfo
from rclpy.serialization import serialize_message

from bicycle_bag.metadata import Topic
from bicycle_bag.schemas import Schemas
from bicycle_bag.writer import BagWriter
from bicycle_common.nodes import convert
from bicycle_common.nodes.topics import COMMAND, COMMAND_ECHO, EPISODE, STATE
from bicycle_controller.control.control_loop import ControlLoop
from bicycle_controller.control.exploration_noise import Noise, NoiseConfig
from bicycle_controller.control.goals import GoalTracker
from bicycle_controller.policy.policy import load_controller
from bicycle_sim.runtime.loop import Loop, LoopOptions
from bicycle_sim.runtime.simulator import Simulator
from bicycle_sim.task.scenario import SCENARIOS, Scenario

PERIOD_NS = 25_000_000
SCENARIO = SCENARIOS["random-start-random-goal"]
TOPICS = {f"/{topic.name}": topic for topic in (COMMAND_ECHO, STATE, COMMAND, EPISODE)}
Message = tuple[str, Any, int]
"""Topic, message, ns of simulated time."""


class Rider:
    """One simulator and one controller in lock-step."""

    def __init__(
        self,
        policy: str = "lqr",
        sigma: float = 0.1,
        seed: int = 0,
        scenario: Scenario = SCENARIO,
        field: float = 30.0,
    ) -> None:
        self.rng = np.random.default_rng(seed)
        self.scenario, self.field = scenario, field
        options = LoopOptions(pace="lockstep", watchdog_timeout=0.0)
        self.loop = Loop(Simulator(scenario, seed=seed), options)
        noise = Noise(NoiseConfig("ou", sigma, 0.15), 1, 3, np.random.default_rng(seed))
        self.driver = ControlLoop(
            "maker",
            load_controller(policy),
            GoalTracker(scenario.goal_radius, 300.0, 2.0),
            scenario.action_limits,
            noise if sigma > 0 else None,
            load_controller("lqr"),
        )
        self.steps = 0

    def ride(self, steps: int) -> Iterator[Message]:
        """Everything that a recorder would hear of so many steps, goal after goal."""
        yield from self._begin()
        while self.steps < steps:
            snapshot, now = self.loop.snapshot, self._now()
            if self.driver.tracker.active is None and self.driver.tracker.waiting == 0:
                x, y = snapshot.rear_x, snapshot.rear_y
                goal = self.rng.uniform(-self.field, self.field, 2) + np.array([x, y])
                self.driver.tracker.replace([(float(goal[0]), float(goal[1]))])
            applied = self.loop.simulator.applied
            answer = self.driver.answer(snapshot, now * 1e-9, applied)
            if answer.command is None:
                yield from self._begin()
                continue
            message = convert.from_command(answer.command, convert.to_stamp(now))
            yield "/" + COMMAND.name, message, now + 5000
            _, step = self.loop.receive(convert.to_command(message))  # its echo is the message
            assert step is not None
            self.steps += 1
            yield from self._state()

    def _now(self) -> int:
        return self.steps * PERIOD_NS

    def _begin(self) -> Iterator[Message]:
        """Yield the next episode, as after a fall."""
        self.loop.reset(None, None)
        simulator = self.loop.simulator
        yield (
            "/" + EPISODE.name,
            EpisodeInfo(
                episode=int(self.loop.snapshot.episode),
                seed=int(simulator.seed),
                physics=simulator.plant.to_json(),
                scenario=simulator.scenario.to_json(),
            ),
            self._now() + 2000,
        )
        yield from self._state()

    def _state(self) -> Iterator[Message]:
        """The state, after the echo of the command that led to it."""
        snapshot, now = self.loop.snapshot, self._now()
        applied = self.loop.simulator.applied
        echo = convert.from_applied(applied, snapshot.episode, snapshot.step, now)
        yield "/" + COMMAND_ECHO.name, echo, now + 2500
        yield "/" + STATE.name, convert.from_snapshot(snapshot, now), now + 3000


def write_bag(path: Path, messages: Iterator[Message], leave_out: Collection[str] = ()) -> Path:
    """Record messages at `path`, but for some topics."""
    schemas = Schemas()
    with BagWriter(path) as writer:
        for name, topic in TOPICS.items():
            if name not in leave_out:
                kind = f"bicycle_msgs/msg/{topic.type.__name__}"
                writer.add_topic(Topic(name, kind), schemas.definition(kind))
        for name, message, time in messages:
            if name not in leave_out:
                writer.write(name, serialize_message(message), time, time)
    return path
