"""Estimates and commands of a ride from sensors, made again from its bag."""

from __future__ import annotations

import copy
import re
from collections import deque
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from domains import claimed_domain
from node_process import NodeProcess

from bicycle_bag.errors import BagError
from bicycle_bag.versions import TodaysReader
from bicycle_controller.estimation.settings import ESTIMATOR
from bicycle_tools.nodes.sensed_recording import Sensed, read
from bicycle_tools.nodes.verify import verdicts_of
from bicycle_tools.nodes.verify_estimates import EstimateVerdict, verify

pytestmark = [pytest.mark.ros, pytest.mark.slow]

ROOT = Path(__file__).resolve().parents[2]
RIDE = ROOT / "ros2_ws" / "ride.sh"
FIRST = ROOT / "tests" / "data" / "estimated-1"
WORDS = (
    *("--goals", "1", "--field", "40", "--seed", "1", "simulator.pace:=lockstep"),
    *("simulator.plant:=whipple", "simulator.bicycle:=browser-rider"),
    *("simulator.sensors:=mpu6050", "controller.state:=estimated"),
    *("controller.sensors:=mpu6050", "controller.policy:=any-bicycle"),
)


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Yield the bag of one ride."""
    folder = tmp_path_factory.mktemp("ride") / "run"
    words = [str(RIDE), *WORDS, "--output", str(folder)]
    with claimed_domain() as domain, NodeProcess(words, {"ROS_DOMAIN_ID": str(domain)}) as ride:
        assert ride.wait() == 0, ride.output
        yield folder / "bag"


@pytest.fixture(scope="module")
def sensed(bag: Path) -> Sensed:
    return read(TodaysReader(bag))


def last(sensed: Sensed) -> EstimateVerdict:
    return deque(verify(sensed), maxlen=1).pop()


def test_estimates_commands_and_states_come_out_again(bag: Path) -> None:
    states, estimates = verdicts_of(bag)
    assert states.same, str(states)
    assert isinstance(estimates, EstimateVerdict)
    assert estimates.same, str(estimates)
    assert estimates.estimates > 200
    assert estimates.commands > 200
    assert estimates.guided == estimates.unknown == 0


def test_a_changed_reading_is_found(sensed: Sensed) -> None:
    changed = copy.copy(sensed)
    changed.imu = copy.deepcopy(sensed.imu)
    changed.imu[len(changed.imu) // 2].angular_velocity.x += 1e-12
    verdict = last(changed)
    assert verdict.difference.startswith("estimate of step")
    assert not verdict.same


def test_a_changed_command_is_found(sensed: Sensed) -> None:
    changed = copy.copy(sensed)
    changed.commands = copy.deepcopy(sensed.commands)
    (key,) = [key for key in changed.commands if key[1] == 100]
    for one in changed.commands[key]:
        one.torque += 1e-12
    assert last(changed).difference.startswith("command of step 100 of episode")


def test_a_bag_without_the_controller_s_setup_is_refused(sensed: Sensed) -> None:
    changed = copy.copy(sensed)
    changed.setups = []
    with pytest.raises(BagError, match="bicycle/controller_setup"):
        last(changed)


def test_a_bag_of_the_first_estimator_comes_out_again_but_for_rounding() -> None:
    """It rounded as numpy's libraries do on a machine, and knew no wind."""
    sensed = read(TodaysReader(FIRST))
    assert [setup.estimator for _, setup in sensed.setups] == [1]
    verdict = last(sensed)
    assert verdict.same, verdict
    assert verdict.estimates > 100
    assert verdict.commands == 81
    assert 0 < verdict.rounded < verdict.estimates
    assert 0.0 < verdict.largest < 1e-12
    # Another processor computes other last digits of an LQR's gains.
    assert verdict.rounded_commands < verdict.commands
    assert "as the first estimator rounded" in str(verdict)


def test_a_changed_reading_of_such_a_bag_is_found() -> None:
    sensed = read(TodaysReader(FIRST))
    sensed.imu[-40].angular_velocity.x += 1e-6
    assert last(sensed).difference.startswith("estimate of step")


def test_a_changed_command_of_such_a_bag_is_found() -> None:
    sensed = read(TodaysReader(FIRST))
    (key,) = [key for key in sensed.commands if key[1] == 40]
    sensed.commands[key][0].torque += 1e-6
    assert last(sensed).difference.startswith("command of step 40")


def test_todays_estimator_may_not_round(sensed: Sensed) -> None:
    assert {setup.estimator for _, setup in sensed.setups} == {ESTIMATOR}
    changed = copy.copy(sensed)
    changed.estimates = copy.deepcopy(sensed.estimates)
    changed.estimates[50][1].lean_angle += 1e-15
    assert last(changed).difference.startswith("estimate of step")


def test_an_estimator_of_the_future_is_refused_in_one_line() -> None:
    sensed = read(TodaysReader(FIRST))
    sensed.setups = [(place, replace(setup, estimator=99)) for place, setup in sensed.setups]
    with pytest.raises(BagError, match="estimator 99 is not known here: update the software"):
        last(sensed)


