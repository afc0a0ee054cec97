"""Packaging of bicycle_sim, for colcon and for plain pip."""

import runpy
import sys
from pathlib import Path
from typing import Any

from setuptools import find_packages, setup

NAME = "bicycle_sim"
VERSION = next(
    line.split('"')[1]
    for line in (Path(__file__).parent / NAME / "__init__.py").read_text().splitlines()
    if line.startswith("__version__")
)


def meshes() -> list[str]:
    """Return the files of the URDF's meshes, for data_files."""
    here = Path(__file__).parent
    return sorted(str(path.relative_to(here)) for path in (here / "meshes").glob("*.stl"))


def sibling(name: str) -> str:
    """Return the requirement of a package of this repository: its folder, if beside this one."""
    root = Path(__file__).resolve().parent.parent
    for folder in (root / name, root / "ros2_ws" / "src" / name):
        if (folder / "setup.py").is_file():
            return f"{name} @ {folder.as_uri()}"
    return name


def native_build() -> dict[str, Any]:
    """Return the names of native/build.py of bicycle_common, which is beside this package."""
    root = Path(__file__).resolve().parent.parent
    for folder in (root / "bicycle_common", root / "ros2_ws" / "src" / "bicycle_common"):
        if (folder / "native" / "build.py").is_file():
            return runpy.run_path(str(folder / "native" / "build.py"))
    sys.exit("bicycle_common must stand beside this package")


library = native_build()["library"]

setup(
    name=NAME,
    version=VERSION,
    packages=find_packages(),
    package_data={
        NAME: ["py.typed"],
        f"{NAME}.plants": ["*.h"],
        f"{NAME}.plants.choi": ["*.h"],
        f"{NAME}.plants.whipple": ["*.cpp", "*.h", "bicycles/*.yaml", "bicycles/licences/*.txt"],
        f"{NAME}.sensors": ["presets/*.yaml"],
    },
    ext_modules=[
        library(
            f"{NAME}.task._native_task",
            f"{NAME}/task/native_task.cpp",
            f"{NAME}/plants/compiled.h",
            f"{NAME}/plants/choi/step.h",
        ),
        library(
            f"{NAME}.plants.whipple._whipple",
            f"{NAME}/plants/whipple/whipple.cpp",
            f"{NAME}/plants/whipple/whipple_lanes.h",
        ),
    ],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        # The URDF on robot_description names them by package://.
        (f"share/{NAME}/meshes", meshes()),
    ],
    install_requires=[sibling("bicycle_common"), "numpy"],
    extras_require={
        "gym": ["gymnasium", "matplotlib"],
        "mujoco": ["mujoco>=3.3"],
        "sb3": ["gymnasium", "matplotlib", "stable-baselines3"],
        "torch": ["torch"],
        "test": ["pytest"],
    },
    python_requires=">=3.10",
    zip_safe=False,
    maintainer="Self-driving bicycle maintainers",
    maintainer_email="maintainers@self-driving-bicycle.org",
    description="A simulated bicycle: dynamics, reward, task and ROS 2 node.",
    license="Apache-2.0",
    entry_points={"console_scripts": ["bicycle_sim = bicycle_sim.programs:simulator"]},
)
