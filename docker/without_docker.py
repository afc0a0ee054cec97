#!/usr/bin/env python3
"""Builds the image where there is no Docker engine, rides in it, and runs the compose file.

Usage: without_docker.py [--train] [--json FILE] [--keep]

Needs root and Debian's buildah and debootstrap. The base image, which the Dockerfile takes from a
registry, is made with debootstrap from Debian's own; then `buildah build --isolation chroot`
builds the target `ride` as a Docker engine would, `ride.sh` rides to three goals in it, and
the services of compose.yaml are started, each in a container of its own with the command and the
health check that stand there. With that isolation they share this machine's network, so they ride
on 127.0.0.1 instead of on the compose file's own network. `--train` builds the target `train`
besides (torch is large) and starts the trainer, too.

Exit status: 0 all of it worked, 1 something did not, 2 something is missing.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
BASE = "localhost/bicycle-base:bookworm"
IMAGE = "localhost/bicycle:{target}"
WORKSPACE = "/opt/bicycle/ros2_ws"
USER = 10001
DOMAIN = "43"
SETTINGS = ("PIP_INDEX_URL", "PIP_EXTRA_INDEX_URL")
"""Settings of pip passed to the build if set, in addition to PIP_CERT and PIP_FIND_LINKS."""
RIDE = ("simulator", "controller", "recorder", "cockpit")
HEALTHY_WITHIN = 90.0
GOAL = ("12", "9")
SHOW_COMPOSE = (
    "import json, yaml; "
    "print(json.dumps(yaml.safe_load(open('/opt/bicycle/docker/compose.yaml'))['services']))"
)


class TrialError(Exception):
    """Description of a failure, in one line."""


def call(*words: object, **options: Any) -> str:
    """Run a program and return its output.

    Raises:
        TrialError: if it failed.
    """
    done = subprocess.run([str(word) for word in words], capture_output=True, text=True, **options)
    if done.returncode:
        last = (done.stderr.strip() or done.stdout.strip()).splitlines()[-6:]
        raise TrialError(f"{' '.join(map(str, words))} failed: {' | '.join(last)}")
    return done.stdout


def works(*words: str) -> bool:
    """Return True if a program ends with status 0."""
    return subprocess.run(words, capture_output=True).returncode == 0


@contextlib.contextmanager
def container(image: str, name: str) -> Iterator[str]:
    """Yield a working container, removed at the end."""
    container_id = call("buildah", "from", "--name", name, image).strip()
    try:
        yield container_id
    finally:
        call("buildah", "rm", container_id)


def make_base() -> None:
    """Make the base image with debootstrap, unless it is there."""
    if works("buildah", "inspect", "--type", "image", BASE):
        return
    with (
        tempfile.TemporaryDirectory() as folder,
        container("scratch", "bicycle-base") as container_id,
    ):
        print("base image ...", flush=True)
        call("debootstrap", "--variant=minbase", "bookworm", folder)
        for cache in ("var/cache/apt/archives", "var/lib/apt/lists"):
            shutil.rmtree(Path(folder, cache))
            Path(folder, cache, "partial").mkdir(parents=True)
        call("buildah", "add", "--quiet", container_id, folder, "/")
        call("buildah", "config", "--cmd", "bash", container_id)
        call("buildah", "commit", "--quiet", container_id, BASE)


def build(target: str) -> dict[str, object]:
    """Build one target; return the build time and the size."""
    words = ["buildah", "build", "--isolation", "chroot", "--layers", "--target", target]
    words += ["--tag", IMAGE.format(target=target), "--file", "docker/Dockerfile"]
    words += ["--ignorefile", "docker/Dockerfile.dockerignore", "--build-arg", f"BASE={BASE}"]
    for name in SETTINGS:
        if name in os.environ:
            words += ["--build-arg", f"{name}={os.environ[name]}"]
    for name, place in (("PIP_CERT", "/run/pip-ca.crt"), ("PIP_FIND_LINKS", "/run/wheels")):
        if Path(os.environ.get(name, "")).is_absolute():
            words += ["--volume", f"{os.environ[name]}:{place}:ro", "--build-arg"]
            words += [f"{name}={place}"]
    print(f"building {target} ...", flush=True)
    began = time.monotonic()
    call(*words, ".", cwd=ROOT)
    return {"build (s)": round(time.monotonic() - began, 1), "size": size(target)}


def size(target: str) -> str:
    """Return the size of an image, including its base."""
    found = json.loads(call("buildah", "images", "--json"))
    name = IMAGE.format(target=target)
    return next(str(image["size"]) for image in found if name in (image.get("names") or []))


def inside(container_id: str, words: Sequence[str], **variables: str) -> list[str]:
    """Return the command that runs something in a container, as its user."""
    environment = {"ROS_DOMAIN_ID": DOMAIN, **variables}
    settings = [word for item in environment.items() for word in ("--env", "=".join(item))]
    return ["buildah", "run", "--isolation", "chroot", *settings, container_id, "--", *words]


def ride() -> dict[str, Any]:
    """Ride to three goals in a container; return ride.sh's summary, with its user and Python."""
    print("riding inside ...", flush=True)
    with container(IMAGE.format(target="ride"), "bicycle-riding") as container_id:
        output = f"{WORKSPACE}/runs/trial"
        call(*inside(container_id, ["ride.sh", "--goals", "3", "--seed", "1", "--output", output]))
        summary = json.loads(call(*inside(container_id, ["cat", f"{output}/summary.json"])))
        user = call(*inside(container_id, ["id", "--user"])).strip()
        python = call(*inside(container_id, ["python3", "-V"])).strip()
    return {"user": int(user), "python": python, "summary": summary}


