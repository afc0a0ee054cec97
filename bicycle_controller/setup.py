"""Packaging of bicycle_controller, for colcon and for plain pip."""

from pathlib import Path

from setuptools import Extension, find_packages, setup

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
        # A plain shared library, loaded with ctypes by policy/inference.py; numpy is the fallback.
        Extension(
            f"{NAME}.policy._inference",
            [f"{NAME}/policy/inference.cpp"],
            extra_compile_args=["-O3", "-ffp-contract=off", "-std=c++17"],
            optional=True,
        ),
        # The same, loaded by estimation/native.py.
        Extension(
            f"{NAME}.estimation._estimator",
            [f"{NAME}/estimation/estimator.cpp"],
            extra_compile_args=["-O3", "-ffp-contract=off", "-std=c++17"],
            optional=True,
        ),
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
