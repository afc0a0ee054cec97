"""Main loop of the learning process: update, evaluate, offer, save."""

from __future__ import annotations

import contextlib
import multiprocessing
import queue
import threading
import time
from dataclasses import replace
from typing import Any

import numpy as np
from tqdm import tqdm

from bicycle_common.signals import InterruptError, StopRequest
from bicycle_controller.config import loading
from bicycle_controller.config.run import RunConfig
from bicycle_controller.data import dataset
from bicycle_controller.data.packing import unpacked
from bicycle_controller.data.replay_buffer import NStepAccumulator, ReplayBuffer, RewardShaping
from bicycle_controller.data.replay_log import ReplayLog
from bicycle_controller.evaluation.score import Score, score
from bicycle_controller.policy.policy import Policy, load_controller, load_policy, save_policy
from bicycle_controller.policy.trained_for import differences
from bicycle_controller.trainer_service.order import TrainingOrder
from bicycle_controller.training import offline
from bicycle_controller.training.learner import CHUNK, Learner, ddpg_of
from bicycle_controller.training.logger import Logger
from bicycle_controller.training.run_folder import RunFolder
from bicycle_sim.plants.base import Plant

TELL = 0.5
"""Period of reports (s)."""
NAP = 0.02
"""Sleep while there is nothing to do (s)."""
MEMORY = "memory.f32"
"""Rows of the replay memory in order of arrival, float32, in the checkpoint's folder."""


def work(order: TrainingOrder, inbox: Any, outbox: Any) -> None:
    """Learn until SIGTERM, or until the parent has ended."""
    tqdm.set_lock(threading.RLock())  # the default lock spans processes and needs a clean-up
    with contextlib.suppress(BrokenPipeError):
        try:
            Worker(order, inbox, outbox).run()
        except (ValueError, RuntimeError, OSError) as error:
            outbox.send({"error": " ".join(str(error).split())})


