"""The import law: the table of docs/architecture.md, by walking the sources."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass, fields
from pathlib import Path

import pytest

from bicycle_common import topic_names
from bicycle_sim.plants.base import Geometry, Plant
from bicycle_sim.plants.choi.compiled import NAMES, SWITCHES
from bicycle_sim.plants.choi.parameters import Constants, Physics

ROOT = Path(__file__).parent.parent
SOURCES = {
    folder.name: folder
    for place in (ROOT, ROOT / "ros2_ws" / "src")
    for folder in (package / package.name for package in sorted(place.glob("bicycle_*")))
    if (folder / "__init__.py").is_file()
}
"""Folder of the sources of each Python package."""

ROS = ("rclpy", "rosidl_parser", "launch", "launch_ros")


@dataclass(frozen=True)
class Room:
    """A row of the table."""

    name: str
    imports: frozenset[str]
    libraries: frozenset[str]


def table() -> list[Room]:
    """Return the rooms in the order of the page."""
    page = (ROOT / "docs" / "architecture.md").read_text()
    section = page.partition("## Layers")[2].partition("\n## ")[0]
    rows = [
        line.strip().strip("|").split("|")
        for line in section.splitlines()
        if line.startswith("| `")
    ]
    return [
        Room(
            _names(row[0])[0],
            frozenset(_names(row[2])),
            frozenset(word.strip() for word in row[3].split(",") if word.strip()),
        )
        for row in rows
    ]


def _names(cell: str) -> list[str]:
    return re.findall(r"`([\w.]+)`", cell)


ROOMS = table()


def room_of(module: str) -> str:
    """Return the most special room that holds a module; empty if none does."""
    held = [room.name for room in ROOMS if f"{module}.".startswith(f"{room.name}.")]
    return max(held, key=len, default="")


def module_of(package: str, path: Path) -> str:
    parts = (package, *path.relative_to(SOURCES[package]).with_suffix("").parts)
    return ".".join(parts).removesuffix(".__init__")


MODULES = {
    module_of(package, path): path
    for package, folder in SOURCES.items()
    for path in sorted(folder.rglob("*.py"))
}


def imported(path: Path) -> Iterator[str]:
    """Full names of the modules that a source file imports, wherever in it."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: a relative import"
            assert node.module
            for alias in node.names:
                full = f"{node.module}.{alias.name}"
                yield full if full in MODULES else node.module


def library(module: str) -> str:
    """Return a library's name in the table; empty for Python's own and for ours."""
    top = module.partition(".")[0]
    if top in sys.stdlib_module_names or top in SOURCES:
        return ""
    return "ROS" if top in ROS or top.endswith(("_msgs", "_srvs", "_interfaces")) else top


OLD_NAMES = ("bicycle_sim.gym_env",)
"""Modules that hand on what moved."""


def bare(module: str) -> bool:
    """Return True if it needs no room: a package itself, its console scripts, or an old name."""
    package, _, rest = module.partition(".")
    return package in SOURCES and (rest in ("", "programs") or module in OLD_NAMES)


def test_every_module_has_a_room() -> None:
    assert len(MODULES) > 250
    homeless = [module for module in MODULES if not room_of(module) and not bare(module)]
    assert homeless == []
    assert {room_of(module) for module in MODULES} - {""} == {room.name for room in ROOMS}


def test_rooms_stand_below_those_that_they_import() -> None:
    above: set[str] = set()
    for room in ROOMS:
        assert room.imports <= above, f"{room.name} imports a room that stands below it"
        above.add(room.name)


@pytest.mark.parametrize("room", ROOMS, ids=lambda room: room.name)
def test_a_room_imports_what_its_row_names(room: Room) -> None:
    rooms: dict[str, str] = {}
    libraries: dict[str, str] = {}
    for module, path in MODULES.items():
        if room_of(module) != room.name:
            continue
        for name in imported(path):
            if name in SOURCES:
                continue
            if ours := room_of(name):
                rooms.setdefault(ours, f"{module} imports {name}")
            elif theirs := library(name):
                libraries.setdefault(theirs, f"{module} imports {name}")
    rooms.pop(room.name, None)
    assert {name: why for name, why in rooms.items() if name not in room.imports} == {}
    assert {name: why for name, why in libraries.items() if name not in room.libraries} == {}
    assert room.imports - rooms.keys() == set(), "the row names rooms that are not imported"
    assert room.libraries - libraries.keys() == set(), "and libraries"


