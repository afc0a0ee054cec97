"""Locks, their hashes, and the list of what is installed."""

from __future__ import annotations

import base64
import fcntl
import hashlib
import json
import re
import subprocess
import sys
import time
import zipfile
from importlib import metadata
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
WORKSPACE = ROOT / "ros2_ws"
REQUIREMENTS = WORKSPACE / "requirements"
LOCKS = sorted(REQUIREMENTS.glob("*.lock"))
METADATA = "Metadata-Version: 2.1\nName: pebble\nVersion: 1.0\n"
WHEEL = "Wheel-Version: 1.0\nGenerator: test\nRoot-Is-Purelib: true\nTag: py3-none-any\n"


def requirements(lock: Path) -> list[str]:
    """Return the requirements of a lock, each with its hashes, on one line."""
    text = re.sub(r"^\s*#.*\n", "", lock.read_text(), flags=re.MULTILINE)
    return [line for line in text.replace("\\\n", " ").splitlines() if line.strip()]


@pytest.mark.parametrize("lock", LOCKS, ids=lambda lock: lock.stem)
def test_every_package_is_pinned_with_its_hashes(lock: Path) -> None:
    found = requirements(lock)
    assert found
    for line in found:
        assert re.match(r"[\w.\[\],-]+==[\w.!+]+ ", line), line
        assert re.search(r"--hash=sha256:[0-9a-f]{64}( |$)", line), line


def test_scripts_that_start_together_say_nothing_of_each_other() -> None:
    """Each looks whether there is something to set up, under a lock that others wait for."""
    with (WORKSPACE / "log" / "setup.lock").open("a") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        script = subprocess.Popen(
            [WORKSPACE / "setup.sh", "--quiet"], stdout=subprocess.PIPE, stderr=subprocess.STDOUT
        )
        time.sleep(1.0)
    assert script.communicate()[0] == b""
    assert script.returncode == 0


def test_nothing_installed_beside_a_build_writes_what_the_build_imports() -> None:
    """The last set is installed while the workspace is built with the packages of the first."""
    never = "sys_platform == 'never'"
    sets = [
        {
            line.partition("==")[0].removeprefix("ros-")
            for line in requirements(lock)
            if never not in line
        }
        for lock in (REQUIREMENTS / "build.lock", REQUIREMENTS / "dev.lock")
    ]
    owners: dict[str, set[str]] = {}
    for found in metadata.distributions():
        # A wheel of ROS brings two records of its files: `ros-rclpy` and `rclpy`.
        name = found.metadata["Name"].lower().replace("_", "-").removeprefix("ros-")
        for file in found.files or ():
            if file.suffix in (".py", ".so") and name in set.union(*sets):
                owners.setdefault(str(file), set()).add(name)
    shared = {file: names for file, names in owners.items() if len(names) > 1 and "/" in file}
    assert {file: names for file, names in shared.items() if names & sets[0]} == {}


def test_torch_is_locked_with_and_without_cuda() -> None:
    (torch,) = (line for line in requirements(REQUIREMENTS / "torch.lock") if "torch==" in line)
    wheels = (REQUIREMENTS / "torch-wheels.sha256").read_text()
    for hash_ in re.findall(r"^[0-9a-f]{64}", wheels, flags=re.MULTILINE):
        assert f"sha256:{hash_}" in torch
    plain = requirements(REQUIREMENTS / "torch.lock")
    cuda = requirements(REQUIREMENTS / "torch-cuda.lock")
    assert not any(line.startswith(("nvidia", "cuda", "triton")) for line in plain)
    assert all(line.startswith(("nvidia", "cuda", "triton")) for line in cuda)


def test_sets_agree_where_they_share_a_package() -> None:
    """Sets are installed on top of each other, so one must not replace what another brought."""
    seen: dict[str, tuple[str, str]] = {}
    for lock in LOCKS:
        for line in requirements(lock):
            pinned, _, hashes = line.partition(" --hash")
            name = pinned.partition("==")[0] + pinned.partition(";")[2]
            here = (pinned.partition(";")[0].strip(), hashes)
            assert seen.setdefault(name, here)[0] == here[0], f"{lock.name}: {pinned}"


