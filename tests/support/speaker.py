"""Publishes numbered texts for the recorder to hear: one on each topic, then the next."""

from __future__ import annotations

import argparse
import signal
import time

import rclpy
from rclpy.duration import Duration
from rclpy.qos import QoSProfile, ReliabilityPolicy
from std_msgs.msg import String


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("topics", nargs="+")
    parser.add_argument("--best-effort", action="store_true")
    parser.add_argument("--count", type=int, default=30)
    parser.add_argument("--hz", type=float, default=50.0, help="0 does not rest")
    parser.add_argument("--bytes", type=int, default=0, help="that follow each number")
    parser.add_argument("--depth", type=int, default=5000, help="messages kept for the slow")
    parser.add_argument("--wait", action="store_true", help="for SIGUSR1 before the first message")
    parser.add_argument("--halt", type=int, nargs="*", default=[], help="and before these numbers")
    options = parser.parse_args()
    signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGUSR1])
    rclpy.init(args=[])
    node = rclpy.create_node("speaker", enable_rosout=False)
    reliability = ReliabilityPolicy["BEST_EFFORT" if options.best_effort else "RELIABLE"]
    quality = QoSProfile(depth=options.depth, reliability=reliability)
    publishers = [node.create_publisher(String, name, quality) for name in options.topics]
    while any(one.get_subscription_count() == 0 for one in publishers):
        time.sleep(0.02)
    print("heard", flush=True)
    if options.wait:
        signal.sigwait([signal.SIGUSR1])
    for number in range(options.count):
        if number in options.halt:
            print(f"halts at {number}", flush=True)
            signal.sigwait([signal.SIGUSR1])
        for publisher in publishers:
            publisher.publish(String(data=f"{number} " + options.bytes * "x"))
        if options.hz:
            time.sleep(1.0 / options.hz)
    print("said", flush=True)
    for publisher in publishers:
        publisher.wait_for_all_acked(Duration(seconds=60.0))
    if options.best_effort:
        time.sleep(1.0)  # nobody tells whether the last one has come
    node.destroy_node()
    rclpy.try_shutdown()


if __name__ == "__main__":
    main()
