"""Packaging of bicycle_sim, for colcon and for plain pip."""

from pathlib import Path

from setuptools import Extension, find_packages, setup

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
        # Plain shared libraries, loaded with ctypes by native_task.py and whipple/native.py;
        # numpy is the fallback.
        Extension(
            f"{NAME}.task._native_task",
            [f"{NAME}/task/native_task.cpp"],
            depends=[f"{NAME}/plants/compiled.h", f"{NAME}/plants/choi/step.h"],
            extra_compile_args=["-O3", "-ffp-contract=off", "-std=c++17"],
            optional=True,
        ),
        Extension(
            f"{NAME}.plants.whipple._whipple",
            [f"{NAME}/plants/whipple/whipple.cpp"],
            depends=[f"{NAME}/plants/whipple/whipple_lanes.h"],
            # No flag may change a result: products and sums are rounded one by one.
            extra_compile_args=[
                "-O3",
                "-ffp-contract=off",
                "-fno-math-errno",
                "-fno-trapping-math",
                "-std=c++17",
            ],
            optional=True,
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
