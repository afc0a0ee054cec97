"""Files of docker/ against schema and scripts; without_docker.py builds and runs them."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
import yaml

ROOT = Path(__file__).resolve().parents[2]
DOCKER = ROOT / "docker"
COMPOSE = DOCKER / "compose.yaml"
SERVICES = {
    "simulator": "sim.sh",
    "controller": "controller.sh",
    "recorder": "record.sh",
    "cockpit": "cockpit.sh",
    "trainer": "trainer.sh",
}


def validated(path: Path) -> subprocess.CompletedProcess[str]:
    """Return the errors of a file by the compose specification's own JSON schema."""
    words = [sys.executable, "-m", "check_jsonschema", "--builtin-schema", "vendor.compose-spec"]
    return subprocess.run([*words, str(path)], capture_output=True, text=True)


@pytest.fixture
def compose() -> dict[str, Any]:
    loaded: dict[str, Any] = yaml.safe_load(COMPOSE.read_text())
    return loaded


def test_the_compose_file_fits_its_schema(tmp_path: Path) -> None:
    done = validated(COMPOSE)
    assert done.returncode == 0, done.stdout
    wrong = tmp_path / "compose.yaml"
    wrong.write_text(COMPOSE.read_text().replace("cap_drop: [ALL]", "cap_drop: ALL"))
    assert validated(wrong).returncode == 1


def test_every_service_runs_closed_and_is_looked_after(compose: dict[str, Any]) -> None:
    assert {name: it["command"][0] for name, it in compose["services"].items()} == SERVICES
    for service in compose["services"].values():
        assert (ROOT / "ros2_ws" / service["command"][0]).is_file()
        assert service["read_only"] is True
        assert service["cap_drop"] == ["ALL"]
        kind, script, *_ = service["healthcheck"]["test"]
        assert (kind, Path(script)) == ("CMD", Path("/opt/bicycle/docker/health.sh"))
        assert "bags:/opt/bicycle/ros2_ws/runs" in service["volumes"]
        for port in service.get("ports", []):
            assert port.startswith("127.0.0.1:")
    assert compose["networks"]["ros"] == {"internal": True}


def test_the_image_is_pinned_and_nobody_in_it_is_root() -> None:
    text = (DOCKER / "Dockerfile").read_text()
    assert re.search(r"^ARG BASE=\S+:bookworm-\d{8}-slim@sha256:[0-9a-f]{64}$", text, re.MULTILINE)
    stages = re.split(r"^FROM ", text, flags=re.MULTILINE)[1:]
    for stage in stages:
        name = stage.split()[2]
        if name in ("ride", "train"):
            assert stage.rstrip().endswith("USER bicycle")


def health(beat: Path, *words: str) -> int:
    done = subprocess.run(
        [DOCKER / "health.sh", *words],
        env={**os.environ, "BICYCLE_HEARTBEAT": str(beat)},
        capture_output=True,
    )
    return done.returncode


def test_a_heart_that_stands_still_is_ill(tmp_path: Path) -> None:
    beat = tmp_path / "heartbeat"
    assert health(beat) == 1
    beat.touch()
    assert health(beat) == 0
    assert health(beat, "1") != 0  # nobody serves there
    old = time.time() - 10.0
    os.utime(beat, (old, old))
    assert health(beat) == 1


def test_a_sealed_workspace_sets_nothing_up(tmp_path: Path) -> None:
    workspace = tmp_path / "ros2_ws"
    (workspace / "install").mkdir(parents=True)
    (workspace / "install" / ".bicycle.sealed").touch()
    (workspace / "lib").symlink_to(ROOT / "ros2_ws" / "lib")
    setup = workspace / "setup.sh"
    setup.write_text((ROOT / "ros2_ws" / "setup.sh").read_text())
    stamps = tmp_path / ".venv" / ".bicycle"
    stamps.mkdir(parents=True)
    (stamps / "ride.stamp").touch()
    quiet = subprocess.run(["bash", setup, "--quiet"], capture_output=True, text=True)
    assert (quiet.returncode, quiet.stdout, quiet.stderr) == (0, "", "")
    more = subprocess.run(["bash", setup, "--with", "train"], capture_output=True, text=True)
    assert more.returncode == 3
    assert "made without 'train'" in more.stderr
