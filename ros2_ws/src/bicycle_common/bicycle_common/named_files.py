"""YAML files that come with a package and are known by name, and a user's own beside them."""

from __future__ import annotations

from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any, NamedTuple

from bicycle_common import yaml_text
from bicycle_common.validation import nearest


class NamedFile(NamedTuple):
    """Text of a file that was found."""

    text: str
    name: str
    """Without a suffix."""
    place: str
    """Name or path as the user gave it, for errors."""


class NamedFiles:
    """YAML files of one kind."""

    def __init__(self, package: str, folder: str, kind: str) -> None:
        """Look into `folder` of `package`; `kind` is the word for errors."""
        self._package, self._name, self._kind = package, folder, kind

    @property
    def _folder(self) -> Traversable:
        return resources.files(self._package) / self._name

    def names(self) -> list[str]:
        """Return the names that come with the package."""
        names = (entry.name for entry in self._folder.iterdir())
        return sorted(name.removesuffix(".yaml") for name in names if name.endswith(".yaml"))

    def find(self, name_or_file: str | Path) -> NamedFile:
        """Return the file of a name, or of a path.

        Raises:
            ValueError: when there is none or it cannot be read; one line with the nearest name.
        """
        text = str(name_or_file)
        known = self.names()
        if text in known:
            return NamedFile((self._folder / f"{text}.yaml").read_text(), text, text)
        path = Path(name_or_file)
        if not path.is_file():
            raise ValueError(
                f"no {self._kind} {text!r}{nearest(text, known)}: give a YAML file or one of "
                f"{', '.join(known)}"
            )
        try:
            return NamedFile(yaml_text.read_text(path), path.stem, str(path))
        except (OSError, UnicodeDecodeError, yaml_text.YAMLError) as error:
            raise ValueError(f"cannot read {path}: {error}") from error


def parsed(text: str, place: str) -> Any:
    """Return the plain data of YAML from `place`.

    Raises:
        ValueError: on other text; one line.
    """
    try:
        return yaml_text.load(text)
    except yaml_text.YAMLError as error:
        raise ValueError(f"{place} is no YAML: {' '.join(str(error).split())}") from error
