"""docs/rl.md as printed, with short runs, on what pip makes of the packages and without ROS.

Wheels of our packages are built and installed by pip into a folder of their own; what they need
(Gymnasium, torch, stable-baselines3) is this environment's, so that nothing is downloaded. ROS
cannot be imported. With FRESH_ENVIRONMENT=1 the page's two pip lines make an environment of their
own instead, from the package index:

    FRESH_ENVIRONMENT=1 python -m pytest tests/test_rl_page.py -k snippet
"""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

pytest.importorskip("stable_baselines3")

ROOT = Path(__file__).resolve().parents[1]
FOLDERS = {
    "bicycle_common": ROOT / "ros2_ws" / "src" / "bicycle_common",
    "bicycle_bag": ROOT / "ros2_ws" / "src" / "bicycle_bag",
    "bicycle_sim": ROOT / "bicycle_sim",
    "bicycle_controller": ROOT / "bicycle_controller",
}
SHORTER = {
    "learn(500_000)": "learn(8_192)",
    "evaluate_policy(model, BicycleVecEnv(": "evaluate_policy(model, BicycleVecEnv(",
    '-v0", 16, observation_scale': '-v0", 16, max_episode_steps=50, observation_scale',
    '"steps=250000"': '"steps=12800", "evaluation.episodes=8", "evaluation.near_episodes=8"',
    "episodes=1000)": "episodes=10)",
    "--episodes 1000": "--episodes 10",
}
"""Lines of the page, and their replacements in the run."""
QUICK = "--steps 12800 --set evaluation.every=20 --set evaluation.episodes=8 --quiet"
QUICK += " --set evaluation.near_episodes=8"
NO_ROS = "import sys\nfor name in ('rclpy', 'bicycle_msgs'): sys.modules[name] = None\n"


@dataclass(frozen=True)
class PipMade:
    """Environment that pip made."""

    python: Path
    path: str
    """PYTHONPATH for it."""


@pytest.fixture(scope="module")
def pip_made(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> PipMade:
    """Return an environment with the packages and without ROS."""
    if not os.environ.get("FRESH_ENVIRONMENT"):
        return PipMade(Path(sys.executable), str(request.getfixturevalue("site")))
    folder = tmp_path_factory.mktemp("fresh")
    subprocess.run([sys.executable, "-m", "venv", str(folder)], check=True)
    python = folder / "bin" / "python"
    lines = [line for block in blocks("sh") for line in block.splitlines()]
    installs = [line for line in lines if line.startswith("pip install ")]
    assert len(installs) == 2
    environment = {**os.environ, "PYTHONPATH": ""}
    for line in installs:
        words = shlex.split(line.partition("#")[0])
        subprocess.run([python, "-m", *words, "--quiet"], check=True, cwd=ROOT, env=environment)
    return PipMade(python, "")


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the packages as pip installs their wheels."""
    sources, wheels = tmp_path_factory.mktemp("sources"), tmp_path_factory.mktemp("wheels")
    target = tmp_path_factory.mktemp("site")
    for name, folder in FOLDERS.items():  # pip builds in the folder itself
        skipped = shutil.ignore_patterns("build", "*.egg-info", "__pycache__")
        shutil.copytree(folder, sources / name, ignore=skipped)
    alone = ["--no-deps", "--no-index", "--quiet"]
    built = [str(sources / name) for name in FOLDERS]
    pip = [sys.executable, "-m", "pip"]
    environment = {**os.environ, "PYTHONPATH": ""}
    words = [*pip, "wheel", *alone, "--no-build-isolation", "--wheel-dir", str(wheels), *built]
    subprocess.run(words, check=True, env=environment)
    files = sorted(wheels.glob("*.whl"))
    assert len(files) == len(FOLDERS)
    words = [*pip, "install", *alone, "--target", str(target), *map(str, files)]
    subprocess.run(words, check=True, env=environment)
    return target


def blocks(kind: str) -> list[str]:
    text = (ROOT / "docs" / "rl.md").read_text()
    return re.findall(rf"^```{kind}\n(.*?)^```", text, re.DOTALL | re.MULTILINE)


def shorter(text: str) -> str:
    for long, short in SHORTER.items():
        text = text.replace(long, short)
    return text


def run(words: list[str], pip_made: PipMade, folder: Path) -> str:
    environment = {**os.environ, "PYTHONPATH": pip_made.path, "OMP_NUM_THREADS": "1"}
    done = subprocess.run(
        [pip_made.python, *words], cwd=folder, env=environment, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.slow
def test_every_snippet_of_the_page_runs(pip_made: PipMade, tmp_path: Path) -> None:
    python = [shorter(block) for block in blocks("python")]
    assert len(python) == 3
    for code in python:
        output = run(["-c", NO_ROS + code], pip_made, tmp_path)
        assert output.strip()
    command = ["-m", "bicycle_controller.cli.main"]
    lines = [line for block in blocks("sh") for line in shorter(block).splitlines()]
    ours = [line for line in lines if line.startswith("bicycle ")]
    assert len(ours) == 7
    # The trainer's lines first come after those that read what Python left behind.
    for line in ours:
        if line.startswith("bicycle train"):
            line += f" {QUICK}"
        run([*command, *shlex.split(line)[1:]], pip_made, tmp_path)
    assert (tmp_path / "curves.png").is_file()
    assert (tmp_path / "log.csv").is_file()
    assert all(line.startswith(("bicycle ", "pip install './bicycle_")) for line in lines)


def test_the_packages_that_the_page_installs_name_all_they_import(site: Path) -> None:
    found = "".join(path.read_text() for path in site.glob("bicycle_*.dist-info/METADATA"))
    for extra in ("gym", "sb3", "train", "onnx"):
        assert f"Provides-Extra: {extra}" in found


def test_the_citation_has_what_the_format_asks_for() -> None:
    import yaml

    said = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert {"cff-version", "message", "title", "authors", "version", "license"} <= set(said)
    version = (ROOT / "bicycle_sim" / "bicycle_sim" / "__init__.py").read_text()
    assert f'__version__ = "{said["version"]}"' in version
