"""Publishes numbered bicycle states and one latched episode, for the recorder to hear."""

from __future__ import annotations

import argparse
import time

import rclpy
from bicycle_msgs.msg import BicycleState, EpisodeInfo
from rclpy.duration import Duration
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile


def wait_for_subscriber(publisher: Publisher) -> None:
    while publisher.get_subscription_count() == 0:
        time.sleep(0.02)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--hz", type=float, default=200.0)
    options = parser.parse_args()
    rclpy.init(args=[])
    node = rclpy.create_node("talker", enable_rosout=False)
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    episodes = node.create_publisher(EpisodeInfo, "bicycle/episode", latched)
    states = node.create_publisher(BicycleState, "bicycle/state", 10)
    episodes.publish(EpisodeInfo(episode=1, pace="realtime", seed=7))
    wait_for_subscriber(states)
    wait_for_subscriber(episodes)
    print("heard", flush=True)
    message = BicycleState(episode=1)
    message.header.frame_id = "odom"
    for step in range(options.count):
        message.step = step
        message.lean_angle = 0.001 * step
        states.publish(message)
        if step % 100 == 0:
            print(f"step {step}", flush=True)
        time.sleep(1.0 / options.hz)
    states.wait_for_all_acked(Duration(seconds=5.0))
    episodes.wait_for_all_acked(Duration(seconds=5.0))
    print("said", flush=True)
    node.destroy_node()
    rclpy.try_shutdown()


if __name__ == "__main__":
    main()
