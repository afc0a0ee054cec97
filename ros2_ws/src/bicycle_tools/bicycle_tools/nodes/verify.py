"""`replay.sh --verify`: a bag's states and estimates computed again, compared bit for bit."""

from __future__ import annotations

if __name__ == "__main__":
    from bicycle_common.signals import run_module

    run_module("bicycle_tools.nodes.verify")

import sys
from collections import deque
from pathlib import Path

from bicycle_bag.errors import BagError
from bicycle_bag.versions import TodaysReader
from bicycle_common.command_line import OneLineParser
from bicycle_common.progress import ProgressBar
from bicycle_tools.nodes import (
    ride_recording,
    sensed_recording,
    verify_estimates,
    verify_states,
)
from bicycle_tools.nodes.sensed_recording import ENCODERS, IMU, SETUP
from bicycle_tools.nodes.verify_estimates import EstimateVerdict
from bicycle_tools.nodes.verify_states import StateVerdict
from bicycle_tools.ride_log import EPISODE


def verdicts_of(path: Path) -> list[StateVerdict | EstimateVerdict]:
    """Return the verdicts about a bag: of its states, and of its estimates where it has some.

    States of a microcontroller's ride are measured and cannot be computed again.

    Raises:
        BagError: if the bag cannot be read or verified.
    """
    found: list[StateVerdict | EstimateVerdict] = []
    reader = TodaysReader(path)
    if not sensed_recording.is_hardware(reader):
        recording, verdict = ride_recording.read(path), StateVerdict()
        steps = verify_states.verify(recording)
        with ProgressBar(steps, total=len(recording.states), unit="state") as bar:
            found.append(deque(bar, maxlen=1).pop() if recording.states else verdict)
    elif not sensed_recording.has_estimates(reader):
        raise BagError(
            f"{path} holds a ride of a real bicycle without {SETUP}, {IMU}, {ENCODERS} and "
            f"{EPISODE}: record all topics to verify it"
        )
    if sensed_recording.has_estimates(reader):
        sensed, estimated = sensed_recording.read(reader), EstimateVerdict()
        checks = verify_estimates.verify(sensed)
        with ProgressBar(checks, total=len(sensed.estimates), unit="estimate") as line:
            found.append(deque(line, maxlen=1).pop() if sensed.estimates else estimated)
    return found


def main() -> int:
    """Verify the bag of the command line; return the exit status."""
    parser = OneLineParser(prog="replay.sh --verify", description=__doc__)
    parser.add_argument("bag", type=Path, help="bag directory or .mcap file")
    path = parser.parse_args().bag
    try:
        verdicts = verdicts_of(path)
    except BagError as error:
        print(f"replay.sh --verify: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("replay.sh --verify: interrupted", file=sys.stderr)
        return 130
    for verdict in verdicts:
        print(f"{path}: {verdict}")
    return 0 if all(verdict.same for verdict in verdicts) else 1
