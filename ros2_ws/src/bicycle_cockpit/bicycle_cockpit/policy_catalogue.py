"""Controllers that a page can choose: the shipped ones, LQR, and a folder's policy files."""

from __future__ import annotations

from pathlib import Path

from bicycle_cockpit.riders import label
from bicycle_controller.policy.policy import BEST, KEPT, LQR, SUFFIX, shipped_policies

MOST_FILES = 200
"""Largest number of offered files, the newest."""


class PolicyCatalogue:
    """Controllers by the names that pages use; a page cannot name a path."""

    def __init__(self, folder: Path | None) -> None:
        """Offer the shipped policies, and the policy files in `folder` and its subfolders."""
        self._folder = folder

    def offered(self) -> list[dict[str, str]]:
        """Return name, label and group of each controller, in display order."""
        groups = {
            **dict.fromkeys(shipped_policies(), "shipped"),
            **dict.fromkeys(LQR, "classical"),
        }
        groups |= dict.fromkeys(self._files(), "trained here")
        return [
            {"name": name, "label": label(name), "group": group} for name, group in groups.items()
        ]

    def path(self, name: str) -> str:
        """Return the argument of `bicycle/load_policy` for a name.

        Raises:
            KeyError: if it is not offered.
        """
        if name in shipped_policies() or name in LQR:
            return name
        return str(self._files()[name].resolve())

    def _files(self) -> dict[str, Path]:
        """Return the best policy of each run by the run's name, other files by their own."""
        if self._folder is None:
            return {}
        try:
            files = [*self._folder.glob(f"*{SUFFIX}"), *self._folder.glob(f"*/*{SUFFIX}")]
            files += self._folder.glob(f"*/*/{BEST}")
            files += self._folder.glob(f"*/{KEPT}/*{SUFFIX}")
            files = sorted(files, key=lambda path: -path.stat().st_mtime)[:MOST_FILES]
        except OSError:
            return {}
        names = {}
        for path in files:
            relative = path.relative_to(self._folder)
            name = relative.parent if path.name == BEST else relative.with_suffix("")
            names[name.as_posix()] = path
        return names


def file_title(path: Path) -> str:
    """Return the displayed name of a policy file, or of a controller that is no file.

    The best policy of a run has the run's name, and one that was kept in training says when.
    """
    if path.name == BEST:
        return path.resolve().parent.name
    if path.parent.name == KEPT:
        run = path.resolve().parent.parent.name
        return label(f"{run}/{KEPT}/{path.stem}")
    return path.stem if path.suffix == SUFFIX else path.name
