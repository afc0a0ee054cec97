"""N bicycles that ride with exploration noise and fill the memory."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np

from bicycle_common.observation import OBSERVATION_FIELDS
from bicycle_controller.agents.base import Chooser, Memory
from bicycle_controller.config.algorithms import DdpgConfig, LearnerConfig
from bicycle_controller.config.run import RunConfig
from bicycle_controller.control.exploration_noise import Noise
from bicycle_controller.control.past import Past
from bicycle_controller.data.replay_buffer import NStepAccumulator, RewardShaping
from bicycle_controller.policy.inputs import Inputs
from bicycle_controller.policy.policy import load_controller
from bicycle_controller.training.episode_log import EpisodeLog
from bicycle_controller.training.hardships import Hardships
from bicycle_controller.training.late_actions import LateActions
from bicycle_controller.training.mixed_plant import MixedPlant
from bicycle_controller.training.starts import restart, ride_on, training_scenario
from bicycle_sim.task.task import BicycleTask, Step

FAR = 20.0
"""Distance beyond which a critic sees all goals as equally far (m)."""


def driven(limits: np.ndarray) -> np.ndarray:
    """Return the indices of the actions that a policy chooses: those with a limit above zero."""
    return np.flatnonzero(limits > 0)


def observations(learner: LearnerConfig) -> int:
    """Return the numbers per observation in the memory: the actor's and the critic's extra."""
    return len(_inputs(learner)) + len(_extras(learner))


def _inputs(learner: LearnerConfig) -> tuple[str, ...]:
    return learner.inputs if isinstance(learner, DdpgConfig) else OBSERVATION_FIELDS


def _extras(learner: LearnerConfig) -> tuple[str, ...]:
    return learner.critic_sees if isinstance(learner, DdpgConfig) else ()


def teaches(learner: LearnerConfig) -> bool:
    """Return True if the memory stores a teacher's actions."""
    return isinstance(learner, DdpgConfig) and learner.bc_to == "teacher"