KNOWN_BY_NAME = {
    "bicycle_controller.config.imitation": "names ranges of random Whipple bicycles",
    "bicycle_controller.training.bicycle_park": "rides them",
    "bicycle_controller.estimation.arithmetic": "takes its sine, the same on every processor",
    "bicycle_controller.identification.unknowns": "fits the numbers of a Whipple bicycle",
    "bicycle_controller.identification.ride_model": "its linear equations, with its motor",
    "bicycle_controller.identification.curvature": "rides it beside them",
    "bicycle_controller.identification.fitting": "hands it on",
    "bicycle_controller.identification.identify": "hands it on",
    "bicycle_controller.identification.score": "hands it on",
    "bicycle_controller.cli.identify": "reads a bicycle's file",
    "bicycle_controller.cli.info": "describes Whipple bicycles",
    "bicycle_controller.cli.eigenvalue_chart": "draws their eigenvalues",
}
"""Modules outside of the plants that may name a kind of plant, and why; all others take any."""


def test_plants_are_known_by_what_every_plant_has() -> None:
    kinds = ("bicycle_sim.plants.choi", "bicycle_sim.plants.whipple")
    found = {
        module
        for module, path in MODULES.items()
        if room_of(module) != "bicycle_sim.plants"
        and any(f"{name}.".startswith(f"{kind}.") for name in imported(path) for kind in kinds)
    }
    assert found == set(KNOWN_BY_NAME)


def test_table_1_is_known_to_the_papers_plant_alone() -> None:
    words = re.compile(r"import .*\bConstants\b|choi import (linear|dynamics)|choi\.(linear|dyn)")
    found = [
        module
        for module, path in MODULES.items()
        if room_of(module) != "bicycle_sim.plants" and words.search(path.read_text())
    ]
    assert found == []


NAMES_OF_TABLE_1 = {
    "bicycle_sim/nodes/sim_settings.py": "its switches are ROS parameters, which must stay",
}
"""Sources outside of the plants that may name a number of the paper's bicycle, and why."""

COMPILED = {"bicycle_sim/task/native_task.cpp": "../plants/choi/step.h"}
"""The one line of each C++ source that says which plant it is compiled for."""


def outside_the_plants() -> dict[str, str]:
    """Return the text of all sources in Python, C++ and JavaScript but the plants'."""
    plants = SOURCES["bicycle_sim"] / "plants"
    return {
        f"{package}/{path.relative_to(folder)}": path.read_text()
        for package, folder in SOURCES.items()
        for path in sorted(folder.rglob("*"))
        if path.suffix in (".py", ".cpp", ".h", ".js")
        and plants not in path.parents
        and "vendor" not in path.parts
    }


def test_the_names_of_table_1_stand_in_the_papers_plant_alone() -> None:
    own = {item.name for kind in (Constants, Physics) for item in fields(kind)}
    own |= {name for name, value in vars(Constants).items() if isinstance(value, property)}
    own |= {*NAMES, *SWITCHES}
    own -= {item.name for item in fields(Geometry)} | set(dir(Plant))
    words = re.compile(rf"\b({'|'.join(name for name in sorted(own) if '_' in name)})\b")
    sources = outside_the_plants()
    assert {Path(name).suffix for name in sources} == {".py", ".cpp", ".h", ".js"}
    assert {name for name, text in sources.items() if words.search(text)} == set(NAMES_OF_TABLE_1)


VALUES_OF_TABLE_1 = {
    "bicycle_controller/policy/trained_for.py": "an example in a docstring",
    "bicycle_sim/task/gym_env.py": "the documentation of its observations",
}
"""Sources outside of the plants with the paper's wheelbase or steering stop, and why."""


def test_the_values_of_table_1_stand_in_the_papers_plant_alone() -> None:
    """The page is told the geometry of every bicycle, and looks for no value of its own."""
    values = (Constants.wheelbase, Constants.steer_stop)
    either = "|".join(re.escape(str(value)) for value in values)
    value = re.compile(rf"(?<![\d.])({either})(?!\d)")
    found = {name for name, text in outside_the_plants().items() if value.search(text)}
    assert found == set(VALUES_OF_TABLE_1)


