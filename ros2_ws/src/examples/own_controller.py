"""A controller of one's own as a node: docs/own-controller.md tells the contract."""

import math

import rclpy
from bicycle_msgs.msg import BicycleCommand, BicycleState
from rclpy.node import Node

GOAL = 20.0, 10.0


class OwnController(Node):
    """Answers every state with a torque."""

    def __init__(self) -> None:
        super().__init__("own_controller")
        self.commands = self.create_publisher(BicycleCommand, "bicycle/command", 5)
        self.create_subscription(BicycleState, "bicycle/state", self.answer, 1)

    def answer(self, state: BicycleState) -> None:
        """Answer one state, until the goal is reached."""
        x, y = GOAL[0] - state.rear_contact.x, GOAL[1] - state.rear_contact.y
        if state.fallen or math.hypot(x, y) < 1.0:
            return
        error = math.remainder(math.atan2(y, x) - state.heading, 2.0 * math.pi)
        command = BicycleCommand(episode=state.episode, step=state.step, has_goal=True)
        command.controller, command.policy = self.get_name(), "pd@1"
        command.goal.x, command.goal.y = GOAL
        command.torque = -26.0 * state.lean_angle - 14.4 * state.lean_rate
        command.torque -= 9.0 * state.steer_angle + 1.3 * state.steer_rate
        command.torque -= 2.6 * max(-0.4, min(0.4, error))
        self.commands.publish(command)


rclpy.init()
rclpy.spin(OwnController())
