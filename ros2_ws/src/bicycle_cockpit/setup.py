"""Packaging of bicycle_cockpit, for colcon and for plain pip."""

from pathlib import Path

from setuptools import find_packages, setup

NAME = "bicycle_cockpit"


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
    package_data={NAME: ["py.typed", "web/*", "web/scene/*", "web/vendor/*"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
    ],
    install_requires=[
        *(sibling(f"bicycle_{name}") for name in ("bag", "common", "controller", "sim", "tools")),
        "aiohttp",
        "mcap",
        "numpy",
        "pillow",
    ],
    extras_require={"film": ["imageio-ffmpeg"], "test": ["pytest"]},
    python_requires=">=3.10",
    zip_safe=False,
    maintainer="Self-driving bicycle maintainers",
    maintainer_email="maintainers@self-driving-bicycle.org",
    description="Shows the bicycle in the browser, takes goals there, and scrubs through bags.",
    license="Apache-2.0",
    entry_points={
        "console_scripts": ["bicycle_cockpit = bicycle_cockpit.programs:cockpit"],
    },
)
