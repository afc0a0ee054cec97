"""Packaging of bicycle_sim, for colcon and for plain pip."""

from pathlib import Path

from setuptools import find_packages, setup

NAME = "bicycle_sim"
VERSION = next(
    line.split('"')[1]
    for line in (Path(__file__).parent / NAME / "__init__.py").read_text().splitlines()
    if line.startswith("__version__")
)

setup(
    name=NAME,
    version=VERSION,
    packages=find_packages(),
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
    ],
    install_requires=["numpy", "pyyaml"],
    extras_require={"gym": ["gymnasium"], "test": ["pytest"]},
    python_requires=">=3.10",
    zip_safe=True,
    maintainer="Self-driving bicycle maintainers",
    maintainer_email="maintainers@self-driving-bicycle.org",
    description="A simulated bicycle: dynamics, reward, task and ROS 2 node.",
    license="Apache-2.0",
    entry_points={"console_scripts": ["bicycle_sim = bicycle_sim.nodes.sim_node:main"]},
)