class Worker:
    """A learner, its data, and the policy that its candidates must beat."""

    def __init__(self, order: TrainingOrder, inbox: Any, outbox: Any) -> None:
        self._order, self._inbox, self._outbox = order, inbox, outbox
        self._learner: Learner
        self._returns: NStepAccumulator
        self._file: ReplayLog
        self._to_beat = ""
        self._baseline: Score | None = None
        self._best: Policy | None = None
        self._last: Score | None = None
        self._offers: dict[str, Score] = {}
        self._final = False
        self._told = 0.0

    def run(self) -> None:
        """Work until told to end, then save."""
        parent = multiprocessing.parent_process()
        with StopRequest() as interrupt:
            self._say(phase="loading")
            try:
                with interrupt.at_once():
                    self._open()
            except InterruptError:
                return
            learner = self._learner
            log = Logger(learner.files.path, learner.log_bytes, learner.updates, False)
            saved = time.monotonic()
            with log:
                while not interrupt.signal and (parent is None or parent.is_alive()):
                    self._receive()
                    self._turn(log, interrupt)
                    self._tell()
                    if time.monotonic() - saved >= learner.config.save_every:
                        self._save(log)
                        saved = time.monotonic()
                self._save(log)

    def _open(self) -> None:
        """Create the learner, or restore that of the folder.

        Raises:
            ValueError: on unsuitable bags, configuration or folder.
        """
        order = self._order
        if order.live:
            self._open_live()
        elif order.resume:
            self._learner = offline.reopen(order.folder)
        else:
            data = self._data()
            self._learner = offline.begin(self._config(), data, order.folder)
        if self._learner.best is not None:
            self._best = load_policy(self._learner.files.best)

    def _config(self) -> RunConfig:
        order = self._order
        config = loading.preset(order.preset, order.overrides)
        if order.scenario is not None and order.plant is not None:
            config = replace(config, scenario=order.scenario, physics=order.plant)
        return config

    def _data(self) -> dataset.Dataset:
        """Read the bags and check them."""
        data = dataset.load(self._order.bags, self._order.scenario)
        if self._order.plant is not None:
            self._same(f"the ride in {self._order.bags[0]}", data.plant)
        for warning in dataset.check(data):
            self._say(note=warning)
        return data

    def _same(self, what: str, plant: Plant[Any]) -> None:
        """Refuse what belongs to another bicycle than the live one.

        Raises:
            ValueError: It does.
        """
        assert self._order.plant is not None
        found = differences(plant, self._order.plant)
        if found:
            raise ValueError(
                f"{what} is of another bicycle than the simulator's ({'; '.join(found)}): start "
                "the simulator with that one, or learn anew in another folder"
            )

    def _open_live(self) -> None:
        order, files = self._order, RunFolder(self._order.folder)
        config = files.resumed_config([]) if order.resume else self._config()
        ddpg = ddpg_of(config)
        if ddpg.fall != "absorbing":
            raise ValueError("no steps come of a fallen bicycle: set ddpg.fall=absorbing")
        if not order.resume:
            files.create(config)
        elif order.plant is not None:
            self._same(f"the run in {order.folder}", config.physics)
        actions = int((config.scenario.action_limits > 0).sum())
        memory = ReplayBuffer(ddpg.capacity, actions)
        path = files.checkpoint.parent / MEMORY
        self._file = ReplayLog(path, sum(memory.columns))
        self._learner = Learner(config, files, memory)
        self._returns = NStepAccumulator(1, actions, RewardShaping.of(ddpg))
        if order.resume and files.checkpoint.exists():
            extra = self._learner.load(files.checkpoint)
            self._returns.load_state_dict(extra["returns"])
            self._fill(self._file.load(int(extra["rows"])))
        elif order.bags:
            self._keep(dataset.memory_rows(self._data(), ddpg))

    def _receive(self) -> None:
        """Read all that has arrived."""
        while True:
            try:
                kind, value = self._inbox.get_nowait()
            except queue.Empty:
                return
            if kind == "rows":
                self._take(value)
            elif kind == "baseline":
                self._to_beat = value
            elif kind == "in charge" and value in self._offers:
                self._baseline = self._offers[value]

    def _take(self, rows: np.ndarray) -> None:
        """Put packed transitions into the memory."""
        scenario = self._learner.config.scenario
        driven = np.flatnonzero(scenario.action_limits > 0)
        observation, action, reward, following, *flags = unpacked(rows)
        chosen = np.clip(action[:, driven] / scenario.action_limits[driven], -1.0, 1.0)
        columns = (observation, chosen, reward, following, *flags)
        for index in range(len(rows)):
            one = slice(index, index + 1)
            self._keep(self._returns.push(*(column[one] for column in columns)))

    def _keep(self, rows: np.ndarray) -> None:
        """Put new rows into the memory and its file."""
        self._fill(rows)
        self._file.add(rows)

    def _fill(self, rows: np.ndarray) -> None:
        """Put rows into the memory; keep the last ones if they exceed its capacity."""
        memory = self._learner.replay
        for first in range(0, len(rows), memory.capacity):
            memory.add(rows[first : first + memory.capacity])

    def _turn(self, log: Logger, interrupt: StopRequest) -> None:
        """Do one thing: score the baseline, evaluate a candidate, make some updates, or sleep."""
        learner = self._learner
        try:
            if self._to_beat:
                with interrupt.at_once():
                    self._score_baseline()
            elif learner.evaluation_due:
                self._say(phase="evaluating")
                with interrupt.at_once():
                    self._try_candidate(log)
            elif self._may_update():
                learner.advance(log, CHUNK, self._progress())
                self._final = False
            elif not self._order.live and not self._final:
                learner.evaluation_due = self._final = True
            else:
                time.sleep(NAP)
        except InterruptError:
            pass

    def _may_update(self) -> bool:
        learner, order = self._learner, self._order
        if not order.live:
            return learner.updates < learner.config.offline_updates
        if learner.replay.size < order.warm_up:
            return False
        return learner.updates < order.updates_per_step * self._file.rows

    def _progress(self) -> float:
        """Return the finished share of the run; a live run has no end."""
        done = self._learner.updates / self._learner.config.offline_updates
        return 0.0 if self._order.live else done

    def _try_candidate(self, log: Logger) -> None:
        candidate = self._learner.evaluate(log)
        self._last = candidate.score
        if candidate.overestimates:
            self._say(note="candidate refused: the mean Q of its actions is above 0")
        if candidate.kept:
            self._best = candidate.policy
            self._offer()

    def _score_baseline(self) -> None:
        """Evaluate the active policy as candidates are evaluated."""
        name, self._to_beat = self._to_beat, ""
        config = self._learner.config
        try:
            controller = load_controller(name, config.physics)
        except ValueError as error:
            self._say(
                note=f"the policy in charge cannot be scored, so none is handed over: {error}"
            )
            return
        self._baseline = score(controller, config.scenario, config.physics, config.evaluation)
        found = f"{self._baseline.reach_rate:.1%} reached, {self._baseline.fall_rate:.1%} fell"
        self._say(note=f"{controller.policy_id} is to be beaten: {found}")
        self._say(in_charge=controller.policy_id)
        self._offer()

    def _offer(self) -> None:
        """Offer the best policy if it beats the active one."""
        best, found = self._best, self._learner.best
        if (
            best is None
            or found is None
            or self._baseline is None
            or found.rank <= self._baseline.rank
        ):
            return
        path = self._learner.files.path / "policies" / f"{best.policy_id}.safetensors"
        save_policy(best, path)
        self._offers[best.policy_id] = found
        self._say(offer=str(path.resolve()), policy=best.policy_id)

    def _say(self, **values: Any) -> None:
        self._outbox.send(values)

    def _tell(self) -> None:
        """Report the progress, twice a second."""
        if time.monotonic() - self._told < TELL:
            return
        self._told = time.monotonic()
        learner = self._learner
        phase = "learning"
        if self._order.live and learner.replay.size < self._order.warm_up:
            phase = "waiting"
        elif not self._order.live and self._final and not learner.evaluation_due:
            phase = "finished"
        self._say(
            phase=phase,
            updates=learner.updates,
            transitions=learner.replay.size,
            q_policy=learner.q_policy,
            last=self._last,
            best=learner.best,
            path=str(learner.files.best.resolve()) if self._best is not None else "",
        )

    def _save(self, log: Logger) -> None:
        """Write the checkpoint; of the memory only the rows since the last one."""
        extra: dict[str, Any] = {}
        if self._order.live:
            self._file.save()
            extra = {"rows": self._file.saved, "returns": self._returns.state_dict()}
        self._learner.save(log, extra=extra)
