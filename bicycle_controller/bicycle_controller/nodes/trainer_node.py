"""Trainer as a ROS 2 node: the ride in, status out, better policies to the controller."""

from __future__ import annotations

if __name__ == "__main__":
    from bicycle_common.signals import run_module

    run_module("bicycle_controller.nodes.trainer_node")

import importlib.util
import math
import sys
import time
from collections.abc import Callable
from typing import Any

from bicycle_msgs.msg import EpisodeInfo, GoalStatus, TrainerStatus
from bicycle_msgs.srv import LoadPolicy
from rcl_interfaces.srv import GetParameters
from rclpy.clock import Clock, ClockType
from rclpy.node import Node

from bicycle_common.nodes import convert, topics
from bicycle_common.nodes.declare_parameters import declare
from bicycle_common.nodes.runner import UserError, run
from bicycle_common.nodes.topics import RESEND, Topic, advertise, listen
from bicycle_common.parameters import describe
from bicycle_controller.data.announced_episodes import AnnouncedEpisodes
from bicycle_controller.data.live_steps import LiveSteps
from bicycle_controller.data.packing import packed
from bicycle_controller.data.transition_builder import Reached, TransitionBuilder
from bicycle_controller.nodes.trainer_settings import TrainerSettings
from bicycle_controller.policy.trained_for import differences
from bicycle_controller.trainer_service.client import TrainerClient
from bicycle_sim.nodes.episode_setting import to_setting
from bicycle_sim.plants.base import Plant
from bicycle_sim.task.scenario import Scenario

NAME = "bicycle_trainer"
MOST_GOALS = 1000
"""Reached goals that are remembered."""
POLL = 0.1
"""Period of exchanges with the learning process (s)."""
TICK = 1.0
"""Period of status messages (s)."""


