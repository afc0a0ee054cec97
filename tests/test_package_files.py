"""Names in package.xml and setup.py of the packages, and their installation by pip."""

from __future__ import annotations

import ast
import importlib.metadata
import json
import os
import re
import shutil
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from pathlib import Path

import pytest
from test_boundaries import MODULES, imported, library
from training_maker import SMALL

ROOT = Path(__file__).parent.parent
PACKAGES = {
    folder.name: folder
    for place in (ROOT, ROOT / "ros2_ws" / "src")
    for folder in sorted(place.glob("bicycle_*"))
    if (folder / "setup.py").is_file() and not folder.is_symlink()
}
STARTED = {
    "bicycle_bringup": {
        "bicycle_sim",
        "bicycle_hardware",
        "bicycle_cockpit",
        "ros2bag",
        "rosbag2_storage_mcap",
    }
}
"""Packages whose programs are started, not imported; `ros2 bag` writes MCAP by the last."""

ROSDEP = {
    name: f"python3-{name}"
    for name in ("numpy", "scipy", "matplotlib", "tqdm", "lz4", "zstandard", "aiohttp")
} | {"yaml": "python3-yaml", "PIL": "python3-pil"}
"""Keys of rosdep for what is imported."""

ON_PYPI = {
    "mcap": "mcap",
    "mcap_ros2": "mcap-ros2-support",
    "safetensors": "safetensors",
    "torch": "torch",
    "onnx": "onnx",
    "onnxruntime": "onnxruntime",
    "ray": "ray",
    "gymnasium": "gymnasium",
    "stable_baselines3": "stable-baselines3",
    "foxglove": "foxglove-sdk",
    "mujoco": "mujoco",
    "imageio_ffmpeg": "imageio-ffmpeg",
}
"""Names on PyPI of what has no key of rosdep."""

ROS = ("rclpy", "rosidl_parser", "launch", "launch_ros")


