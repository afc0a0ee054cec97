"""Does the recorder keep up with 50 times the stack's own message rate?

A real ride of the stack, in real time, gives the messages and their rate. One process then
publishes them again and again, evenly, each on its own topic with the QoS that was recorded, at
a multiple of that rate; recorder and publisher are processes of their own over DDS on loopback.
Sent, recorded and lost must add up. Beyond what the recorder can do it shall lose and say so.

    python tests/benchmarks/bench_record.py [--seconds 30] [--times 10 25 50 100] [--out FILE]
"""

from __future__ import annotations

import argparse
import json
import re
import resource
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import rclpy
from machine import machine
from rclpy.duration import Duration

from bicycle_bag.nodes.session import message_class, publisher_profile
from bicycle_bag.reader import BagReader
from bicycle_controller.training.run_folder import origin

ROOT = Path(__file__).resolve().parents[2]
RESULTS = Path(__file__).parent / "results" / "record.json"
OWN = r"^/(rosout|parameter_events)$"
"""Topics that every node has, so the publisher too."""
QUEUE = 1000
FOUND_WITHIN = 30.0
BURST = 0.002
"""s, how often the publisher wakes up."""


def publish(bag: Path, rate: float, seconds: float) -> None:
    """Publish a bag's messages evenly; prints how many and in what time."""
    reader = BagReader(bag)
    rclpy.init(args=[])
    node = rclpy.create_node("flood", enable_rosout=False, start_parameter_services=False)
    messages = [
        (item.topic, item.data) for item in reader.messages() if not re.match(OWN, item.topic)
    ]
    publishers = {
        name: node.create_publisher(
            message_class(reader.topics[name].type),
            name,
            publisher_profile(reader.topics[name].qos, QUEUE, 1),
        )
        for name in {topic for topic, _ in messages}
    }
    deadline = time.monotonic() + FOUND_WITHIN
    while not all(each.get_subscription_count() for each in publishers.values()):
        assert time.monotonic() < deadline, "nobody records"
        time.sleep(0.05)
    time.sleep(1.0)
    began, sent, count = time.monotonic(), 0, int(rate * seconds)
    while sent < count:
        due = min(count, int((time.monotonic() - began) * rate))
        while sent < due:
            topic, data = messages[sent % len(messages)]
            publishers[topic].publish(data)
            sent += 1
        time.sleep(BURST)
    took = time.monotonic() - began
    for each in publishers.values():
        each.wait_for_all_acked(Duration(seconds=20.0))
    used = resource.getrusage(resource.RUSAGE_SELF)
    print(json.dumps({"sent": sent, "seconds": took, "cpu (s)": used.ru_utime + used.ru_stime}))


def ride(folder: Path) -> Path:
    """Return a real ride in real time; its bag."""
    program, options = ROOT / "ros2_ws" / "ride.sh", ("--goals", "3", "--seed", "1")
    subprocess.run([program, *options, "--output", folder], check=True, stdout=subprocess.DEVNULL)
    return folder / "bag"


def lost_by_topic(printed: str) -> dict[str, int]:
    """Return the recorder's warnings."""
    counts: dict[str, int] = {}
    for count, topic in re.findall(r"(\d+) messages of (\S+) lost: too many", printed):
        counts[topic] = counts.get(topic, 0) + int(count)
    return counts


def record(bag: Path, rate: float, seconds: float, folder: Path) -> dict[str, Any]:
    """Take one turn of publisher and recorder."""
    words = [sys.executable, "-m", "bicycle_bag.nodes.recorder_node", "--output", str(folder)]
    recorder = subprocess.Popen(
        [*words, "--exclude", OWN], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    flood = [sys.executable, __file__, "--flood", str(bag), str(rate), str(seconds)]
    done = subprocess.run(flood, check=True, capture_output=True, text=True)
    sent = json.loads(done.stdout.splitlines()[-1])
    recorder.send_signal(signal.SIGINT)
    printed = recorder.communicate(timeout=60.0)[0]
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    found = re.search(r"recorded (\d+) messages.* (\d+) lost on the way", printed)
    assert recorder.returncode == 0, printed
    assert found, printed
    recorded, lost = int(found[1]), int(found[2])
    reader = BagReader(folder)
    assert sum(1 for _ in reader.messages()) == reader.message_count == recorded
    late = [(item.log_time_ns - item.publish_time_ns) * 1e-6 for item in reader.messages()]
    late.sort()
    return {
        "sent": sent["sent"],
        "sent per second": round(sent["sent"] / sent["seconds"]),
        "recorded": recorded,
        "lost, as the recorder counts": lost,
        "unaccounted": sent["sent"] - recorded - lost,
        "lost by topic": lost_by_topic(printed),
        "publisher to recorder p50, p99, largest (ms)": [
            round(late[int(q * (len(late) - 1))], 1) for q in (0.5, 0.99, 1.0)
        ],
        "bytes on disk": sum(path.stat().st_size for path in folder.glob("*.mcap")),
        "cpu of all so far (s)": round(used.ru_utime + used.ru_stime, 1),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, allow_abbrev=False)
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--times", type=float, nargs="+", default=[10, 25, 50, 100])
    parser.add_argument("--out", type=Path, default=RESULTS)
    parser.add_argument("--flood", nargs=3, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.flood:
        publish(Path(given.flood[0]), float(given.flood[1]), float(given.flood[2]))
        return
    with tempfile.TemporaryDirectory() as name:
        bag = ride(Path(name, "ride"))
        reader = BagReader(bag)
        own = reader.message_count / (reader.duration_ns * 1e-9)
        results: dict[str, Any] = {
            **origin(),
            "machine": machine("ros-jazzy-rclpy", "mcap"),
            "seconds": given.seconds,
            "the stack's own messages per second": round(own, 1),
            "turns": {},
        }
        for times in given.times:
            turn = record(bag, own * times, given.seconds, Path(name, f"bag-{times:g}"))
            results["turns"][f"{times:g}"] = turn
            print(times, json.dumps(turn), flush=True)
            given.out.write_text(json.dumps(results, indent=2) + "\n")


if __name__ == "__main__":
    main()
