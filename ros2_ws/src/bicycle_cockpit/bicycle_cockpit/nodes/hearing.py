"""Subscriptions: keep the messages' content in `RideState`, and report events to the pages."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict
from typing import Any, Protocol

from bicycle_msgs.msg import (
    BicycleCommand,
    BicycleState,
    CommandEcho,
    EpisodeInfo,
    GoalStatus,
    HandOver,
    PathStatus,
    Push,
    TrainerStatus,
)
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path
from rclpy.node import Node
from rclpy.qos import QoSProfile

from bicycle_cockpit import goal_words, who_rides
from bicycle_cockpit.followed_paths import thinned
from bicycle_cockpit.hand_over_words import explained
from bicycle_cockpit.marks import push_text
from bicycle_cockpit.nodes import conversions
from bicycle_cockpit.ride_state import RideState
from bicycle_cockpit.riders import lqr_names, rider, shipped_names
from bicycle_cockpit.trouble import Trouble
from bicycle_common.nodes import convert, topics
from bicycle_common.nodes.diagnostics import entries_of
from bicycle_common.nodes.topics import listen
from bicycle_controller.control.goals import Status
from bicycle_sim.nodes.episode_setting import to_setting
from bicycle_sim.plants import registry

DEEP = 500
"""Queue length while the node is busy: 12 s of states; a path makes many goals."""
OLD_NEWS = 3.0
"""Age up to which a new cockpit reports goals' changes from before its start (s)."""


class Tell(Protocol):
    """Reports an event to all pages; see `RideState.event`."""

    def __call__(self, level: str, text: str, **more: Any) -> None:
        """Report the event."""


