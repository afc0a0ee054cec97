"""Change the code at random places and count the changes that the tests notice.

Install cosmic-ray (MIT) beside the tests' packages first; it makes the mutants:

    pip install cosmic-ray
    python tests/tools/mutants.py --out mutants.jsonl

The source files are changed in place and restored after each mutant, so run it on a clone of its
own. A stopped run goes on where it ended. Exit with 1 if fewer than 95 % of the mutants die.
"""

import argparse
import ast
import json
import random
import subprocess
import sys
from collections import Counter
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
BAG = "ros2_ws/src/bicycle_bag/bicycle_bag"
TOOLS = "ros2_ws/src/bicycle_tools/bicycle_tools/nodes"
BAG_TESTS = (
    "tests/bag/test_writer.py tests/bag/test_reader.py tests/bag/test_container.py"
    " tests/bag/test_bag_round_trip.py tests/bag/test_bag_metadata.py"
    " tests/bag/test_bag_syncing.py tests/bag/test_bag_flips.py"
    " tests/bag/test_bag_foreign_repair.py"
    " tests/bag --ignore=tests/bag/test_bag_fuzz.py"
)
"""The quick and the telling ones first, since the first failure ends a run."""

ROOMS: dict[str, tuple[tuple[str, ...], str]] = {
    "dynamics": (
        ("bicycle_sim/bicycle_sim/plants/choi/dynamics.py",),
        "tests/sim/test_dynamics.py tests/sim/test_errata.py tests/sim/test_plants.py",
    ),
    "gate": (
        ("bicycle_sim/bicycle_sim/runtime/command_validator.py",),
        "tests/sim/test_command_validator.py tests/sim/test_loop.py",
    ),
    "conversions": (
        ("ros2_ws/src/bicycle_common/bicycle_common/nodes/convert.py",),
        "tests/ros/test_convert.py",
    ),
    "writer": (
        (
            f"{BAG}/writer.py",
            f"{BAG}/mcap_file.py",
        ),
        BAG_TESTS,
    ),
    "reader": (
        (
            f"{BAG}/reader.py",
            f"{BAG}/container.py",
        ),
        BAG_TESTS,
    ),
    "verify": (
        (f"{TOOLS}/ride_recording.py", f"{TOOLS}/verify_states.py", f"{TOOLS}/verify.py"),
        "tests/ros/test_ride_recording.py tests/ros/test_verify_states.py"
        " tests/ros/test_verify.py",
    ),
    "safety": (
        ("bicycle_controller/bicycle_controller/control/safety.py",),
        "tests/controller/test_safety.py tests/controller/test_recoverable.py"
        " tests/controller/test_control_loop.py",
    ),
    "replay buffer": (
        ("bicycle_controller/bicycle_controller/data/replay_buffer.py",),
        "tests/controller/test_replay_buffer.py tests/controller/test_collector.py"
        " tests/controller/test_dataset.py",
    ),
}
"""Name → files that are changed, tests that should notice."""

PASSED = 0
FAILED = 1
"""Exit statuses of pytest that are a verdict; any other also means that the mutant was noticed."""


def annotations(code: str) -> set[tuple[int, int]]:
    """Return the (line, column) of each place in an annotation, which no test can see."""
    found: set[tuple[int, int]] = set()
    for node in ast.walk(ast.parse(code)):
        for part in (getattr(node, "annotation", None), getattr(node, "returns", None)):
            if part is not None:
                lines = range(part.lineno, (part.end_lineno or part.lineno) + 1)
                for line in lines:
                    start = part.col_offset if line == part.lineno else 0
                    end = part.end_col_offset if line == part.end_lineno else 200
                    found |= {(line, column) for column in range(start, (end or 200) + 1)}
    return found