ASKED_FOR_BY_NAME = {
    "bicycle_controller/config/loading.py": "the plant of a configuration that names none",
    "bicycle_cockpit/ride_setup.py": "the plant that is chosen at first",
    "bicycle_cockpit/web/panels.js": "its label, faithful or corrected, needs the word paper's",
}
"""Sources that may use the default plant's name, and for what."""


def test_no_plant_is_treated_apart_by_its_name() -> None:
    name = re.compile(r"default\(\)\.name|ChoiPlant|[\"']choi[\"'] [!=]=|[!=]= [\"']choi[\"']")
    sources = outside_the_plants()
    found = {source for source, text in sources.items() if name.search(text)}
    assert found == set(ASKED_FOR_BY_NAME)


def test_compiled_code_names_its_plant_once() -> None:
    for name, text in outside_the_plants().items():
        if name.endswith((".cpp", ".h")):
            lines = [line for line in text.splitlines() if re.search("choi|whipple", line)]
            header = COMPILED.get(name)
            wanted = [f'#include "{header}"', "using Plant = choi::Step;"] if header else []
            assert [line.partition("  //")[0] for line in lines] == wanted, name


def test_the_simulator_knows_neither_goals_nor_rewards() -> None:
    """It only echoes commands, so that a real bicycle can stand in its place."""
    words = re.compile(r"task\.reward|heading_error|goal_(distance|radius|status)|[Tt]ransition")
    rooms = ("bicycle_sim.runtime", "bicycle_sim.nodes")
    found = {
        module: words.findall(path.read_text())
        for module, path in MODULES.items()
        if room_of(module) in rooms
    }
    assert len(found) > 10
    assert [module for module, known in found.items() if known] == []


WORDS_THAT_ARE_NOT_TOPICS = {
    "odom": "a frame",
    "follow_path": "the name of an action of Nav2",
}
"""Literals that are equal to the name of a topic by chance, and what they are."""


def test_the_names_of_topics_stand_in_one_module() -> None:
    home = "bicycle_common.topic_names"
    names = {
        value.lstrip("/")
        for name, value in vars(topic_names).items()
        if name.isupper() and isinstance(value, str)
    }
    launch_files = sorted((ROOT / "ros2_ws/src/bicycle_bringup/launch").glob("*.py"))
    modules = [path for module, path in MODULES.items() if module != home]
    found = {
        f"{path.name}: {node.value}"
        for path in [*modules, *launch_files]
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
        if node.value.lstrip("/") in names - WORDS_THAT_ARE_NOT_TOPICS.keys()
    }
    assert len(names) > 40
    assert len(launch_files) >= 5
    assert found == set()


def test_no_module_is_in_a_circle_of_imports() -> None:
    arrows = {
        module: {name for name in imported(path) if name in MODULES and name != module}
        for module, path in MODULES.items()
    }
    while free := [module for module, names in arrows.items() if not names & arrows.keys()]:
        for module in free:
            del arrows[module]
    assert sorted(arrows) == []


def test_no_name_of_a_class_stands_for_three_things() -> None:
    """Two may meet where each says its own of a word, such as Score; more are a riddle."""
    named: dict[str, list[str]] = {}
    for module, path in MODULES.items():
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                named.setdefault(node.name, []).append(module)
    assert len(named) > 400
    assert {name: places for name, places in named.items() if len(places) > 2} == {}


@pytest.mark.parametrize(
    "module",
    [
        "bicycle_sim.runtime.simulator",
        "bicycle_controller.policy.policy",
        "bicycle_controller.control.lqr",
        "bicycle_controller.control.control_loop",
        "bicycle_controller.evaluation.evaluate",
        "bicycle_bag.reader",
        "bicycle_cockpit.server",
    ],
)
def test_what_rides_needs_neither_torch_nor_ros(module: str) -> None:
    code = (
        f"import sys, {module}\n"
        "print([m for m in ('torch', 'rclpy', 'gymnasium', 'ray') if m in sys.modules])"
    )
    found = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert found.stdout.strip() == "[]"


@pytest.mark.ros
@pytest.mark.parametrize(
    "module", ["bicycle_sim.nodes.sim_node", "bicycle_controller.nodes.controller_node"]
)
def test_the_control_processes_hold_no_torch(module: str) -> None:
    code = f"import sys, {module}\nprint('torch' in sys.modules)"
    found = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert found.stdout.strip() == "False"
