"""Packaging of bicycle_tools, for colcon and for plain pip."""

from pathlib import Path

from setuptools import find_packages, setup

NAME = "bicycle_tools"


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
    package_data={NAME: ["py.typed", "report_page/*.css", "report_page/*.js"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
    ],
    install_requires=[
        *(sibling(f"bicycle_{name}") for name in ("bag", "common", "controller", "sim")),
        "matplotlib",
        "numpy",
        "tqdm",
    ],
    extras_require={"test": ["pytest"]},
    python_requires=">=3.10",
    zip_safe=True,
    maintainer="Self-driving bicycle maintainers",
    maintainer_email="maintainers@self-driving-bicycle.org",
    description="Goals, reports, pictures, proofs and a bridge to Foxglove for rides.",
    license="Apache-2.0",
    entry_points={
        "console_scripts": [
            "bicycle_report = bicycle_tools.programs:report",
            "bicycle_foxglove = bicycle_tools.programs:foxglove",
            "bicycle_goal = bicycle_tools.programs:goal",
            "bicycle_path = bicycle_tools.programs:path",
            "bicycle_teleop = bicycle_tools.programs:teleop",
            "bicycle_topic = bicycle_tools.programs:topic",
            "bicycle_verify = bicycle_tools.programs:verify",
        ],
    },
)
