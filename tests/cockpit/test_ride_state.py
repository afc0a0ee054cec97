"""Messages to a page about a ride in progress, on a clock that the test sets."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable
from dataclasses import asdict
from types import SimpleNamespace

import numpy as np
import pytest
from still_clock import Clock

from bicycle_cockpit.loop_stats import WINDOW, LoopStats, loop_figures
from bicycle_cockpit.rate_limiter import RateLimiter
from bicycle_cockpit.ride_state import BURST, HISTORY, PIECE, RATE, SILENCE, RideState
from bicycle_cockpit.rows import Rows, joined
from bicycle_cockpit.samples import COLUMNS, Sample, plain_column, plain_row, reward_columns
from bicycle_sim.plants import registry
from bicycle_sim.task.reward import RewardWeights


def sample(step: int, t: float | None = None, **changes: float) -> Sample:
    values = dict.fromkeys(COLUMNS, 0.0) | {"episode": 1, "step": step}
    return Sample(**{**values, "t": 0.025 * step if t is None else t, **changes})


def steps(rows: Iterable[Rows | None]) -> list[float]:
    """Return the steps in parts that follow one another."""
    found = [part for part in rows if part is not None]
    return [json.loads(text)[2] for text in joined(found).texts] if found else []


def test_a_frame_holds_the_rows_since_the_last_one() -> None:
    live = RideState(Clock())
    assert live.frame() is None
    for step in range(3):
        assert live.add(sample(step))
    assert not live.add(sample(2)), "a state that is published again is no new step"
    assert steps([live.frame()]) == [0, 1, 2]
    assert live.frame() is None


def test_who_comes_late_gets_the_last_two_minutes() -> None:
    live = RideState(Clock())
    for step in range(HISTORY + 10):
        live.add(sample(step))
    live.frame()
    pieces = live.history()
    assert len(pieces[0].texts) == PIECE, "the newest piece comes first"
    assert steps(reversed(pieces)) == list(range(10, HISTORY + 10))


@pytest.mark.parametrize("waiting", [0, 1, 2, 30])
def test_history_and_the_next_frame_neither_overlap_nor_leave_a_row_out(waiting: int) -> None:
    live = RideState(Clock())
    sent = []
    for step in range(50):
        live.add(sample(step))
        if step == 49 - waiting:
            sent.append(live.frame())
    hello = live.hello()
    history, frame = live.history(), live.frame()
    assert steps([*reversed(history), frame]) == list(range(50))
    assert hello["next"] == 50 - waiting == history[0].end
    assert frame is None or frame.first == hello["next"]


def test_a_simulator_that_was_started_anew_begins_a_new_history() -> None:
    live = RideState(Clock())
    live.add(sample(5))
    live.frame()
    before = live.hello()["ride"]
    live.add(sample(6))
    live.add(sample(0))
    assert live.history() == []
    frame = live.frame()
    assert frame is not None
    assert (frame.ride, frame.first, steps([frame])) == (before + 1, 0, [0])


def test_another_start_at_the_same_step_is_another_ride() -> None:
    """A ride that is set up anew before its first step begins at step 0 again."""
    live = RideState(Clock())
    live.add(sample(0, speed=2.8, x=math.nan))
    live.frame()
    before = live.hello()["ride"]
    assert not live.add(sample(0, speed=2.8, x=math.nan, torque=1.0))
    assert live.add(sample(0, speed=3.0, x=math.nan))
    frame = live.frame()
    assert frame is not None
    assert (frame.ride, frame.first, steps([frame])) == (before + 1, 0, [0])


def test_what_happens_is_told_with_its_place_and_counted() -> None:
    live = RideState(Clock())
    assert "x" not in live.event("info", "before the first state", kind="reset")
    live.add(sample(1, x=3.0, y=4.0))
    fell = live.event("bad", "the bicycle fell", kind="fell")
    assert (fell["n"], fell["x"], fell["y"]) == (1, 3.0, 4.0)
    assert live.event("good", "there", kind="reached", x=9.0, y=8.0)["x"] == 9.0
    assert [event["n"] for event in live.hello()["events"]] == [0, 1, 2]


def test_rows_name_the_policy_that_rode() -> None:
    live = RideState(Clock())
    numbers = [live.policy_number(name) for name in ("naf@1", "lqr-2", "naf@1")]
    assert numbers == [0, 1, 0]
    assert math.isnan(live.policy_number(""))
    live.names["naf@1"] = "naf"
    one, two = live.riders()["riders"]
    assert (one["name"], one["colour"]) == ("naf", "naf")
    assert (two["name"], two["colour"]) == ("lqr", "lqr-2")


def test_lock_step_is_thinned_and_silence_is_noticed() -> None:
    clock = Clock()
    live = RideState(clock)
    assert not live.hears_simulator
    taken = 0
    for _ in range(10_000):  # 1,000 steps a second
        clock.now += 0.001
        taken += live.due()
    assert taken == pytest.approx(BURST + 10.0 * RATE, abs=2)
    live.add(sample(1))
    assert live.status()["mode"] == "held"
    clock.now += SILENCE * 1.1
    assert live.status()["mode"] == "silent"


def test_steps_that_waited_while_the_cockpit_was_busy_are_all_kept() -> None:
    clock = Clock()
    live = RideState(clock)
    clock.now += 5.0
    assert all(live.due() for _ in range(200)), "5 s of the ride at once"


def test_all_of_it_is_json_without_nan() -> None:
    live = RideState(Clock())
    live.add(sample(1, goal_distance=math.nan, heading_error=math.inf))
    live.event("good", "reached", kind="reached", x=1.0, y=2.0)
    live.trained({"updates": 5})
    live.trained({"updates": 5})
    live.policy_number("naf@1")
    for message in (live.hello(), live.riders(), live.status(pages=1)):
        json.dumps(message, allow_nan=False)
    frame = live.frame()
    assert frame is not None
    assert "NaN" not in frame.message("frame")
    assert json.loads(frame.message("frame"))["rows"][0][2] == 1
    assert live.hello()["training"] == [{"updates": 5}]
    assert plain_row([math.nan, 1.0000049]) == [None, 1.0]
    assert plain_column(np.array([1, np.nan, -np.inf])) == [1.0, None, None]


def test_the_terms_of_the_reward_are_those_of_equation_20() -> None:
    state = {"lean_angle": 0.1, "lean_rate": -0.2, "lean_acceleration": 1.0, "heading_error": 0.5}
    terms = reward_columns(state, RewardWeights())
    assert terms == pytest.approx([-0.01, -0.004, -0.01, -0.5])


def test_figures_of_the_loop() -> None:
    period = np.array([np.nan, 0.025, 0.025, 0.027, 0.023])
    late = np.array([0.0, 0.001, 0.002, 0.003, 0.004])
    figures = loop_figures(period, late, np.full(5, np.nan))
    assert figures["rate"] == 40.0
    assert figures["jitter_max"] == pytest.approx(2.0)
    assert figures["jitter_p50"] == pytest.approx(1.0)
    assert figures["lateness_p50"] == pytest.approx(2.0)
    assert figures["latency_p50"] is None
    assert loop_figures(*3 * [np.array([])])["rate"] is None


def test_they_are_about_the_last_seconds() -> None:
    clock = Clock()
    stats = LoopStats(clock)
    timing = {"lateness": 0.0, "latency": 0.002, "late_steps": 1, "dropped_steps": 2}
    stats.add(SimpleNamespace(period=0.5, **timing))
    clock.now += WINDOW + 1.0
    stats.add(SimpleNamespace(period=0.025, **timing))
    figures = stats.figures()
    assert (figures["rate"], figures["late"], figures["dropped"]) == (40.0, 1, 2)


def test_a_bucket_lets_a_burst_through_and_then_the_rate() -> None:
    clock = Clock()
    bucket = RateLimiter(rate=2.0, burst=3.0, clock=clock)
    assert [bucket.take() for _ in range(4)] == [True, True, True, False]
    clock.now += 0.5
    assert [bucket.take() for _ in range(2)] == [True, False]


def test_a_page_knows_a_bicycle_before_a_simulator_tells_its_own() -> None:
    assert RideState(Clock()).hello()["facts"] == {"geometry": asdict(registry.default().geometry)}
