"""Packaging of bicycle_bag, for colcon and for plain pip."""

from pathlib import Path

from setuptools import find_packages, setup

NAME = "bicycle_bag"


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
    ],
    python_requires=">=3.10",
    install_requires=[
        sibling("bicycle_common"),
        "lz4",
        "mcap",
        "mcap-ros2-support",
        "numpy",
        "setuptools",
        "tqdm",
        "zstandard",
    ],
    extras_require={"test": ["pytest"]},
    zip_safe=True,
    maintainer="Self-driving bicycle maintainers",
    maintainer_email="maintainers@self-driving-bicycle.org",
    description=(
        "Records and replays ROS 2 topics as MCAP bags that rosbag2 reads, "
        "and reads them without ROS."
    ),
    license="Apache-2.0",
    entry_points={
        "console_scripts": [
            "bicycle_record = bicycle_bag.programs:record",
            "bicycle_play = bicycle_bag.programs:play",
            "bicycle_repair = bicycle_bag.programs:repair",
        ],
    },
)