def test_a_bag_that_lacks_a_reading_is_told_so(sensed: Sensed) -> None:
    """A recorder that came late, or lost one: that is no difference."""
    for lacking in (0, 20):
        changed = copy.copy(sensed)
        changed.imu = [one for n, one in enumerate(sensed.imu) if n != lacking]
        verdict = last(changed)
        assert not verdict.difference, verdict
        assert not verdict.same
        assert verdict.unproved == len(sensed.estimates)
        assert str(verdict).startswith("not proved, none of")
        assert re.search(r"the bag lacks 1 of \d+ readings of imu before step 0", str(verdict))


def test_it_proves_what_was_before_a_lost_reading(sensed: Sensed) -> None:
    changed = copy.copy(sensed)
    middle = len(sensed.encoders) - 100
    changed.encoders = [one for n, one in enumerate(sensed.encoders) if n != middle]
    verdict = last(changed)
    assert not verdict.difference, verdict
    assert not verdict.same
    assert verdict.estimates > 100
    assert 0 < verdict.unproved < 60
    assert verdict.estimates + verdict.unproved == len(sensed.estimates)
    assert re.search(r"not proved: the bag lacks 1 of \d+ readings of (steer|wheel)", str(verdict))


def test_a_bag_that_lacks_the_first_estimates_is_told_so(sensed: Sensed) -> None:
    changed = copy.copy(sensed)
    changed.estimates = sensed.estimates[30:]
    verdict = last(changed)
    assert not verdict.difference, verdict
    assert not verdict.same
    assert "the bag lacks 30 estimates before step" in str(verdict)


def test_a_reading_that_the_estimator_did_not_receive_is_told(sensed: Sensed) -> None:
    """Before its first estimate it may have come late, and uses what is left; later it may not."""
    changed = copy.copy(sensed)
    extra = copy.deepcopy(sensed.imu[0])
    extra.header.stamp.nanosec -= 1_000_000
    changed.imu = [extra, *sensed.imu]
    assert last(changed).same
    changed.imu = copy.copy(sensed.imu)
    middle = len(sensed.imu) - 100
    extra = copy.deepcopy(sensed.imu[middle])
    extra.header.stamp.nanosec -= 1_000_000
    changed.imu.insert(middle, extra)
    verdict = last(changed)
    assert not verdict.difference, verdict
    assert not verdict.same
    assert re.search(r"the estimator had not received 1 of \d+ readings of imu", str(verdict))


def test_readings_in_another_order_of_the_topics_are_the_same(sensed: Sensed) -> None:
    """A reading that a newer one has overtaken was not used, here or there."""
    changed = copy.copy(sensed)
    changed.imu = copy.copy(sensed.imu)
    middle = len(sensed.imu) - 100
    extra = copy.deepcopy(sensed.imu[middle])
    extra.header.stamp.nanosec -= 1_000_000
    changed.imu.insert(middle + 1, extra)
    assert last(changed).same


def test_settings_that_change_while_it_rides_do_not_end_the_proof(sensed: Sensed) -> None:
    changed = copy.copy(sensed)
    ((place, setup),) = sensed.setups
    middle = sensed.estimates[100][0]
    settings = replace(setup.settings, goal_timeout=setup.settings.goal_timeout + 1.0)
    changed.setups = [(place, setup), (middle, replace(setup, settings=settings))]
    verdict = last(changed)
    assert verdict.same, verdict
    assert verdict.estimates == len(sensed.estimates)


def test_an_estimate_without_its_readings_is_refused_in_one_line(sensed: Sensed) -> None:
    changed = copy.copy(sensed)
    changed.estimates = copy.deepcopy(sensed.estimates)
    changed.estimates[0][1].plant_state = []
    with pytest.raises(BagError, match="estimate of step 0 of episode 1: 0 numbers"):
        last(changed)


@pytest.mark.parametrize("back", [0, 300])
def test_readings_before_a_clock_was_set_back_are_not_mixed_in(sensed: Sensed, back: int) -> None:
    """A driver learns a board's time, or a simulator is started anew: other stamps came before."""
    changed = copy.copy(sensed)
    earlier = [*copy.deepcopy(sensed.imu[:200]), copy.deepcopy(sensed.imu[0])]
    for message in earlier[:-1]:
        message.header.stamp.nanosec = (message.header.stamp.nanosec + 3_000_000) % 10**9
    earlier[-1].header.stamp.sec += back
    changed.imu = [*earlier, *sensed.imu]
    verdict = last(changed)
    assert verdict.same, verdict
    assert verdict.estimates == len(sensed.estimates)


def test_a_bag_of_two_simulators_is_proved(sensed: Sensed) -> None:
    """The second's clock begins where the first's did, and so do its episodes and steps."""
    twice = copy.copy(sensed)
    shift = 10**6
    twice.imu = sensed.imu * 2
    twice.encoders = sensed.encoders * 2
    twice.estimates = [*sensed.estimates, *((shift + at, one) for at, one in sensed.estimates)]
    verdict = last(twice)
    assert verdict.same, verdict
    assert verdict.estimates == 2 * len(sensed.estimates)
