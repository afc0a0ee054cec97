"""Bags are read by a process of their own: what is done to it costs the pages nothing."""

from __future__ import annotations

import asyncio
import gzip
import json
import os
import shutil
import signal
import sys
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any, TypeVar

import pytest
from made_bag import STEPS, write_bag

from bicycle_cockpit import bag_desk
from bicycle_cockpit.bag_desk import BagDesk, BagProblemError

Result = TypeVar("Result")


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_bag(tmp_path_factory.mktemp("made") / "bag")


def asked(folder: Path, story: Callable[[BagDesk], Awaitable[Result]]) -> Result:
    """Run a story with a desk and return its result."""

    async def run() -> Result:
        desk = BagDesk(folder)
        try:
            return await story(desk)
        finally:
            await desk.close()

    return asyncio.run(run())


def pid_of(desk: BagDesk) -> int:
    process = desk._process
    assert process is not None
    return process.pid


ALIASES = [f"a{level}: &a{level} [{', '.join([f'*a{level - 1}'] * 10)}]" for level in range(1, 40)]
MERGES = [
    f"a{level}: &a{level} {{<<: [{', '.join([f'*a{level - 1}'] * 10)}]}}" for level in range(1, 40)
]
BOMBS = {"aliases": ["a0: &a0 [x, x]", *ALIASES], "merges": ["a0: &a0 {x: 1}", *MERGES]}
"""Lines of YAML of some kilobytes that stand for 10^39 values."""


def write_bomb(folder: Path, kind: str) -> None:
    """A bag whose metadata.yaml would take for ever, or all memory."""
    folder.mkdir()
    lines = ["version: 4", "storage_identifier: mcap", *BOMBS[kind]]
    lines += ["topics_with_message_count: []", "relative_file_paths: [*a39]"]
    text = "\n  ".join(["rosbag2_bagfile_information:", *lines])
    assert len(text) < 8000
    (folder / "metadata.yaml").write_text(text)


def test_a_bag_comes_as_the_page_draws_it_and_again_without_being_read(
    bag: Path, tmp_path: Path
) -> None:
    shutil.copytree(bag, tmp_path / "bag")

    async def story(desk: BagDesk) -> Any:
        (listed,) = await desk.listed()
        first = await desk.load("bag")
        first_pid = pid_of(desk)
        assert (await desk.load("bag")).body == first.body
        assert pid_of(desk) == first_pid
        with pytest.raises(BagProblemError) as missing:
            await desk.load("none")
        assert missing.value.status == 404
        return listed, first

    listed, loaded = asked(tmp_path, story)
    assert listed["name"] == "bag"
    data = json.loads(gzip.decompress(loaded.body))
    assert len(data["data"][0]) == STEPS + 1
    assert loaded.colours == ["first", "naf"]


def test_another_controller_rides_a_bag_again() -> None:
    folder = Path(__file__).resolve().parents[1] / "data"

    async def story(desk: BagDesk) -> Any:
        loaded = await desk.load("film-ride", "ppo")
        return json.loads(gzip.decompress(loaded.body)), loaded.colours

    ride, colours = asked(folder, story)
    assert colours == ["ppo"]
    assert [one["label"] for one in ride["riders"]] == ["PPO actor"]
    assert {"reached", "push"} <= {mark["kind"] for mark in ride["marks"]}


@pytest.mark.parametrize("kind", BOMBS)
def test_a_yaml_bomb_does_not_freeze_the_list(
    bag: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    monkeypatch.setattr(bag_desk, "ENTRY_TIME", 4.0)
    shutil.copytree(bag, tmp_path / "good")
    write_bomb(tmp_path / "bomb", kind)
    found = asked(tmp_path, lambda desk: desk.listed())
    by_name = {one["name"]: one for one in found}
    assert by_name["good"]["messages"] > 0
    assert "problem" in by_name["bomb"]


STUCK = """
import sys, time
from bicycle_cockpit import bag_worker
real = bag_worker.entry
def entry(name, path):
    while (path / "stuck").exists():
        time.sleep(1.0)
    return real(name, path)
bag_worker.entry = entry
sys.exit(bag_worker.main())
"""
"""The process, but for a bag that holds a file `stuck`: of that one the disk never answers."""


@pytest.fixture
def slow_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bag_desk, "WORKER", (sys.executable, "-c", STUCK))
    monkeypatch.setattr(bag_desk, "ENTRY_TIME", 4.0)


def test_a_bag_that_takes_for_ever_is_given_up_and_the_others_are_listed(
    bag: Path, tmp_path: Path, slow_disk: None
) -> None:
    for name in ("a", "b", "c"):
        shutil.copytree(bag, tmp_path / name)
    (tmp_path / "b" / "stuck").touch()

    async def story(desk: BagDesk) -> list[dict[str, Any]]:
        found = await desk.listed()
        pid = pid_of(desk)
        assert sorted(one["name"] for one in await desk.listed()) == ["a", "b", "c"]
        with pytest.raises(BagProblemError, match="takes too long"):
            await desk.load("b")
        assert (await desk.load("a")).body
        assert pid_of(desk) == pid, "what took too long was not tried again"
        return found

    found = {one["name"]: one for one in asked(tmp_path, story)}
    assert set(found) == {"a", "b", "c"}
    assert "takes too long" in found["b"]["problem"]
    assert found["c"]["messages"] > 0


def test_a_bag_that_took_too_long_is_tried_again_once_it_has_changed(
    bag: Path, tmp_path: Path, slow_disk: None
) -> None:
    shutil.copytree(bag, tmp_path / "b")
    (tmp_path / "b" / "stuck").touch()

    async def story(desk: BagDesk) -> list[list[dict[str, Any]]]:
        before = await desk.listed()
        (tmp_path / "b" / "stuck").unlink()
        return [before, await desk.listed()]

    (before,), (after,) = asked(tmp_path, story)
    assert "problem" in before
    assert after["messages"] > 0


def test_a_reader_that_is_killed_is_started_again(bag: Path, tmp_path: Path) -> None:
    shutil.copytree(bag, tmp_path / "bag")

    async def story(desk: BagDesk) -> None:
        await desk.listed()
        first = pid_of(desk)
        os.kill(first, signal.SIGKILL)
        process = desk._process
        assert process is not None
        await process.wait()
        assert (await desk.load("bag")).body
        assert pid_of(desk) != first

    asked(tmp_path, story)


def test_too_many_that_wait_are_sent_away_and_the_rest_are_served(
    bag: Path, tmp_path: Path
) -> None:
    shutil.copytree(bag, tmp_path / "bag")
    many = bag_desk.MOST_WAITING + 5

    async def story(desk: BagDesk) -> list[object]:
        return await asyncio.gather(
            *(desk.load("bag") for _ in range(many)), return_exceptions=True
        )

    found = asked(tmp_path, story)
    refused = [one for one in found if isinstance(one, BagProblemError)]
    assert [one.status for one in refused] == [503] * 5
    assert len({one.body for one in found if isinstance(one, bag_desk.Loaded)}) == 1


def test_who_leaves_while_a_bag_is_read_does_not_shift_the_answers(
    bag: Path, tmp_path: Path
) -> None:
    for name in ("one", "two"):
        shutil.copytree(bag, tmp_path / name)

    async def story(desk: BagDesk) -> str:
        await desk.listed()
        leaving = asyncio.create_task(desk.load("one"))
        await asyncio.sleep(0)
        await asyncio.sleep(0)
        leaving.cancel()
        loaded = await desk.load("two")
        return str(json.loads(gzip.decompress(loaded.body))["name"])

    assert asked(tmp_path, story) == "two"
