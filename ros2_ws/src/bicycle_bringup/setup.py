"""Packaging of bicycle_bringup, for colcon and for plain pip."""

from pathlib import Path

from setuptools import find_packages, setup

NAME = "bicycle_bringup"


def files(folder: str) -> list[str]:
    """Return the files of a folder beside this one, for data_files."""
    here = Path(__file__).parent
    return sorted(str(path.relative_to(here)) for path in (here / folder).glob("*.*"))


def sibling(name: str) -> str:
    """Return the requirement of a package of this repository: its folder, if beside this one."""
    root = Path(__file__).resolve().parent.parents[2]
    for folder in (root / name, root / "ros2_ws" / "src" / name):
        if (folder / "setup.py").is_file():
            return f"{name} @ {folder.as_uri()}"
    return name


setup(
    name=NAME,
    version="0.1.0",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={NAME: ["py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/config", files("config")),
        (f"share/{NAME}/launch", files("launch")),
    ],
    install_requires=[
        *(
            sibling(f"bicycle_{name}")
            for name in ("bag", "common", "controller", "hardware", "sim", "tools")
        ),
        "numpy",
        "tqdm",
    ],
    extras_require={"test": ["pytest"]},
    python_requires=">=3.10",
    zip_safe=True,
    maintainer="Self-driving bicycle maintainers",
    maintainer_email="maintainers@self-driving-bicycle.org",
    description="Rides the bicycle: starts the nodes, sends goals, sums up, draws and verifies.",
    license="Apache-2.0",
    entry_points={
        "console_scripts": [
            "bicycle_ride = bicycle_bringup.programs:ride",
            "bicycle_fleet = bicycle_bringup.programs:fleet",
        ],
    },
)
