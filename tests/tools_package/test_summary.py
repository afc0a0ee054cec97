"""The numbers of a ride, against a ride worked out by hand."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from rides import SPEED, commands, joined, ride, states, statuses, timing

from bicycle_controller.control.guide import PathEnd
from bicycle_tools.outcomes import outcomes
from bicycle_tools.ride_log import distinct
from bicycle_tools.summary import path_ratio, summarise
from bicycle_tools.text_summary import render

GOALS = statuses(
    (1, 1, (10.0, 0.0), 10.0, 0.0),
    (1, 2, (10.0, 0.0), 1.0, 9.9),
    (2, 1, (0.0, 9.0), 11.0, 0.0),
    (2, 2, (0.0, 9.0), 1.0, 15.0),
)


def test_a_ride_without_a_hitch() -> None:
    log = ride(states(201), GOALS, timing([math.nan] + [0.025] * 199), commands(200))
    summary = summarise(log)
    assert (summary.goals, summary.reached, summary.falls) == (2, 2, 0)
    assert summary.perfect
    assert summary.ridden_time == pytest.approx(5.0)
    assert summary.path_length == pytest.approx(10.0)
    assert summary.mean_speed == pytest.approx(SPEED)
    assert summary.path_ratio == pytest.approx((9.9 + 15.0) / (9.0 + 10.0))
    assert summary.peak_lean == 0.2
    assert summary.policies == ("lqr-1",)
    assert summary.loop.rate == pytest.approx(40.0)
    assert summary.loop.jitter.p99 == pytest.approx(0.0)
    assert summary.loop.latency.p50 == 0.002
    assert not summary.loop.lockstep


def test_jitter_is_the_distance_from_the_median_period() -> None:
    periods = [0.025] * 98 + [0.023, 0.030]
    loop = summarise(ride(states(101), times=timing(periods))).loop
    assert loop.jitter.largest == pytest.approx(0.005)
    assert loop.jitter.p50 == pytest.approx(0.0)
    # The 99th of 100 values in order is 0.002; numpy's quantile lies 0.01 of the way beyond it.
    assert loop.jitter.p99 == pytest.approx(0.002 + 0.01 * 0.003)
    assert loop.rate == pytest.approx(100 / (98 * 0.025 + 0.053))


def test_repeated_states_of_a_held_bicycle_count_once() -> None:
    held = states(1)
    recorded = joined(held, held, held, states(3))
    kept, segment = distinct(recorded)
    assert list(kept["step"]) == [0, 1, 2]
    assert list(segment) == [0, 0, 0]


def test_another_start_at_the_same_step_begins_a_segment() -> None:
    stood = states(1) | {"rear_contact.x": np.array([50.0])}
    kept, segment = distinct(joined(stood, stood, states(3)))
    assert list(kept["step"]) == [0, 0, 1, 2]
    assert list(segment) == [0, 1, 1, 1]


def test_a_reset_begins_a_segment_and_its_jump_is_no_path() -> None:
    log = ride(joined(states(41), states(41, episode=2)))
    assert list(np.unique(log.segment)) == [0, 1]
    assert summarise(log).path_length == pytest.approx(4.0)
    assert summarise(log).ridden_time == pytest.approx(2.0)


def test_a_simulator_started_anew_begins_a_segment() -> None:
    assert len(np.unique(ride(joined(states(5), states(5))).segment)) == 2


def test_each_fall_counts_once() -> None:
    log = ride(joined(states(20, fall_at=15), states(20, episode=2, fall_at=19)))
    summary = summarise(log)
    assert summary.falls == 2
    assert not summary.perfect


def test_missing_steps_and_watchdog_are_counted() -> None:
    recorded = states(50)
    recorded["command_source"][10:14] = 2
    recorded["command_source"][14:20] = 3
    recorded["command_source"][30:31] = 3
    kept = np.r_[0:22, 25:50]
    loop = summarise(ride({name: column[kept] for name, column in recorded.items()})).loop
    assert (loop.held_steps, loop.zero_steps, loop.watchdog_events) == (4, 7, 2)
    assert loop.lost_steps == 3


def test_counters_go_on_over_a_restart_of_the_simulator() -> None:
    loop = summarise(ride(states(5), times=timing([0.025] * 5, late=[0, 2, 3, 0, 1]))).loop
    assert loop.late_steps == 4


def test_lockstep_is_told_from_its_missing_schedule() -> None:
    times = timing([0.004] * 5)
    times["lateness"][:] = math.nan
    summary = summarise(ride(states(6), times=times))
    assert summary.loop.lockstep
    assert "lock-step" in render(summary)
    assert "jitter" not in render(summary)


def test_a_bag_without_goals_or_timing_still_gives_a_summary() -> None:
    summary = summarise(ride(states(3)))
    assert summary.goals == 0
    assert not summary.perfect
    text = json.dumps(summary.to_dict(), allow_nan=False)
    assert json.loads(text)["path_ratio"] is None
    assert json.loads(text)["loop"]["latency"] == {"p50": None, "p99": None, "largest": None}
    assert "not measured" in render(summary)


def test_the_ratio_takes_only_goals_that_were_reached() -> None:
    found = outcomes(
        statuses(
            (1, 1, (10.0, 0.0), 10.0, 0.0),
            (1, 3, (10.0, 0.0), 2.0, 500.0),
            (2, 1, (0.0, 9.0), 11.0, 0.0),
            (2, 2, (0.0, 9.0), 1.0, 12.0),
        )
    )
    assert path_ratio(found) == pytest.approx(1.2)
    assert math.isnan(path_ratio(found[:1]))


def test_the_screen_names_events_and_numbers() -> None:
    log = ride(states(201), GOALS, timing([0.025] * 200), commands(200))
    text = render(summarise(log), ["controller exited with status 1 at t = 3.0 s"])
    assert "2 of 2 reached" in text
    assert "40.00 Hz, real time" in text
    assert "controller exited with status 1 at t = 3.0 s" in text
    assert max(map(len, text.splitlines())) < 100


def test_of_a_course_the_screen_tells_the_course_s_result_and_no_goals() -> None:
    followed = {
        "path_id": np.array([1, 1]),
        "name": np.array(["slalom", "slalom"], dtype=object),
        "status": np.array([int(PathEnd.ACTIVE), int(PathEnd.FINISHED)]),
        "message": np.array(["", "ridden to its end; 0.07 m rms"], dtype=object),
        **{name: np.array([1.0, 2.0]) for name in ("length", "rms", "largest", "elapsed")},
    }
    log = replace(ride(states(201)), path_statuses=followed)
    lines = [" ".join(line.split()) for line in render(summarise(log)).splitlines()]
    assert "course slalom finished: ridden to its end; 0.07 m rms" in lines
    assert "path 10.0 m" in lines
    assert not [line for line in lines if line.startswith("goals")]


def test_a_state_that_is_missing_at_the_start_counts_where_its_answer_is_recorded() -> None:
    recorded = {name: column[2:] for name, column in states(50).items()}
    answered = commands(49)
    assert list(answered["step"][:3]) == [0, 1, 2]
    assert summarise(ride(recorded, given=answered)).loop.lost_steps == 2
    later = {name: column[2:] for name, column in answered.items()}
    assert summarise(ride(recorded, given=later)).loop.lost_steps == 0
