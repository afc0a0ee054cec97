"""Remove from a virtual environment everything that only building needs.

Usage: prune.py REQUIREMENTS...    with the interpreter of the environment, see seal.sh

Packages that are needed by the part of these files above their line `# Building ...` stay. Then
headers, CMake files and other packages' tests are removed, and copies of a library become links.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
from collections.abc import Iterable
from importlib import metadata
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

BUILDING = "\n# Building "
TESTED = ("numpy", "scipy", "matplotlib", "networkx", "sympy")
"""Packages that ship their tests."""


def named(files: Iterable[str]) -> list[Requirement]:
    """Return the direct runtime requirements of the files; skip the files that they include."""
    lines = [
        line.partition("#")[0].strip()
        for path in files
        for line in Path(path).read_text().partition(BUILDING)[0].splitlines()
    ]
    return [Requirement(line) for line in lines if line and not line.startswith("-")]


def needed(roots: Iterable[Requirement]) -> set[str]:
    """Return canonical names of these packages and of all packages that they need."""
    found: set[str] = set()
    seen: set[tuple[str, frozenset[str]]] = set()
    waiting = list(roots)
    while waiting:
        wanted = waiting.pop()
        name, extras = canonicalize_name(wanted.name), frozenset(wanted.extras)
        if (name, extras) in seen:
            continue
        seen.add((name, extras))
        try:
            requires = metadata.distribution(name).requires or []
        except metadata.PackageNotFoundError:
            continue  # torch, in an image that only rides
        found.add(name)
        for requirement in map(Requirement, requires):
            marker = requirement.marker
            chosen = [{"extra": extra} for extra in extras or [""]]
            if marker is None or any(marker.evaluate(choice) for choice in chosen):
                waiting.append(requirement)
    return found


def strip(prefix: Path) -> None:
    """Remove files that are not used at run time."""
    shutil.rmtree(prefix / "include", ignore_errors=True)
    for folder in (prefix / "share").glob("*/cmake"):
        shutil.rmtree(folder)
    for package in TESTED:
        for place in (prefix / "lib").glob(f"python3.*/site-packages/{package}"):
            for folder in [found for found in place.rglob("tests") if found.is_dir()]:
                shutil.rmtree(folder, ignore_errors=True)
    for library in sorted((prefix / "lib").glob("*.so")):
        versions = sorted(
            library.parent.glob(f"{library.name}.*"), key=lambda path: len(path.name)
        )
        if versions:
            newest = versions[-1]
            for copy in (library, *versions[:-1]):
                if not copy.is_symlink() and copy.read_bytes() == newest.read_bytes():
                    copy.unlink()
                    copy.symlink_to(newest.name)


def main() -> None:
    """Prune the environment that this interpreter belongs to."""
    kept = needed([*named(sys.argv[1:]), Requirement("torch")])
    # Some wheels contain the metadata of their sources, which pip must not follow.
    installed = {
        canonicalize_name(found.metadata["Name"])
        for found in metadata.distributions()
        if found.read_text("INSTALLER")
    }
    gone = sorted(installed - kept - {"pip"})
    subprocess.run([sys.executable, "-m", "ensurepip"], check=True, stdout=subprocess.DEVNULL)
    pip = [sys.executable, "-m", "pip", "uninstall", "--yes", "--quiet"]
    subprocess.run([*pip, *gone], check=True)
    subprocess.run([*pip, "pip"], check=True)
    strip(Path(sys.prefix))
    print(f"{len(kept)} packages kept, {len(gone)} gone")


if __name__ == "__main__":
    main()
