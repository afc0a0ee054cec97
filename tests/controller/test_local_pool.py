import os
import signal
import time
from pathlib import Path

import pytest
from node_process import alive
from waiting import until

from bicycle_controller.training.local_pool import RETRIES, LocalPool, LostTaskError, Task


def double(number: int) -> int:
    return 2 * number


def fail(reason: str) -> None:
    raise KeyError(reason)


def die(told: Path, times: int) -> str:
    """Die of SIGKILL, but for the first `times` calls."""
    with told.open("a") as file:
        file.write("x")
    if len(told.read_text()) <= times:
        os.kill(os.getpid(), signal.SIGKILL)
    return "alive"


def save_when_asked(folder: Path) -> str:
    asked: list[int] = []
    signal.signal(signal.SIGTERM, lambda number, _: asked.append(number))
    (folder / f"{os.getpid()}.begun").touch()
    while not asked:
        time.sleep(0.01)
    (folder / f"{os.getpid()}.saved").touch()
    return "saved"


def sleep_on(folder: Path) -> None:
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    (folder / f"{os.getpid()}.begun").touch()
    time.sleep(3600.0)


def results(pool: LocalPool) -> dict[str, object]:
    found: dict[str, object] = {}
    while pool.left:
        found |= {task.name: result for task, result in pool.done(1.0)}
    return found


def test_every_result_arrives_also_of_what_fails() -> None:
    pool = LocalPool(2)
    for number in range(3):
        pool.add(Task(f"task {number}", double, (number,)))
    pool.add(Task("bad", fail, ("no such thing",), processors=8))  # more than there are
    found = results(pool)
    assert [found[f"task {number}"] for number in range(3)] == [0, 2, 4]
    assert isinstance(found["bad"], LostTaskError)
    assert str(found["bad"]) == "bad: KeyError: 'no such thing'"


@pytest.mark.parametrize("deaths", [2, RETRIES + 1])
def test_a_killed_process_is_started_again_a_few_times(tmp_path: Path, deaths: int) -> None:
    pool = LocalPool(1)
    pool.add(Task("victim", die, (tmp_path / "told", deaths)))
    found = results(pool)["victim"]
    if deaths <= RETRIES:
        assert found == "alive"
    else:
        assert str(found) == "victim: its process was killed by SIGKILL 4 times"


def begun(folder: Path) -> list[int]:
    return [int(path.stem) for path in folder.glob("*.begun")]


def test_no_more_run_than_there_are_processors_and_each_saves_at_the_end(tmp_path: Path) -> None:
    pool = LocalPool(3)
    for number in range(3):
        pool.add(Task(f"task {number}", save_when_asked, (tmp_path,), processors=1 + number % 2))
    until(lambda: not list(pool.done(0.05)) and len(begun(tmp_path)) == 2)
    pool.stop(60.0)
    assert not pool.left
    assert len(list(tmp_path.glob("*.saved"))) == len(begun(tmp_path)) == 2


def test_one_that_does_not_end_is_killed(tmp_path: Path) -> None:
    pool = LocalPool(1)
    pool.add(Task("endless", sleep_on, (tmp_path,)))
    until(lambda: not list(pool.done(0.05)) and begun(tmp_path))
    (process,) = begun(tmp_path)
    pool.stop(0.2)
    assert not alive(process)