@pytest.fixture
def place(tmp_path: Path) -> Path:
    """Return a workspace with a virtual environment and a wheel, and nothing of the network."""
    (tmp_path / "requirements").mkdir()
    (tmp_path / "lib").symlink_to(WORKSPACE / "lib")
    wheel = tmp_path / "pebble-1.0-py3-none-any.whl"
    files = {
        "pebble.py": "",
        "pebble-1.0.dist-info/METADATA": METADATA,
        "pebble-1.0.dist-info/WHEEL": WHEEL,
    }
    record = "".join(f"{name},{digest(text)},{len(text)}\n" for name, text in files.items())
    with zipfile.ZipFile(wheel, "w") as archive:
        for name, text in files.items():
            archive.writestr(name, text)
        archive.writestr("pebble-1.0.dist-info/RECORD", record + "pebble-1.0.dist-info/RECORD,,\n")
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", tmp_path / "venv"], check=True)
    (tmp_path / "venv" / "bin" / "uv").symlink_to(ROOT / ".venv" / "bin" / "uv")
    return tmp_path


def digest(text: str) -> str:
    raw = hashlib.sha256(text.encode()).digest()
    return "sha256=" + base64.urlsafe_b64encode(raw).rstrip(b"=").decode()


def install(
    place: Path, requirement: str, only_pip: bool, **variables: str
) -> subprocess.CompletedProcess[str]:
    """Run setup.sh with a lock of one requirement."""
    (place / "requirements" / "test.lock").write_text(requirement)
    script = f"ws={place} venv={place}/venv; . lib/packages.sh; "
    if only_pip:  # a setting that uv knows nothing of
        script += "export PIP_USE_DEPRECATED=legacy-resolver; "
    env = {"PATH": "/usr/local/bin:/usr/bin:/bin", "HOME": str(place), "PIP_NO_INDEX": "1"}
    return subprocess.run(
        ["bash", "-c", f"{script} install_lock test"],
        cwd=place,
        env={**env, "PIP_FIND_LINKS": str(place), **variables},
        capture_output=True,
        text=True,
    )


@pytest.mark.parametrize("only_pip", [False, True])
def test_a_file_with_another_hash_is_not_installed(place: Path, only_pip: bool) -> None:
    sound = hashlib.sha256((place / "pebble-1.0-py3-none-any.whl").read_bytes()).hexdigest()
    wrong = f"pebble==1.0 --hash=sha256:{sound[::-1]}\n"
    done = install(place, wrong, only_pip)
    assert done.returncode != 0
    assert "hash" in (done.stdout + done.stderr).lower()
    done = install(place, "pebble==1.0\n", only_pip)
    assert done.returncode != 0
    assert list(place.glob("venv/lib/*/site-packages/pebble.py")) == []
    done = install(place, f"pebble==1.0 --hash=sha256:{sound}\n", only_pip)
    assert done.returncode == 0, done.stdout + done.stderr
    assert ("uv pip" in done.stdout + done.stderr) is False
    assert len(list(place.glob("venv/lib/*/site-packages/pebble.py"))) == 1


@pytest.mark.parametrize(("setting", "compiled"), [("", 0), ("1", 1)])
def test_packages_are_compiled_where_python_would_not_keep_it(
    place: Path, setting: str, compiled: int
) -> None:
    sound = hashlib.sha256((place / "pebble-1.0-py3-none-any.whl").read_bytes()).hexdigest()
    requirement = f"pebble==1.0 --hash=sha256:{sound}\n"
    done = install(place, requirement, False, PYTHONDONTWRITEBYTECODE=setting)
    assert done.returncode == 0, done.stdout + done.stderr
    assert len(list(place.glob("venv/lib/*/site-packages/__pycache__/pebble.*"))) == compiled


@pytest.mark.slow
def test_the_bill_of_materials_names_what_is_installed(tmp_path: Path) -> None:
    path = tmp_path / "bill.json"
    done = subprocess.run(
        [WORKSPACE / "sbom.sh", "--output", path], capture_output=True, text=True
    )
    assert (done.returncode, done.stderr) == (0, "")
    bill = json.loads(path.read_text())
    assert (bill["bomFormat"], bill["metadata"]["component"]["name"]) == (
        "CycloneDX",
        "self-driving-bicycle",
    )
    listed = {part["name"].lower().replace("_", "-"): part for part in bill["components"]}
    for name in ("numpy", "rclpy", "ros-jazzy-rclpy", "mcap", "torch"):
        found = metadata.distribution(name)
        assert listed[name]["version"] == found.version
        assert listed[name]["purl"].startswith(f"pkg:pypi/{name}@")
    assert listed["mcap"]["licenses"]


@pytest.mark.parametrize("words", [["--out"], ["--output"], ["--output", ""], ["--output", "-x"]])
def test_bad_arguments_of_sbom(words: list[str]) -> None:
    done = subprocess.run([WORKSPACE / "sbom.sh", *words], capture_output=True, text=True)
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)


def test_sbom_into_no_folder() -> None:
    words = [str(WORKSPACE / "sbom.sh"), "--output", "/no/such/folder/bill.json"]
    done = subprocess.run(words, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (2, "sbom.sh: no folder '/no/such/folder'.\n")