def all_mutants(files: tuple[str, ...]) -> list[dict[str, Any]]:
    """Return every mutant of the files that cosmic-ray knows, but for those in annotations."""
    from cosmic_ray.commands.init import init  # type: ignore[import-not-found, import-untyped, unused-ignore]
    from cosmic_ray.work_db import use_db  # type: ignore[import-not-found, import-untyped, unused-ignore]

    mutants = []
    with use_db(":memory:") as database:
        init([ROOT / file for file in files], database, {})
        for item in database.work_items:
            (mutation,) = item.mutations
            path = str(Path(mutation.module_path).relative_to(ROOT))
            mutants.append(
                {
                    "file": path,
                    "operator": mutation.operator_name,
                    "occurrence": mutation.occurrence,
                    "line": mutation.start_pos[0],
                    "column": mutation.start_pos[1],
                    "function": mutation.definition_name,
                }
            )
    unseen = {file: annotations((ROOT / file).read_text()) for file in files}
    mutants = [m for m in mutants if (m["line"], m["column"]) not in unseen[m["file"]]]
    return sorted(mutants, key=lambda m: (m["file"], m["operator"], m["occurrence"]))


def run_one(mutant: dict[str, Any], tests: str, limit: float) -> dict[str, Any]:
    """Return the mutant with its outcome: killed, survived, timeout or impossible."""
    from cosmic_ray.mutating import mutate_code  # type: ignore[import-not-found, import-untyped, unused-ignore]
    from cosmic_ray.plugins import get_operator  # type: ignore[import-not-found, import-untyped, unused-ignore]

    path = ROOT / mutant["file"]
    before = path.read_text()
    try:
        changed = mutate_code(before, get_operator(mutant["operator"])(), mutant["occurrence"])
    except AttributeError:  # cosmic-ray cannot replace `except module.Name`
        return mutant | {"outcome": "impossible"}
    try:
        path.write_text(changed)
        command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider"]
        try:
            done = subprocess.run(
                [*command, *tests.split()],
                cwd=ROOT,
                timeout=limit,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
            )
            outcome = "survived" if done.returncode == PASSED else "killed"
        except subprocess.TimeoutExpired:
            outcome = "timeout"
    finally:
        path.write_text(before)
    return mutant | {"outcome": outcome}


def main() -> int:
    """Run the sample and print the score of each room."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--out", type=Path, required=True, help="JSON lines, one a mutant")
    parser.add_argument("--count", type=int, default=304, help="mutants in all (default: 304)")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--room", action="append", choices=list(ROOMS), help="default: all")
    parser.add_argument("--limit", type=float, default=900.0, help="s of one run of tests")
    options = parser.parse_args()

    results = []
    if options.out.exists():
        results = [json.loads(line) for line in options.out.read_text().splitlines()]
    seen = {(r["file"], r["operator"], r["occurrence"]) for r in results}
    for room in options.room or ROOMS:
        files, tests = ROOMS[room]
        mutants = all_mutants(files)
        sample = random.Random(f"{options.seed} {room}").sample(
            mutants, min(len(mutants), options.count // len(ROOMS))
        )
        for mutant in sample:
            if (mutant["file"], mutant["operator"], mutant["occurrence"]) in seen:
                continue
            result = run_one(mutant, tests, options.limit) | {"room": room}
            results.append(result)
            with options.out.open("a") as out:
                out.write(json.dumps(result) + "\n")
            print(f"{room}: {result['outcome']}, {mutant['file']}:{mutant['line']}", flush=True)
    return report(results)


def report(results: list[dict[str, Any]]) -> int:
    """Print a table of the rooms and return 0 if at least 95 % of the mutants died."""
    total, died = Counter[str](), Counter[str]()
    for result in results:
        if result["outcome"] == "impossible":
            continue
        for room in (result["room"], "all"):
            total[room] += 1
            died[room] += result["outcome"] != "survived"
    for room, number in total.items():
        print(f"{room}: {died[room]} of {number} mutants died, {died[room] / number:.1%}")
    return 0 if died["all"] >= 0.95 * total["all"] else 1


if __name__ == "__main__":
    sys.exit(main())