def node_below(pid: int) -> int:
    """Return the node among a process's descendants, because buildah does not forward signals.

    Raises:
        TrialError: if there is none.
    """
    family = [pid]
    for member in family:
        for thread in Path(f"/proc/{member}/task").iterdir():
            family += map(int, (thread / "children").read_text().split())
        if Path(f"/proc/{member}/cmdline").read_text().startswith("/opt/bicycle/.venv/bin/python"):
            return member
    raise TrialError("the node of a service is gone")


class Service:
    """A service of the compose file, in a container of its own.

    Args:
        name: the service's.
        made: its container.
        config: of the compose file.
        folder: where the volume `bags` and the service's log are.
    """

    def __init__(self, name: str, container_id: str, config: dict[str, Any], folder: Path) -> None:
        self.name, self.log = name, folder / f"{name}.log"
        self._container = container_id
        self._health: list[str] = config["healthcheck"]["test"][1:]
        self._environment = {"BICYCLE_NETWORK": "local"}
        if "BICYCLE_COCKPIT_TOKEN" in config["environment"]:
            self._environment["BICYCLE_COCKPIT_TOKEN"] = "auto"
        command = self._inside(config["command"])
        command[2:2] = ["--volume", f"{folder / 'bags'}:{WORKSPACE}/runs"]
        self._began = time.monotonic()
        with self.log.open("w") as log:
            self._process = subprocess.Popen(
                command, stdout=log, stderr=subprocess.STDOUT, start_new_session=True
            )

    def _inside(self, words: Sequence[str]) -> list[str]:
        return inside(self._container, words, **self._environment)

    def until_healthy(self) -> float:
        """Return the time from the start until its health check passed, s.

        Raises:
            TrialError: if it ended, or was not healthy within `HEALTHY_WITHIN`.
        """
        while not works(*self._inside(self._health)):
            age = time.monotonic() - self._began
            if self._process.poll() is not None or age > HEALTHY_WITHIN:
                raise TrialError(f"{self.name} is not healthy: {self.log.read_text()[-500:]!r}")
            time.sleep(0.5)
        return round(time.monotonic() - self._began, 1)

    def stop(self) -> int:
        """Stop its node with the compose file's signal; return its exit status."""
        if self._process.poll() is None:
            os.kill(node_below(self._process.pid), signal.SIGINT)
        return self._process.wait(20.0)


