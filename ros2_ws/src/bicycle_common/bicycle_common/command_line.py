"""Command-line parsing: one line for a user's mistake, and ROS arguments among the options."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Iterator, Sequence
from typing import Any, NoReturn

from bicycle_common.validation import empty_word, nearest

FAILED = 1
"""Exit status of a failure."""

USAGE_ERROR = 2
"""Exit status for a user's mistake."""

INTERRUPTED = 130
"""Exit status after Ctrl-C."""

_RULE = re.compile(r"(__[a-z]+|[A-Za-z_/~][\w/~.]*):=\S*")
"""A parameter or remapping rule in ROS syntax, `name:=value`."""


class OneLineParser(argparse.ArgumentParser):
    """Parser that reports a user's mistake in one line.

    Attributes:
        helper: Command whose `--help` a mistake's line names.
    """

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        self.helper = self.prog.split()[0]

    def error(self, message: str) -> NoReturn:
        """End the program with status 2 and one line, without the usage."""
        print(f"{self.prog}: {message}; see {self.helper} --help", file=sys.stderr)
        raise SystemExit(USAGE_ERROR)

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parse as `argparse` does, but refuse an empty word."""
        words = list(sys.argv[1:] if args is None else args)
        if mistake := empty_word(words):
            self.error(mistake)
        return super().parse_known_args(words, namespace)

    def parse_with_hint(self, words: Sequence[str]) -> argparse.Namespace:
        """Parse as `parse_args` does, but name the nearest option for an unknown one."""
        args, unknown = self.parse_known_args(words)
        if unknown:
            hint = nearest(unknown[0].partition("=")[0], self._option_string_actions)
            self.error(f"unknown argument {unknown[0]!r}{hint}")
        return args

    def parse_with_ros(self, words: Sequence[str]) -> tuple[argparse.Namespace, list[str]]:
        """Parse a command line that may hold `__ns:=/name`, `/from:=/to` and `--ros-args ...`.

        An option's value is never read as a ROS argument. These programs have no parameters, so
        `name:=value` is an error.

        Args:
            words: the command line without the program's name.

        Returns:
            The parsed options, and the ROS arguments: empty, or beginning with `--ros-args`.
        """
        for word in words:
            if any("\udc80" <= letter <= "\udcff" for letter in word):
                self.error(f"{word!r} is not UTF-8, which names in ROS and in bags must be")
        own, ros = self._split(list(words))
        options = self.parse_args(own)
        return options, ["--ros-args", *ros] if ros else []

    def _split(self, words: list[str]) -> tuple[list[str], list[str]]:
        own: list[str] = []
        ros: list[str] = []
        while words:
            word = words.pop(0)
            if word == "--":
                own += [word, *words]
                words = []
            elif word == "--ros-args":
                ros += _until_end(words)
            elif word.startswith("-"):
                own += [word, *self._values(word, words)]
            elif _RULE.fullmatch(word):
                ros += ["-r", self._rule(word)]
            else:
                own.append(word)
        return own, ros

    def _values(self, option: str, words: list[str]) -> list[str]:
        """Take the words that are values of `option`."""
        action = next(self._known(option), None)
        if action is None or "=" in option or not words:
            return []
        if action.nargs is None:
            return [words.pop(0)]
        if action.nargs == "?":
            is_value = not (words[0].startswith("-") or _RULE.fullmatch(words[0]))
            return [words.pop(0)] if is_value else []
        taken: list[str] = []
        while action.nargs in ("+", "*") and words and not words[0].startswith("-"):
            if _RULE.fullmatch(words[0]) and action.metavar != RULES:
                break
            taken.append(words.pop(0))
        return taken

    def _known(self, option: str) -> Iterator[argparse.Action]:
        """Yield the actions of the option of that name, of this parser or of a subcommand."""
        for action in self._actions:
            if option in action.option_strings:
                yield action
            if isinstance(action, argparse._SubParsersAction):
                for verb in action.choices.values():
                    yield from verb._known(option)

    def _rule(self, word: str) -> str:
        """Return a remapping rule; end the program on a parameter."""
        if not word.startswith(("__", "/")):
            self.error(f"there are no parameters here, so {word!r} does nothing")
        return word


RULES = "FROM:=TO"
"""Metavar of an option whose values are remapping rules."""


def _until_end(words: list[str]) -> list[str]:
    """Take the ROS arguments, up to a lone `--`."""
    taken = []
    while words and (word := words.pop(0)) != "--":
        taken.append(word)
    return taken