class Hearing:
    """All subscriptions; belongs to the executor's thread.

    Args:
        node: that subscribes.
        live: state of the ride.
        trouble: is told which processes speak.
        tell: reports events to the pages.
        newest: sends the pages data that replace older data of their `type`.
    """

    def __init__(
        self,
        node: Node,
        live: RideState,
        trouble: Trouble,
        tell: Tell,
        newest: Callable[[dict[str, Any]], None],
    ) -> None:
        self._node, self._live, self._trouble = node, live, trouble
        self._tell, self._newest = tell, newest
        self._command: BicycleCommand | None = None
        self._estimate: BicycleState | None = None
        self._echoes: dict[tuple[int, int], CommandEcho] = {}
        self._fallen = False
        self._path: list[list[float | None]] = []
        self._shown_path: list[list[float | None]] = []
        self._news = goal_words.NewsFilter()
        self._began = time.monotonic()
        self._began_ns = time.time_ns()
        live.names |= {**shipped_names(), **lqr_names(registry.default())}
        listen(node, topics.COMMAND_ECHO, self._on_echo, depth=DEEP)
        listen(node, topics.STATE, self._on_state, depth=DEEP)
        listen(node, topics.COMMAND, self._on_command)
        listen(node, topics.ESTIMATE, self._on_estimate)
        listen(node, topics.TIMING, live.loop.add)
        listen(node, topics.EPISODE, self._on_episode)
        listen(node, topics.DIAGNOSTICS, self._on_diagnostics)
        listen(node, topics.PUSHED, self._on_pushed)
        listen(node, topics.HAND_OVER, self._on_hand_over)
        listen(node, topics.TRAINER, self._on_trainer)
        listen(node, topics.FOLLOWED_PATH, self._on_path)
        listen(node, topics.PATH_STATUS, self._on_path_status)
        listen(node, topics.ACTIVE_GOAL, self._on_active_goal)
        for topic in (topics.GOAL_POSE, topics.GOAL_PATH, topics.ORDERED_GOALS):
            listen(node, topic, lambda message: live.goals.sent(conversions.points_of(message)))
        topic = topics.GOAL_STATUS
        wanted = topic.subscribe
        profile = QoSProfile(
            depth=DEEP, reliability=wanted.reliability, durability=wanted.durability
        )
        node.create_subscription(topic.type, topic.name, self._on_goal_status, profile)

    def look(self) -> None:
        """Report a new riding policy, if nothing else has explained it."""
        policy = self._live.who.settled()
        if policy:
            self._tell("info", f"{self._name(policy)} rides", kind="policy")

    def _name(self, policy: str) -> str:
        return rider(policy, self._live.names).label

    def _on_state(self, state: BicycleState) -> None:
        live = self._live
        self._trouble.heard("simulator")
        fell = state.fallen and not self._fallen
        self._fallen = state.fallen
        if state.fallen:
            live.mode = "fallen"
        elif live.mode == "fallen":
            live.mode = "paused" if live.paused else "held"
        if live.due() or fell:
            policy = self._command.policy if self._command is not None else ""
            number = live.policy_number(policy)
            echo = self._echoes.pop((state.episode, state.step), None)
            sample = conversions.to_sample(
                state, echo, self._command, live.weights, number, self._estimate
            )
            moved = live.add(sample)
            if moved and state.step > 0 and live.mode == "held":
                live.mode = "riding"
        if fell:
            self._tell("bad", "the bicycle fell: press Reset to set it up again", kind="fell")

    def _on_estimate(self, estimate: BicycleState) -> None:
        self._estimate = estimate

    def _on_echo(self, echo: CommandEcho) -> None:
        while len(self._echoes) >= DEEP:
            del self._echoes[next(iter(self._echoes))]
        self._echoes[echo.episode, echo.step] = echo

    def _on_command(self, command: BicycleCommand) -> None:
        live = self._live
        known = self._command is not None and command.policy == self._command.policy
        self._command = command
        live.who.commanded(command.policy)
        if not known:
            live.policy_number(command.policy)
            self._newest(live.riders())

    def _on_hand_over(self, change: HandOver) -> None:
        live = self._live
        why = explained(change.reason, change.message, change.policy, live.names)
        name = self._name(change.policy)
        if change.reason == HandOver.NONE and not change.stop:
            live.who.handed_back(change.policy)
            self._tell("info", f"{name} rides again: {why}", kind="hand_back")
            return
        stamp = change.header.stamp
        since = stamp.sec + 1e-9 * stamp.nanosec
        taken = who_rides.HandOver(change.policy, why, since, bool(change.stop))
        live.who.handed_over(taken)
        if since >= live.time - OLD_NEWS:
            self._tell("warn", f"{name} takes over: {why}", kind="hand_over")

    def _on_episode(self, info: EpisodeInfo) -> None:
        live = self._live
        try:
            scenario, plant = to_setting(info)
        except (ValueError, TypeError) as error:
            self._node.get_logger().warning(
                f"episode info ignored: {error}; are both of one version?"
            )
            return
        live.weights = scenario.reward
        live.setting = (plant, scenario)
        live.names |= lqr_names(plant)
        live.facts = {
            "episode": int(info.episode),
            "seed": int(info.seed),
            "pace": info.pace,
            "scenario": scenario.name,
            "goal_radius": scenario.goal_radius,
            "fall_angle": scenario.fall_angle,
            "limits": [float(limit) for limit in scenario.action_limits],
            "wheelbase": plant.geometry.wheelbase,
            "geometry": asdict(plant.geometry),
            "bicycle": plant.label,
            "plant": plant.name,
            "time_step": plant.time_step,
            "steer_stop": plant.geometry.steer_stop,
        }
        self._newest({"type": "facts", **live.facts})
        self._tell("info", f"episode {info.episode} begins, seed {info.seed}", kind="reset")

    def _on_diagnostics(self, array: DiagnosticArray) -> None:
        live = self._live
        entries = entries_of(self._node.get_namespace(), array)
        simulator = conversions.simulator_word(entries)
        if simulator is not None:
            live.mode, live.paused, live.commands_text = simulator
        controller = conversions.controller_word(entries)
        if controller is not None:
            self._trouble.heard("controller")
            live.who.put_in_charge(controller.policy)
            live.unlike = controller.unlike

    def _on_goal_status(self, change: GoalStatus) -> None:
        place = (float(change.position.x), float(change.position.y))
        self._live.goals.changed(change.status, place, int(change.remaining))
        status = Status(change.status)
        if not self._news.is_new(status, place) or self._is_old(change):
            return
        where = {"x": place[0], "y": place[1]} if place[0] == place[0] else {}
        self._tell(
            goal_words.level(status),
            goal_words.text(status, place, change.message),
            kind=goal_words.kind(status),
            **where,
        )

    def _on_active_goal(self, goal: PoseStamped) -> None:
        """Keep the direction of arrival; the status alone says which goal is pursued."""
        (point,) = conversions.points_of(goal)
        self._live.goals.headed(point, convert.arrival_of(goal.pose.orientation))

    def _is_old(self, change: GoalStatus) -> bool:
        """Return True if it is older than this cockpit, and latched."""
        stamp = change.header.stamp
        before = stamp.sec * 10**9 + stamp.nanosec < self._began_ns
        return before and time.monotonic() - self._began < OLD_NEWS

    def _on_path(self, path: Path) -> None:
        """Keep the path that is followed, thinned, for the pages."""
        self._path = thinned(conversions.points_of(path))

    def _on_path_status(self, status: PathStatus) -> None:
        """Show the path while it is followed, and report its end."""
        if status.status == PathStatus.ACTIVE:
            if self._path != self._shown_path:
                self._show_path(self._path)
            return
        subject = f"path {status.name}".rstrip()
        if status.status == PathStatus.REJECTED:
            # The topic is latched: a new cockpit also receives messages from before its start.
            if time.monotonic() - self._began > OLD_NEWS:
                self._tell("bad", f"{subject} refused: {status.message}", kind="path")
            return
        if self._shown_path:
            self._show_path([])
            finished = status.status == PathStatus.FINISHED
            self._tell("good" if finished else "warn", f"{subject}: {status.message}", kind="path")

    def _show_path(self, points: list[list[float | None]]) -> None:
        self._shown_path = points
        self._newest({"type": "path", "points": points})

    def _on_pushed(self, push: Push) -> None:
        self._tell("info", push_text(push.lean_rate), kind="push")

    def _on_trainer(self, status: TrainerStatus) -> None:
        facts = conversions.trainer_facts(status)
        self._live.trained(facts)
        self._newest(facts)