def serve(names: Sequence[str]) -> dict[str, Any]:
    """Start services and ride to one goal; return the results."""
    print("services of compose.yaml ...", flush=True)
    found: dict[str, Any] = {"healthy after (s)": {}, "exit status": {}}
    with contextlib.ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        (folder / "bags").mkdir()
        os.chown(folder / "bags", USER, USER)
        containers = {}
        for name in names:
            image = IMAGE.format(target="train" if name == "trainer" else "ride")
            containers[name] = stack.enter_context(container(image, f"bicycle-{name}"))
        python = f"{Path(WORKSPACE).parent}/.venv/bin/python"
        compose = json.loads(call(*inside(containers["simulator"], [python, "-c", SHOW_COMPOSE])))
        running: list[Service] = []
        try:
            for name in names:
                running.append(Service(name, containers[name], compose[name], folder))
                found["healthy after (s)"][name] = running[-1].until_healthy()
            words = ["goal.sh", *GOAL, "--wait"]
            goal = call(*inside(containers["controller"], words, BICYCLE_NETWORK="local"))
            found["goal"] = goal.strip().splitlines()[-1]
        finally:
            for service in reversed(running):
                found["exit status"][service.name] = service.stop()
        found["recorder"] = (folder / "recorder.log").read_text().splitlines()[-1]
        found["whole bags in the volume"] = len(list(folder.glob("bags/*/metadata.yaml")))
    if any(found["exit status"].values()) or found["whole bags in the volume"] != 1:
        raise TrialError(f"the services did not end in good order: {found}")
    return found


def clean(targets: Sequence[str]) -> None:
    """Remove the images and the remains of their build."""
    names = [IMAGE.format(target=target) for target in targets]
    subprocess.run(["buildah", "rmi", "--force", *names, BASE], capture_output=True)
    subprocess.run(["buildah", "rmi", "--prune", "--force"], capture_output=True)


def trial(targets: Sequence[str]) -> dict[str, Any]:
    """Run all stages.

    Raises:
        TrialError: if one failed.
    """
    make_base()
    images = {target: build(target) for target in targets}
    names = RIDE if len(targets) == 1 else (*RIDE, "trainer")
    return {"images": images, "ride": ride(), "services": serve(names)}


def main() -> int:
    """Build, ride, serve; return the exit status."""
    parser = argparse.ArgumentParser(description="See the top of this file.")
    parser.add_argument("--train", action="store_true", help="also the image with torch")
    parser.add_argument("--json", type=Path, help="file for the results")
    parser.add_argument("--keep", action="store_true", help="keep the images")
    given = parser.parse_args()
    missing = [name for name in ("buildah", "debootstrap") if shutil.which(name) is None]
    if missing or os.geteuid() != 0:
        need = f"apt-get install -y {' '.join(missing)}" if missing else "root"
        print(f"without_docker.py: needs {need}", file=sys.stderr)
        return 2
    targets = ["ride", "train"] if given.train else ["ride"]
    results: dict[str, Any] = {
        "command": " ".join(["docker/without_docker.py", *sys.argv[1:]]),
        "commit": call("git", "describe", "--always", "--dirty", "--abbrev=40", cwd=ROOT).strip(),
        "date": time.strftime("%Y-%m-%d", time.gmtime()),
        "buildah": call("buildah", "--version").strip(),
        "processors": os.cpu_count(),
        "load": os.getloadavg()[0],
    }
    try:
        results |= trial(targets)
    except TrialError as error:
        print(f"without_docker.py: {error}", file=sys.stderr)
        return 1
    finally:
        if not given.keep:
            clean(targets)
    text = json.dumps(results, indent=2)
    print(text)
    if given.json is not None:
        given.json.parent.mkdir(parents=True, exist_ok=True)
        given.json.write_text(text + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
