"""Packaging of bicycle_controller, for colcon and for plain pip."""

import runpy
import sys
from pathlib import Path
from typing import Any

from setuptools import find_packages, setup

NAME = "bicycle_controller"
VERSION = next(
    line.split('"')[1]
    for line in (Path(__file__).parent / NAME / "__init__.py").read_text().splitlines()
    if line.startswith("__version__")
)


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
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={
        NAME: [
            "py.typed",
            "followers/*",
            "models/*",
            "presets/*.yaml",
            "courses/*",
            "figures/*.yaml",
            "figures/causes/*.yaml",
            "agents/*.cpp",
            "agents/*.h",
        ]
    },
    ext_modules=[
        library(f"{NAME}.policy._inference", f"{NAME}/policy/inference.cpp"),
        library(f"{NAME}.estimation._estimator", f"{NAME}/estimation/estimator.cpp"),
    ],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
    ],
    install_requires=[
        *(sibling(name) for name in ("bicycle_bag", "bicycle_common", "bicycle_sim")),
        "numpy",
        "pyyaml",
        "safetensors",
        "scipy",
    ],
    extras_require={
        "train": ["torch", "gymnasium", "tensorboard", "tqdm", "matplotlib"],
        "sweep": ["ray"],
        "onnx": ["onnx", "onnxruntime"],
        "test": ["pytest"],
    },
    python_requires=">=3.10",
    zip_safe=False,
    maintainer="Self-driving bicycle maintainers",
    maintainer_email="maintainers@self-driving-bicycle.org",
    description="Controllers of the simulated bicycle: policies, LQR, training and ROS 2 nodes.",
    license="Apache-2.0",
    entry_points={
        "console_scripts": [
            "bicycle_controller = bicycle_controller.programs:controller",
            "bicycle_trainer = bicycle_controller.programs:trainer",
            "bicycle = bicycle_controller.programs:bicycle",
        ],
    },
)
