"""Every program of the stack that reads a command line with argparse, ready to be called.

Each is called as a user calls it, in this process, up to where its work begins: what would ride,
learn or record is replaced by a stop that tells that the command line was accepted.
"""

from __future__ import annotations

import argparse
import contextlib
import importlib
import itertools
import shutil
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from bicycle_bag.nodes import player_node, recorder_node
from bicycle_bag.repair import main as repair
from bicycle_bag.writer import BagWriter
from bicycle_bringup.ride_options import parse as parse_ride
from bicycle_cockpit.options import parse as parse_cockpit
from bicycle_controller.cli import main
from bicycle_tools.nodes import goal, path, push, reset, service, topic, verify
from bicycle_tools.report_page import command as report

BAG = Path(__file__).parents[1] / "data" / "ride-0.1.0"
Words = list[str]


class Accepted(BaseException):
    """The work would begin now."""


class Parser(BaseException):
    """Carries the parser that was about to read the command line."""


def begin(*_: Any, **__: Any) -> Any:
    raise Accepted


def nothing(_: Path) -> Words:
    return []


@dataclass(frozen=True)
class Program:
    """A program and a command line of it that is right."""

    name: str
    call: Callable[[Words], Any]
    """Does what the words say; gives or exits with the status."""
    positionals: Callable[[Path], Words] = nothing
    """Given a folder of its own."""
    options: Callable[[Path], Words] = nothing
    work: tuple[str, ...] = ()
    """`module:name` of what is not to be done."""
    verb: Words = field(default_factory=list)

    def words(self, folder: Path) -> Words:
        return [*self.verb, *self.positionals(folder), *self.options(folder)]

    def parser(self, monkeypatch: pytest.MonkeyPatch) -> argparse.ArgumentParser:
        """Return the parser that it makes, taken just before it reads anything."""

        def caught(parser: argparse.ArgumentParser, *_: Any, **__: Any) -> None:
            raise Parser(parser)

        with monkeypatch.context() as patch:
            patch.setattr(argparse.ArgumentParser, "parse_known_args", caught)
            with contextlib.suppress(SystemExit), pytest.raises(Parser) as found:
                self.call([])
        result: argparse.ArgumentParser = found.value.args[0]
        for action in result._actions if self.verb else ():
            if isinstance(action, argparse._SubParsersAction):
                return action.choices[self.verb[0]]
        return result


def main_of(module: Any) -> Callable[[Words], Any]:
    """Call a main() that reads sys.argv."""

    def call(words: Words) -> Any:
        kept, sys.argv = sys.argv, ["program", *words]
        try:
            return module.main()
        finally:
            sys.argv = kept

    return call


def bicycle(
    name: str,
    *work: str,
    positionals: Callable[[Path], Words] = nothing,
    options: Callable[[Path], Words] = nothing,
) -> Program:
    title, call = f"bicycle {name}", lambda words: main.main([name, *words])
    return Program(title, call, positionals, options, work)


@contextlib.contextmanager
def no_node(*_: Any) -> Iterator[None]:
    yield None


def write_nothing(*words: Any, **options: Any) -> None:
    """Make the bag that would be recorded into, and close it."""
    BagWriter(*words, **options).close()
    raise Accepted


def ride(words: Words) -> None:
    parse_ride(words, Path.cwd()).draw_goals()
    raise Accepted


def cockpit(words: Words) -> None:
    parse_cockpit(words, Path.cwd())
    raise Accepted


_numbers = itertools.count()


def new(folder: Path, suffix: str = "") -> str:
    """Return a path where nothing is yet."""
    return str(folder / f"new-{next(_numbers)}{suffix}")


def copied(folder: Path) -> str:
    return str(shutil.copytree(BAG, new(folder)))


def bag(_: Path) -> Words:
    return [str(BAG)]


def output(option: str, *more: str) -> Callable[[Path], Words]:
    return lambda folder: [option, new(folder), *more]


PROGRAMS = (
    bicycle("train", "bicycle_controller.training.online:Trainer", options=output("--out")),
    bicycle(
        "evaluate",
        positionals=lambda _: ["fixed-speed"],
        options=lambda _: ["--episodes=2", "--set=max_steps=3"],
    ),
    bicycle(
        "learn",
        "bicycle_controller.training.offline:run",
        positionals=bag,
        options=output("--out", "--least=1", "--json"),
    ),
    bicycle("sweep", "bicycle_controller.training.sweep:sweep", options=output("--out")),
    bicycle(
        "reproduce",
        "bicycle_controller.cli.reproduce:reproduce",
        positionals=lambda _: ["9"],
        options=output("--out", "--short"),
    ),
    bicycle(
        "export",
        positionals=lambda _: ["fixed-speed"],
        options=output("--to", "--format=safetensors"),
    ),
    Program(
        "record.sh", recorder_node.main, options=output("--output", "--topics=/bicycle/state")
    ),
    Program("replay.sh", player_node.main, positionals=bag),
    Program("record.sh --repair", repair, positionals=lambda folder: [copied(folder)]),
    Program(
        "replay.sh --verify",
        main_of(verify),
        positionals=bag,
        work=("bicycle_tools.nodes.verify_states:verify",),
    ),
    Program(
        "report.sh",
        report.main,
        positionals=bag,
        options=lambda folder: ["--output", new(folder, ".html")],
        work=("bicycle_tools.report_page.command:html",),
    ),
    Program("ride.sh", ride, options=output("--output")),
    Program("cockpit.sh", cockpit),
    Program(
        "goal.sh",
        main_of(goal),
        positionals=lambda _: ["1", "2"],
        work=("bicycle_tools.nodes.goal:start_tool",),
    ),
    Program(
        "reset.sh",
        main_of(reset),
        positionals=lambda _: ["1", "2", "0.5"],
        work=("bicycle_tools.nodes.reset:run_tool",),
    ),
    Program(
        "push.sh",
        main_of(push),
        positionals=lambda _: ["left", "0.3"],
        work=("bicycle_tools.nodes.push:run_tool",),
    ),
    Program(
        "path.sh",
        main_of(path),
        positionals=lambda _: ["slalom"],
        work=("bicycle_tools.nodes.path:start_tool",),
    ),
    *(
        Program(
            "service.sh",
            main_of(service),
            positionals=lambda _: ["bicycle/reset"],
            work=("bicycle_tools.nodes.service:run_tool",),
            verb=[verb],
        )
        for verb in ("type", "call")
    ),
    *(
        Program(
            "topic.sh",
            main_of(topic),
            positionals=lambda _: ["bicycle/state"],
            work=("bicycle_tools.nodes.topic:start_tool",),
            verb=[verb],
        )
        for verb in ("info", "type", "echo", "rate", "hz", "pub")
    ),
)


def stop_before_work(program: Program, monkeypatch: pytest.MonkeyPatch) -> None:
    for place in program.work:
        module, _, name = place.partition(":")
        monkeypatch.setattr(importlib.import_module(module), name, begin)
    monkeypatch.setattr(recorder_node, "ros_node", no_node)
    monkeypatch.setattr(recorder_node, "BagWriter", write_nothing)
    monkeypatch.setattr(player_node, "ros_node", begin)