def imports(package: str, nodes: bool = True) -> set[str]:
    """Top names of all that the package's sources import from outside of it and of Python."""
    found = set()
    for path in (PACKAGES[package]).rglob("*.py"):
        if path.name in ("setup.py", "build.py") or "build" in path.parts:  # of the build alone
            continue
        if not nodes and ("nodes" in path.parts or "launch" in path.parts):
            continue
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                found |= {alias.name.partition(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module:
                found.add(node.module.partition(".")[0])
    return {name for name in found if name not in sys.stdlib_module_names} - {package}


def is_ros(name: str) -> bool:
    return name in ROS or name.endswith(("_msgs", "_srvs", "_interfaces"))


@pytest.mark.parametrize("package", PACKAGES)
def test_package_xml_names_what_is_imported(package: str) -> None:
    tree = ElementTree.parse(PACKAGES[package] / "package.xml").getroot()
    said = {str(element.text) for element in tree.findall("exec_depend")}
    used = imports(package) | STARTED.get(package, set())
    assert said == {ROSDEP.get(name, name) for name in used if name not in ON_PYPI}
    text = (PACKAGES[package] / "package.xml").read_text()
    note = re.search(r"<!-- On PyPI only, without a rosdep key: (.*) -->", text)
    noted = set(note[1].split(", ")) if note else set()
    assert noted == {ON_PYPI[name] for name in used if name in ON_PYPI}
    assert tree.findtext("license") == "Apache-2.0"


@pytest.mark.parametrize("package", PACKAGES)
def test_setup_py_names_what_is_imported_without_ros(package: str) -> None:
    """Nodes need ROS, which pip does not install; all else must be named, extras included."""
    done = subprocess.run(
        [sys.executable, "-c", PRINT_REQUIREMENTS],
        cwd=PACKAGES[package],
        capture_output=True,
        text=True,
        check=True,
    )
    named = {line.replace("-", "_").lower() for line in done.stdout.split()}
    pip_names = {"yaml": "pyyaml", "PIL": "pillow", **ON_PYPI}
    used = {name for name in imports(package, nodes=False) if not is_ros(name)}
    needed = {pip_names.get(name, name).replace("-", "_").lower() for name in used}
    assert needed - named == set()


def test_packages_have_one_version_and_say_that_they_are_typed() -> None:
    """Every package must be released together, and its type hints must reach its users."""
    versions = set()
    for name, folder in PACKAGES.items():
        versions.add(ElementTree.parse(folder / "package.xml").getroot().findtext("version"))
        versions |= set(re.findall(r'version="([^"]+)"', (folder / "setup.py").read_text()))
        init = (folder / name / "__init__.py").read_text()
        versions |= set(re.findall(r'^__version__ = "([^"]+)"', init, re.MULTILINE))
        assert (folder / name / "py.typed").is_file(), name
        assert '"py.typed"' in (folder / "setup.py").read_text(), name
    assert len(versions) == 1, versions


def test_every_setup_py_finds_its_siblings_alike() -> None:
    """Each must build alone, so each has its own copy of the function; the copies are equal."""
    bodies = {}
    for name, folder in PACKAGES.items():
        for node in ast.parse((folder / "setup.py").read_text()).body:
            if isinstance(node, ast.FunctionDef) and node.name == "sibling":
                depth, *rest = node.body[1:]
                bodies[name] = "\n".join(map(ast.unparse, rest))
                assert "resolve().parent" in ast.unparse(depth)
    assert set(bodies) == {name for name in PACKAGES if imports(name) & PACKAGES.keys()}
    assert len(set(bodies.values())) == 1


def test_every_library_in_c_is_built_in_one_way() -> None:
    """Both finders of the builder are equal too, and no setup.py has flags of its own."""
    texts = {name: (folder / "setup.py").read_text() for name, folder in PACKAGES.items()}
    compiling = [text for text in texts.values() if "ext_modules" in text]
    finders = {text[text.index("def native_build") : text.index("\nsetup(")] for text in compiling}
    assert (len(compiling), len(finders)) == (2, 1)
    assert not [name for name, text in texts.items() if "Extension" in text]
    found = [path for folder in PACKAGES.values() for path in folder.rglob("*.*")]
    sources = [path for path in found if path.suffix in (".cpp", ".h")]
    for word in ("void sine_cosine(", "#define WIDEST"):
        assert {path.parent for path in sources if word in path.read_text()} == {NATIVE}


@pytest.mark.parametrize(
    "package", [name for name, folder in PACKAGES.items() if [*folder.rglob("*.cpp")]]
)
def test_setup_py_names_the_headers_of_each_library(package: str) -> None:
    """A changed header must build the library anew, and a copy of the package must hold it."""
    folder = PACKAGES[package]
    done = subprocess.run(
        [sys.executable, "-c", PRINT_SOURCES],
        cwd=folder,
        capture_output=True,
        text=True,
        check=True,
    )
    given = json.loads(done.stdout)
    data = {
        path
        for name, patterns in given["data"].items()
        for pattern in patterns
        for path in folder.joinpath(*name.split(".")).glob(pattern)
    }
    assert len(given["libraries"]) == len({one["name"] for one in given["libraries"]}) > 0
    for one in given["libraries"]:
        wanted = {header for source in one["sources"] for header in headers(folder / source)}
        own = {header for header in wanted if header.parent != NATIVE}
        assert {folder / name for name in one["depends"]} == own | {*NATIVE.glob("*.h")}
        assert own <= data, one["name"]
        assert one["include"] == [str(NATIVE)]


NATIVE = PACKAGES["bicycle_common"] / "native"
"""Headers that several libraries include."""


def headers(source: Path) -> set[Path]:
    """Return all own headers that a C++ source includes, by others too."""
    named = re.findall(r'^#include "(.+)"$', source.read_text(), re.MULTILINE)
    places = [(source.parent / name, NATIVE / name) for name in named]
    found = {Path(os.path.normpath(own if own.is_file() else shared)) for own, shared in places}
    return found.union(*map(headers, found))


PRINT_SOURCES = """
import json, runpy, setuptools
def show(**given):
    libraries = [
        {"name": it.name, "sources": it.sources, "depends": it.depends, "include": it.include_dirs}
        for it in given.get("ext_modules", [])
    ]
    print(json.dumps({"libraries": libraries, "data": given["package_data"]}))
setuptools.setup = show
runpy.run_path("setup.py")
"""

PRINT_REQUIREMENTS = """
import re, runpy, setuptools
def show(**given):
    wanted = list(given.get("install_requires", []))
    for extra in given.get("extras_require", {}).values():
        wanted += extra
    for text in wanted:
        print(re.match(r"[\\w.-]+", text)[0])
setuptools.setup = show
runpy.run_path("setup.py")
"""

WITHOUT_ROS = """
import sys
for name in ("rclpy", "bicycle_msgs", "rosidl_parser", "torch"):
    sys.modules[name] = None
import gymnasium
env = gymnasium.make("bicycle_sim:BicycleGoal-v0")
env.reset(seed=1)
env.step(env.action_space.sample())
vector = gymnasium.make_vec("bicycle_sim:BicycleGoal-v0", num_envs=3)
vector.reset(seed=1)
assert gymnasium.make("bicycle_sim.gym_env:BicycleGoal-v0") is not None
import bicycle_sim, bicycle_common
print(bicycle_sim.__file__, bicycle_common.__file__)
from bicycle_sim.plants.registry import named
from bicycle_sim.task.native_task import load
assert load() is not None, "the library is not built"
"""


TRAINER = ("bicycle_common", "bicycle_sim", "bicycle_bag", "bicycle_controller")
"""Packages of ours that `pip install ./bicycle_controller[train]` installs, the last one last."""


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return packages as pip installs them, without their dependencies, which are here."""
    target = tmp_path_factory.mktemp("site")
    sources = tmp_path_factory.mktemp("sources")  # pip builds in the folder itself
    folders = [sources / name for name in TRAINER]
    for folder in folders:
        shutil.copytree(PACKAGES[folder.name], folder)
    words = ["pip", "install", "--quiet", "--no-deps", "--no-build-isolation", "--no-index"]
    done = subprocess.run(
        [sys.executable, "-m", *words, "--target", target, *folders],
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONPATH": ""},
    )
    assert done.returncode == 0, done.stderr
    return target


@pytest.mark.slow
def test_the_environment_works_without_ros(installed: Path, tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT_ROS],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(installed)},
    )
    assert done.returncode == 0, done.stderr
    assert all(word.startswith(str(installed)) for word in done.stdout.split())


OTHER_EXTRAS = {"mujoco": "plant=mujoco", "onnxruntime": "policies that are ONNX files"}
"""Libraries that training loads only if it is asked for something, and for what."""

TRAIN_WITHOUT_ROS = """
import sys
for name in ("rclpy", "bicycle_msgs", "rosidl_parser"):
    sys.modules[name] = None
from bicycle_controller.cli.main import main
import bicycle_common
print(bicycle_common.__file__, sys.modules["bicycle_controller"].__file__)
sys.exit(main(sys.argv[1:]))
"""


def libraries_of(start: str) -> set[str]:
    """Return the libraries that a module imports, itself or through other modules of ours."""
    modules, libraries, seen = [start], set[str](), set[str]()
    while modules:
        module = modules.pop()
        if module in seen:
            continue
        seen.add(module)
        for name in imported(MODULES[module]):
            if name in MODULES:
                modules.append(name)
            elif theirs := library(name):
                libraries.add(theirs)
    return libraries


def required(target: Path, names: Sequence[str], extra: str) -> set[str]:
    """Return the requirements of installed packages, those of the last with an extra."""
    found = set()
    for name in names:
        (package,) = importlib.metadata.distributions(name=name, path=[str(target)])
        for text in package.requires or []:
            condition = re.search(r"extra == ['\"](\w+)['\"]", text)
            if condition is None or (name == names[-1] and condition[1] == extra):
                found.add(re.split(r"[^\w.-]", text)[0])
    return found


@pytest.mark.slow
def test_the_extra_train_names_what_training_imports(installed: Path) -> None:
    named = {name.replace("-", "_").lower() for name in required(installed, TRAINER, "train")}
    assert "bicycle_sim" in named
    used = libraries_of("bicycle_controller.cli.train") - OTHER_EXTRAS.keys()
    assert {"torch", "numpy", "tqdm"} <= used
    pip_names = {"yaml": "pyyaml", **ON_PYPI}
    assert {pip_names.get(name, name) for name in used} - named == set()


@pytest.mark.slow
def test_training_works_without_ros(installed: Path, tmp_path: Path) -> None:
    command = ["train", "--preset", "paper", "--out", "run", "--quiet", "--json"]
    for change in (*SMALL, "steps=400"):
        command += ["--set", change]
    done = subprocess.run(
        [sys.executable, "-c", TRAIN_WITHOUT_ROS, *command],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(installed)},
    )
    assert done.returncode == 0, done.stderr
    places, result = done.stdout.splitlines()
    assert all(word.startswith(str(installed)) for word in places.split())
    assert json.loads(result)["out"] == "run"


def test_the_long_name_works_from_sources() -> None:
    code = "import gymnasium; print(gymnasium.make('bicycle_sim:BicycleGoal-v0').spec.id)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (done.stdout, done.returncode) == ("BicycleGoal-v0\n", 0), done.stderr
