"""The trainer as a process, with the simulator and the controller that it learns from."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from bicycle_msgs.msg import TrainerStatus
from node_process import NodeProcess, parameters
from probe import Probe, goal
from waiting import PATIENCE

from bicycle_common.nodes.topics import GOAL_POSE, STATE, TRAINER
from bicycle_controller.policy.policy import Policy, PolicyInfo, load_policy, save_policy
from bicycle_sim.plants.choi.plant import ChoiPlant
from bicycle_sim.task.scenario import SCENARIOS

pytestmark = [pytest.mark.ros, pytest.mark.slow]

TRAINER_NODE = "bicycle_controller.nodes.trainer_node"
CONTROLLER_NODE = "bicycle_controller.nodes.controller_node"
SIM_NODE = "bicycle_sim.nodes.sim_node"
SMALL = (
    "ddpg.actor_hidden=[32,32] ddpg.critic_hidden=[32,32] ddpg.batch=64 log_every=20"
    " evaluation.every=100 evaluation.episodes=8 evaluation.near_episodes=0"
    " evaluation.max_steps=60 save_every=0.5"
)
StartNode = Callable[..., NodeProcess]


@pytest.fixture
def probe(ros_domain: int) -> Iterator[Probe]:
    result = Probe(ros_domain, TRAINER, STATE)
    yield result
    result.close()


def falling_policy(path: Path) -> Path:
    """Steers left with all it has, so that it falls at once."""
    tensors = {
        "layer.0.weight": np.zeros((2, 6), dtype=np.float32),
        "layer.0.bias": np.array([5.0, 5.0], dtype=np.float32),
    }
    scenario = SCENARIOS["random-start-random-goal"]
    info = PolicyInfo("falls", scenario, ChoiPlant(), (1.0,) * 6, (2.0, 0.2, 0.0), {})
    save_policy(Policy(info, tensors), path)
    return path


def newest(probe: Probe) -> TrainerStatus | None:
    return probe[TRAINER][-1] if probe[TRAINER] else None


def wait_for(
    probe: Probe, condition: Callable[[TrainerStatus], bool], patience: float = PATIENCE
) -> TrainerStatus:
    def found() -> TrainerStatus | None:
        status = newest(probe)
        return status if status is not None and condition(status) else None

    return probe.spin_until(found, patience)


def test_it_learns_from_a_bag_and_hands_over_what_beats_the_policy_in_charge(
    start_node: StartNode, probe: Probe, tmp_path: Path
) -> None:
    from ride_bag_maker import Rider, write_bag

    bag = write_bag(tmp_path / "bag", Rider(sigma=0.1, seed=3).ride(5200))
    start = falling_policy(tmp_path / "falls.safetensors")
    controller = start_node(CONTROLLER_NODE, parameters(policy=start))
    controller.wait_for_line("waits for a goal")
    # Hardly more than imitation, which is enough to stay upright for the 60 steps of a trial.
    trainer = start_node(
        TRAINER_NODE,
        parameters(
            mode="bags",
            bags=bag,
            out=tmp_path / "run",
            overrides=f"{SMALL} ddpg.bc_weight=1000 offline_updates=1500",
        ),
    )
    trainer.wait_for_line("falls@[0-9a-f]{10} is to be beaten: 0.0% reached, 100.0% fell")
    trainer.wait_for_line("handed over: offline-.* is in charge")
    loaded = controller.wait_for_line(r"(offline-\S+@[0-9a-f]{10}) is in charge").group(1)
    policy = load_policy(tmp_path / "run" / "policies" / f"{loaded}.safetensors")
    assert policy.policy_id == loaded
    status = wait_for(probe, lambda message: message.in_charge.startswith("offline-"))
    assert status.mode == "bags"
    assert 5000 <= status.transitions <= 5200
    assert status.best_fall_rate < 1.0
    assert status.mean_q < 0
    assert Path(status.best_policy) == tmp_path / "run" / "best.safetensors"
    assert trainer.stop(signal.SIGINT) == 0
    assert (tmp_path / "run" / "checkpoint" / "state.pt").exists()


def test_it_learns_live_saves_on_sigterm_and_goes_on(
    start_node: StartNode, probe: Probe, tmp_path: Path
) -> None:
    start_node(SIM_NODE).wait_for_line("waits")
    explore = parameters(policy="lqr", exploration="ou", exploration_sigma=0.05)
    start_node(CONTROLLER_NODE, explore).wait_for_line("waits for a goal")
    options = {"out": tmp_path / "run", "warm_up": 100, "overrides": SMALL}
    trainer = start_node(TRAINER_NODE, parameters(**options))
    trainer.wait_for_line("learns live in")
    probe.say(GOAL_POSE, goal(5000.0, 0.0))
    status = wait_for(probe, lambda m: m.updates >= 200 and m.best_policy != "")
    assert status.mode == "live"
    assert status.transitions >= 100
    assert status.lost_transitions == 0
    assert status.updates <= 4 * status.transitions + 10
    assert np.isfinite([status.reach_rate, status.fall_rate, status.mean_return]).all()
    assert load_policy(status.best_policy).info.trained["data"] == "recorded rides"
    assert trainer.stop(signal.SIGTERM) == 0

    probe[TRAINER].clear()
    again = start_node(TRAINER_NODE, parameters(**options, resume=True))
    after = wait_for(probe, lambda m: m.updates > 0)
    assert after.updates >= status.updates
    assert after.transitions >= status.transitions
    assert again.stop(signal.SIGINT) == 0


def test_it_learns_nothing_of_another_bicycle(
    start_node: StartNode, probe: Probe, tmp_path: Path
) -> None:
    """A policy learned on the second bicycle would claim the first one."""
    first = start_node(SIM_NODE, parameters(seed=7))
    first.wait_for_line("waits")
    controller = parameters(policy="lqr", exploration="ou", exploration_sigma=0.05)
    start_node(CONTROLLER_NODE, controller).wait_for_line("waits for a goal")
    options = {"out": tmp_path / "run", "warm_up": 100_000, "overrides": SMALL}
    trainer = start_node(TRAINER_NODE, parameters(**options))
    trainer.wait_for_line("learns live in")
    probe.say(GOAL_POSE, goal(5000.0, 0.0))
    wait_for(probe, lambda message: message.transitions >= 40)
    assert first.stop() == 0
    # The same bicycle again, whose episode info is the same to the last field.
    first = start_node(SIM_NODE, parameters(seed=7))
    first.wait_for_line("waits")
    before = probe[TRAINER][-1].transitions
    probe.say(GOAL_POSE, goal(5000.0, 0.0))
    wait_for(probe, lambda message: message.transitions >= before + 100)
    assert first.stop() == 0
    other = start_node(SIM_NODE, parameters(physics="corrected"))
    trainer.wait_for_line("has another ride now .*chord_follows_steering true, not false")
    probe[STATE].clear()
    probe.say(GOAL_POSE, goal(5000.0, 0.0))
    # Old states may still be on their way, and the learning process behind what it was fed.
    probe.spin_until(lambda: any(one.step == 1 for one in probe[STATE]))
    probe[TRAINER].clear()

    def counts() -> list[int]:
        return [one.transitions for one in probe[TRAINER]][-3:]

    probe.spin_until(lambda: len(counts()) == 3 and len(set(counts())) == 1)
    learned = counts()[0]
    probe[STATE].clear()
    probe.spin_until(lambda: len(probe[STATE]) > 200)
    probe[TRAINER].clear()
    probe.spin_until(lambda: len(counts()) == 3)
    assert set(counts()) == {learned}
    assert trainer.stop(signal.SIGTERM) == 0

    again = start_node(TRAINER_NODE, parameters(**options, resume=True))
    assert again.wait() == 2
    assert "is of another bicycle than the simulator's (chord_follows" in again.lines[-1]
    assert other.stop() == 0


@pytest.mark.parametrize(
    ("values", "line"),
    [
        ({"mode": "bags"}, "mode:=bags needs bags:=PATH"),
        ({"mode": "bags", "bags": "nowhere"}, "there is no bag nowhere"),
        ({"mode": "both"}, "choose one of live, bags"),
        ({"presett": "offline"}, "unknown parameter 'presett'"),
        ({"resume": True}, "out:=FOLDER"),
    ],
)
def test_a_mistake_is_one_line_and_status_2(
    start_node: StartNode, values: dict[str, object], line: str
) -> None:
    trainer = start_node(TRAINER_NODE, parameters(**values))
    assert trainer.wait() == 2
    assert line in trainer.lines[-1]
    assert "Traceback" not in trainer.output


def test_without_torch_it_names_the_remedy(start_node: StartNode, tmp_path: Path) -> None:
    (tmp_path / "sitecustomize.py").write_text("import sys\nsys.modules['torch'] = None\n")
    path = [str(tmp_path), *sys.path]
    env = {"PYTHONPATH": ":".join(entry for entry in path if entry)}
    trainer = start_node(TRAINER_NODE, [], env)
    assert trainer.wait() == 2
    assert trainer.lines == [
        "bicycle_trainer: learning needs torch: run 'ros2_ws/setup.sh --with train'"
    ]
