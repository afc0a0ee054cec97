"""Packaging of bicycle_bringup, for colcon and for plain pip."""

from pathlib import Path

from setuptools import find_packages, setup

NAME = "bicycle_bringup"


def files(folder: str) -> list[str]:
    """The files of a folder beside this one, as data_files wants them."""
    here = Path(__file__).parent
    return sorted(str(path.relative_to(here)) for path in (here / folder).glob("*.*"))


setup(
    name=NAME,
    version="0.1.0",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={NAME: ["py.typed", "ride_page/*.css"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/config", files("config")),
        (f"share/{NAME}/launch", files("launch")),
    ],
    install_requires=["matplotlib", "numpy", "pyyaml", "tqdm"],
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
            "bicycle_report = bicycle_bringup.programs:report",
            "bicycle_foxglove = bicycle_bringup.programs:foxglove",
            "bicycle_goal = bicycle_bringup.programs:goal",
            "bicycle_topic = bicycle_bringup.programs:topic",
            "bicycle_verify = bicycle_bringup.programs:verify",
        ],
    },
)