class TrainerNode(Node):
    """Feeds a learning process and hands its better policies to the controller."""

    def __init__(self) -> None:
        """Start learning from bags, or wait for a bicycle.

        Raises:
            UserError: on a bad parameter, or without torch.
        """
        super().__init__(NAME)
        self._settings = declare(self, TrainerSettings)
        if importlib.util.find_spec("torch") is None:
            raise UserError("learning needs torch: run 'ros2_ws/setup.sh --with train'")
        self._steps = LiveSteps(AnnouncedEpisodes())
        self._announced_at = 0
        self._builder: TransitionBuilder | None = None
        self._reached: dict[Reached, None] = {}
        self._policy = ""
        self._link: TrainerClient | None = None
        self._facts: dict[str, Any] = {"phase": "waiting"}
        self._message = ""
        self._learned: tuple[Scenario, Plant[Any]] | None = None
        self._elsewhere = False
        self._in_charge = self._settings.in_charge
        self._asked = bool(self._in_charge)
        self._offer: tuple[str, str] | None = None
        self._calling = self._held_back = False
        self._before = (time.monotonic(), 0, 0)
        self._publisher = advertise(self, topics.TRAINER)[topics.TRAINER.name]
        self._loader = self.create_client(LoadPolicy, topics.LOAD_POLICY.name)
        self._asker = self.create_client(GetParameters, "bicycle_controller/get_parameters")
        self._begin()
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(POLL, self._on_poll, clock=steady)
        self.create_timer(TICK, self._on_tick, clock=steady)

    def _begin(self) -> None:
        """Learn from bags at once; live, once the simulator has published its setting."""
        try:
            order = self._settings.order()
        except ValueError as error:
            raise UserError(str(error)) from None
        if order.live:
            listen(self, topics.EPISODE, self._on_episode)
            listen(self, topics.GOAL_STATUS, self._on_goal_status)
            self._drain(topics.COMMAND_ECHO, self._steps.add_echo)
            self._drain(topics.STATE, self._steps.add_state)
            self._say("waits for a simulator")
        else:
            self._start(
                TrainerClient(order), f"learns from {self._settings.bags} in {order.folder}"
            )

    def _start(self, link: TrainerClient, text: str) -> None:
        self._link = link
        if self._in_charge:
            link.set_baseline(self._in_charge)
        self._say(text)

    def _say(self, text: str) -> None:
        self._message = text
        self.get_logger().info(text)

    # Inputs from the simulator.

    def _on_episode(self, info: EpisodeInfo, facts: dict[str, Any]) -> None:
        """Start learning with the first episode's scenario and physics."""
        sent = facts["source_timestamp"]
        if sent == self._announced_at:
            return  # delivered once more, as a latched message may be
        self._announced_at = sent
        try:
            scenario, plant = to_setting(info)
            order = self._settings.order(scenario, plant)
        except (ValueError, TypeError) as error:
            self.get_logger().warning(f"episode info ignored: {error}; are both of one version?")
            self._steps.announce(info.episode, False)
            return
        if self._learned is not None:
            self._compare(scenario, plant)
            self._steps.announce(info.episode, not self._elsewhere)
            return
        self._learned = scenario, plant
        self._steps.announce(info.episode, True)
        self._builder = TransitionBuilder(scenario)
        self._start(TrainerClient(order), f"learns live in {order.folder}")

    def _compare(self, scenario: Scenario, plant: Plant[Any]) -> None:
        """Learn nothing from another bicycle than the one of which learning began."""
        assert self._learned is not None
        limits, plant_of = self._learned[0].action_limits, self._learned[1]
        found = differences(plant_of, plant)
        if (scenario.action_limits != limits).any():
            found.append("other limits of its actions")
        if found and not self._elsewhere:
            self._say(
                f"the simulator has another ride now ({'; '.join(found)}): nothing is learned "
                "of it and nothing handed over; for it start another trainer with its own folder"
            )
        elif self._elsewhere and not found:
            self._say("the simulator is back at the bicycle of which learning began: goes on")
        self._elsewhere = bool(found)

    def _on_goal_status(self, change: GoalStatus) -> None:
        """Keep which goals were reached, for the last steps towards them."""
        if change.status != GoalStatus.REACHED:
            return
        self._reached[float(change.goal_id), change.position.x, change.position.y] = None
        while len(self._reached) > MOST_GOALS:
            del self._reached[next(iter(self._reached))]

    def _drain(self, topic: Topic, take: Callable[[Any], None]) -> None:
        """Subscribe so that one turn of the executor reads all queued messages.

        In lock-step one turn per message is too slow.
        """

        def on_message(message: Any) -> None:
            taken: tuple[Any, Any] | None = (message, None)
            handle = subscription.handle
            with handle:
                while taken is not None:
                    take(taken[0])
                    taken = handle.take_message(topic.type, False)

        subscription = self.create_subscription(topic.type, topic.name, on_message, RESEND)

    # Exchange with the learning process.

    def _on_poll(self) -> None:
        link = self._link
        if link is None:
            return
        if self._builder is not None:
            found = self._builder.add(self._steps.take(), self._reached)
            self._policy = self._builder.policy or self._policy
            if len(found):
                link.feed(packed(found))
        alive = link.alive
        for report in link.poll():
            self._take(report)
        if not alive:
            self.close()
            raise UserError("the learning process has died: see its last words above")

    def _take(self, report: dict[str, Any]) -> None:
        """Process one report of the learning process."""
        if "error" in report:
            self.close()
            raise UserError(report["error"])
        if "note" in report:
            self._say(report["note"])
        if "in_charge" in report:
            self._facts["in_charge"] = report["in_charge"]
        if "offer" in report:
            self._offer = (report["offer"], report["policy"])
            self._say(f"{report['policy']} beats the policy in charge")
        known = ("phase", "updates", "transitions", "q_policy", "last", "best", "path")
        self._facts |= {name: report[name] for name in known if name in report}

    # Exchange with the controller.

    def _on_tick(self) -> None:
        """Once a second: publish the status, ask for the active policy, hand over a better one."""
        self._publisher.publish(self._status())
        if not self._asked and self._link is not None and self._asker.service_is_ready():
            self._asked = True
            request = GetParameters.Request(names=["policy"])
            self._asker.call_async(request).add_done_callback(self._on_asked)
        may = self._settings.hand_over and not (self._calling or self._elsewhere)
        if self._offer and may:
            self._hand_over(*self._offer)

    def _on_asked(self, future: Any) -> None:
        """Store the policy with which the controller was started."""
        values = future.result().values
        if values and self._link is not None:
            self._link.set_baseline(values[0].string_value)

    def _hand_over(self, path: str, policy: str) -> None:
        """Ask the controller to load a better policy, if it still uses the beaten one."""
        riding, beaten = self._policy, self._facts.get("in_charge", "")
        if riding and riding != beaten:
            if not self._held_back:
                self._say(f"{riding} rides, not {beaten}, which was beaten: nothing handed over")
            self._held_back = True
            return
        self._held_back = False
        if not self._loader.service_is_ready():
            return
        self._calling = True
        future = self._loader.call_async(LoadPolicy.Request(path=path))
        future.add_done_callback(lambda done: self._on_loaded(done, policy))

    def _on_loaded(self, future: Any, policy: str) -> None:
        """Handle the controller's answer."""
        self._calling = False
        if self._offer is not None and self._offer[1] == policy:
            self._offer = None
        answer = future.result()
        if not answer.success:
            self._say(f"not handed over: {answer.message}")
            return
        self._facts["in_charge"] = str(answer.policy)
        self._policy = ""
        if self._builder is not None:
            self._builder.policy = ""
        if self._link is not None:
            self._link.in_charge(str(answer.policy))
        self._say(f"handed over: {answer.message}")

    def _status(self) -> TrainerStatus:
        """Return the current status."""
        facts, now = self._facts, time.monotonic()
        updates = facts.get("updates", 0)
        then, old_updates, old_arrived = self._before
        arrived = self._builder.arrived if self._builder is not None else 0
        lost = self._builder.lost if self._builder is not None else 0
        self._before = (now, updates, arrived)
        last, best = facts.get("last"), facts.get("best")
        return TrainerStatus(
            header=convert.to_header(self.get_clock().now().nanoseconds),
            mode=self._settings.mode,
            phase=str(facts["phase"]),
            updates=int(updates),
            transitions=int(facts.get("transitions", 0)),
            lost_transitions=int(lost),
            update_rate=float((updates - old_updates) / (now - then)),
            transition_rate=float((arrived - old_arrived) / (now - then)),
            mean_return=_number(last, "mean_return"),
            reach_rate=_number(last, "reach_rate"),
            fall_rate=_number(last, "fall_rate"),
            best_reach_rate=_number(best, "reach_rate"),
            best_fall_rate=_number(best, "fall_rate"),
            mean_q=_or_nan(facts.get("q_policy")),
            best_policy=str(facts.get("path", "")),
            in_charge=str(facts.get("in_charge", "")),
            message=self._message,
        )

    def close(self) -> None:
        """Stop the learning process, which saves first."""
        if self._link is not None and not self._link.stop():
            self.get_logger().warning("the learning process was killed: it lost its last interval")
        self._link = None


def _number(score: Any, name: str) -> float:
    """Return a number of a score; NaN if there is none."""
    return _or_nan(getattr(score, name, None))


def _or_nan(value: float | None) -> float:
    return math.nan if value is None else float(value)


def main() -> None:
    """Run the trainer until SIGINT or SIGTERM."""
    usage = (
        "usage: bicycle_trainer [--ros-args -p NAME:=VALUE ... --params-file FILE]\n\n"
        "Learns to ride the bicycle. Parameters and their defaults:\n" + describe(TrainerSettings)
    )
    sys.exit(run(NAME, TrainerNode, usage))