class Collector:
    """Bicycles, their noise and the pending transitions.

    Attributes:
        steps: environment steps made, summed over all bicycles.
        rounds: number of steps that all bicycles made.
    """

    def __init__(self, config: RunConfig, replay: Memory, device: str = "cpu") -> None:
        """Start all bicycles; three generators are spawned from the run's seed.

        Args:
            config: the run's configuration.
            replay: memory for the transitions.
            device: torch's name of the device on which the bicycles are stepped.
        """
        self.config, self.replay = config, replay
        seeds = np.random.SeedSequence(config.seed).spawn(3)
        task_rng, noise_rng, self.warm_rng = map(np.random.default_rng, seeds)
        scenario = training_scenario(config.scenario, config.starts)
        plant = config.physics if device == "cpu" else config.physics.on_device(device)
        if config.physics_too is not None:
            every_second = np.arange(config.bicycles) % 2 == 1
            plant = MixedPlant(config.physics, config.physics_too, every_second)
        self.task = BicycleTask(scenario, plant, config.bicycles, task_rng)
        self._hard = Hardships(config.bicycles, config.starts, task_rng)
        self._late = LateActions(config.bicycles, config.starts.delay, task_rng)
        self.limits = self.task.scenario.action_limits
        self.driven = driven(self.limits)
        self._spread = self.limits[self.driven]
        learner, actions = config.learner, len(self.driven)
        self.noise = Noise(config.noise, config.bicycles, actions, noise_rng)
        teacher, spread = config.teacher, np.arange(config.bicycles + 1) * config.teacher.share
        self.expert_rows = np.flatnonzero(np.diff(np.floor(spread)))
        self.teacher = (
            load_controller(teacher.controller, config.physics) if teacher.share else None
        )
        if getattr(self.teacher, "memory", 0) or getattr(self.teacher, "plant_parameters", ()):
            raise ValueError(
                f"teacher.controller {teacher.controller} remembers the past, which this training"
                " does not keep: choose another one"
            )
        self.absorbing = learner.fall == "absorbing"
        self.returns = NStepAccumulator(
            config.bicycles,
            actions,
            RewardShaping.of(learner),
            observations(learner),
            teaches(learner),
        )
        self.top_speed = (scenario.speed_limits or (0.0, scenario.start_speed))[1]
        self.steps = self.rounds = 0
        self.episode_return = np.zeros(config.bicycles)
        self.totals = {"episodes": 0.0, "return": 0.0, "goals": 0.0, "falls": 0.0}
        everyone = np.ones(config.bicycles, dtype=bool)
        self._late.reset(everyone, self._hard.has("delay"))
        restart(self.task, everyone, config.starts, self._hard.has("speeds"))
        self._inputs = Inputs(_inputs(learner))
        self._past = Past(config.bicycles, self._inputs.memory)
        self.observation = self._noisy(self.task.observation())
        self._past.fill(everyone, self.observation, self.task.state.speed)
        record = config.record
        self.log = EpisodeLog(record, self.task) if record.episodes else None

    def step(self, agent: Chooser) -> None:
        """Step every bicycle once and store the completed transitions."""
        expert_action = self._expert_action()
        action = self._chosen(agent, expert_action)
        physical = np.zeros((self.config.bicycles, 3))
        physical[:, self.driven] = action * self._spread
        before = self._seen(self.observation)
        self._remember(action)
        self._kick()
        step = self.task.step(self._late.arriving(physical))
        observation = self._noisy(step.observation)
        self.replay.add(
            self.returns.push(
                before,
                action,
                step.reward - self._spared(step),
                self._seen(observation),
                step.terminated,
                step.truncated,
                step.fallen,
                self._progress(step),
                expert_action if teaches(self.config.learner) else None,
            )
        )
        self.steps += self.config.bicycles
        self.rounds += 1
        self.observation = self._after(step, observation)

    def _actor_inputs(self) -> np.ndarray:
        """Return the actor's inputs (N, inputs); commands are shares of their limits."""
        return self._inputs.gather(self.observation, self.task.state.speed, self._past)

    def _remember(self, action: np.ndarray) -> None:
        """Add this period, with its normalised actions (N, actions), to the past."""
        if self._inputs.memory:
            sent = np.zeros((self.config.bicycles, 3))
            sent[:, self.driven] = action
            self._past.push(self.observation, self.task.state.speed, sent)

    def _seen(self, observation: np.ndarray) -> np.ndarray:
        """Return the actor's inputs for (N, 6) with the critic's extra inputs to their right."""
        extras = _extras(self.config.learner)
        shown = self._inputs.gather(observation, self.task.state.speed, self._past)
        if not extras:
            return shown
        plant = self.task.plant
        values = {
            "speed": self.task.state.speed,
            "goal_distance": np.minimum(self.task.goal_distance(), FAR),
            "delay": self._late.delays,
            "physics_too": plant.is_second
            if isinstance(plant, MixedPlant)
            else self._late.delays * 0,
        }
        return np.column_stack([shown, *(values[name] for name in extras)])

    def _noisy(self, observation: np.ndarray) -> np.ndarray:
        """Return the observation (N, 6) with each bicycle's noise."""
        if self.config.starts.noise == 0.0:
            return observation
        noise: np.ndarray = self.task.rng.normal(size=observation.shape)
        return observation + noise * self._hard.noise[:, None]

    def _spared(self, step: Step) -> np.ndarray | float:
        """Return the part of equation 20 that training omits, (N,)."""
        share = self.config.shaping.heading_share
        return 0.0 if share == 1.0 else (1.0 - share) * step.terms["heading_error"]

    def _progress(self, step: Step) -> np.ndarray | float:
        """Return the cost of missing progress, (N,), see `ShapingConfig`."""
        if self.config.shaping.progress == 0.0:
            return 0.0
        nearer = self.task.state.speed * np.cos(step.observation[:, 5])
        return self.config.shaping.progress * (nearer / self.top_speed - 1.0)

    def _kick(self) -> None:
        """Kick some of the bicycles, see `StartsConfig.kick`."""
        starts, rng = self.config.starts, self.task.rng
        if starts.kick == 0.0:
            return
        chance = self.task.plant.time_step / starts.kick_every
        kicked = (rng.random(self.config.bicycles) < chance) & self._hard.has("kick")
        if kicked.any():
            sizes = rng.uniform(-starts.kick, starts.kick, self.config.bicycles)
            self.task.state = self.task.plant.pushed(self.task.state, np.where(kicked, sizes, 0.0))

    def _expert_action(self) -> np.ndarray | None:
        """Return the teacher's actions for all bicycles, normalised, (N, actions)."""
        if self.teacher is None:
            return None
        action = self.teacher.act(self.observation, self.task.state.speed)
        return np.clip(action[:, self.driven] / self._spread, -1.0, 1.0)

    def _chosen(self, agent: Chooser, expert_action: np.ndarray | None) -> np.ndarray:
        """Return normalised actions (N, actions): random in the warm-up, else the noisy policy's.

        A bicycle that the teacher rides gets its action, with the same noise.
        """
        size = (self.config.bicycles, len(self.driven))
        if self.steps < self.config.warm_up:
            noise, action = np.zeros(size), self.warm_rng.uniform(-1.0, 1.0, size)
        else:
            noise = self.noise.sample()
            action = agent.act(self._actor_inputs()) + noise
        if expert_action is not None:
            action[self.expert_rows] = expert_action[self.expert_rows] + noise[self.expert_rows]
        return self._finite(np.minimum(np.maximum(action, -1.0), 1.0))

    def _finite(self, action: np.ndarray) -> np.ndarray:
        """Return the actions unchanged.

        Raises:
            RuntimeError: if one is not finite.
        """
        if not np.isfinite(action).all():
            raise RuntimeError(
                f"training has diverged after {self.steps} steps (the actor gives numbers that are"
                f" not finite): lower the learning rates or {self.config.algorithm}.reward_scale"
            )
        return action

    def _after(self, step: Step, observation: np.ndarray) -> np.ndarray:
        """Restart ended episodes; return the next observation (N, 6).

        Args:
            step: its result.
            observation: (N, 6) after it, as it is seen.
        """
        self.episode_return += step.reward
        ended = step.terminated | step.truncated | (step.fallen & self.absorbing)
        if self.log is not None:
            self.log.add(self.task, step, ended, self.steps)
        if not ended.any():
            return observation
        self.totals["episodes"] += float(ended.sum())
        self.totals["return"] += float(self.episode_return[ended].sum())
        self.totals["goals"] += float((ended & step.terminated).sum())
        self.totals["falls"] += float((ended & step.fallen).sum())
        self.episode_return[ended] = 0.0
        goes_on = np.zeros_like(ended)
        if self.config.starts.ride_on > 0:
            chosen = self.task.rng.random(len(ended)) < self.config.starts.ride_on
            goes_on = ended & ~step.fallen & chosen
        anew = ended & ~goes_on
        self._hard.draw(anew)
        restart(self.task, anew, self.config.starts, self._hard.has("speeds"))
        ride_on(self.task, goes_on, self.config.starts)
        self.noise.reset(ended)
        self._late.reset(anew, self._hard.has("delay"))
        if self.log is not None:
            self.log.begin(self.task, ended)
        begun = np.where(ended[:, None], self._noisy(self.task.observation()), observation)
        self._past.fill(anew, begun, self.task.state.speed)
        return begun

    def metrics(self) -> dict[str, float]:
        """Return episodes, mean return, goal and fall rate since the last call."""
        totals, episodes = self.totals, max(self.totals["episodes"], 1.0)
        self.totals = dict.fromkeys(totals, 0.0)
        return {
            "episodes": totals["episodes"],
            "return": totals["return"] / episodes,
            "goal_rate": totals["goals"] / episodes,
            "fall_rate": totals["falls"] / episodes,
        }

    def flush(self, folder: Path) -> None:
        """Write the ended episodes to the disk, if they are recorded."""
        if self.log is not None:
            self.log.flush(folder)

    def state_dict(self) -> dict[str, Any]:
        """Return bicycles, noise, generators, pending transitions and counters."""
        task = self.task
        arrays = ("steps", "fallen", "goal_x", "goal_y", "_frozen_reward")
        return {
            "state": dataclasses.asdict(task.snapshot()),
            "task": {name: getattr(task, name).copy() for name in arrays},
            "task_rng": task.rng.bit_generator.state,
            "warm_rng": self.warm_rng.bit_generator.state,
            "noise": self.noise.state_dict(),
            "late": self._late.state_dict(),
            "returns": self.returns.state_dict(),
            "observation": self.observation.copy(),
            "past": self._past.rows.copy(),
            "hardships": self._hard.state_dict(),
            "episode_return": self.episode_return.copy(),
            "counters": {"steps": self.steps, "rounds": self.rounds},
            "totals": dict(self.totals),
            "log": None if self.log is None else self.log.state_dict(),
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore `state`, to the bit."""
        self.task.state = self.task.plant.state_type(**state["state"])
        for name, value in state["task"].items():
            setattr(self.task, name, value)
        self.task.rng.bit_generator.state = state["task_rng"]
        self.warm_rng.bit_generator.state = state["warm_rng"]
        self.noise.load_state_dict(state["noise"])
        self._late.load_state_dict(state["late"])
        self.returns.load_state_dict(state["returns"])
        self.observation = state["observation"]
        if "past" in state:  # not in a checkpoint of before
            self._past.rows = state["past"]
            self._hard.load_state_dict(state["hardships"])
        self.episode_return = state["episode_return"]
        self.steps, self.rounds = state["counters"]["steps"], state["counters"]["rounds"]
        self.totals = dict(state["totals"])
        if self.log is not None and state.get("log") is not None:
            self.log.load_state_dict(state["log"])
