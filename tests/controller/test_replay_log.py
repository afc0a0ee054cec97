from pathlib import Path

import numpy as np
import pytest

from bicycle_controller.data.replay_log import ReplayLog


def rows(first: int, count: int) -> np.ndarray:
    return np.arange(3 * first, 3 * (first + count), dtype=np.float32).reshape(count, 3)


def test_rows_come_back_in_order_and_only_new_ones_are_written(tmp_path: Path) -> None:
    path = tmp_path / "deep" / "memory"
    file = ReplayLog(path, 3)
    file.add(rows(0, 4))
    file.add(rows(4, 1))
    assert (file.rows, file.saved) == (5, 0)
    file.save()
    size = path.stat().st_size
    assert (file.rows, file.saved, size) == (5, 5, 5 * 3 * 4)
    file.add(rows(5, 2))
    file.save()
    assert path.stat().st_size == 7 * 3 * 4
    assert np.array_equal(ReplayLog(path, 3).load(7), rows(0, 7))


def test_what_a_crash_left_behind_the_checkpoint_is_overwritten(tmp_path: Path) -> None:
    path = tmp_path / "memory"
    file = ReplayLog(path, 3)
    file.add(rows(0, 5))
    file.save()
    # The checkpoint that counted rows 3 and 4 was never written.
    again = ReplayLog(path, 3)
    assert np.array_equal(again.load(3), rows(0, 3))
    again.add(rows(10, 1))
    again.save()
    assert np.array_equal(ReplayLog(path, 3).load(4), np.concatenate([rows(0, 3), rows(10, 1)]))


def test_a_file_that_is_gone_or_cut_short_is_one_line(tmp_path: Path) -> None:
    file = ReplayLog(tmp_path / "memory", 3)
    with pytest.raises(ValueError, match="cannot read"):
        file.load(1)
    file.add(rows(0, 2))
    file.save()
    with pytest.raises(ValueError, match="cut short"):
        file.load(3)
