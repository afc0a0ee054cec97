"""Packaging of bicycle_hardware, for colcon and for plain pip."""

from pathlib import Path

from setuptools import find_packages, setup

NAME = "bicycle_hardware"


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
    entry_points={
        "console_scripts": [
            "bicycle_driver = bicycle_hardware.programs:driver",
            "bicycle_bench = bicycle_hardware.programs:bench",
        ],
    },
    package_data={NAME: ["py.typed", "firmware/*"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
    ],
    python_requires=">=3.10",
    install_requires=[sibling("bicycle_common"), sibling("bicycle_sim"), "numpy"],
    extras_require={"test": ["pytest"]},
    zip_safe=True,
    maintainer="Self-driving bicycle maintainers",
    maintainer_email="maintainers@self-driving-bicycle.org",
    description="Frames to a microcontroller, its firmware's core, a simulated board.",
    license="Apache-2.0",
)
