"""N bicycles that ride by PPO's own random policy."""

from __future__ import annotations

import numpy as np

from bicycle_controller.agents.base import Chooser
from bicycle_controller.agents.ppo import Ppo
from bicycle_controller.training.collector import Collector


class RolloutCollector(Collector):
    """Collector without its own noise.

    It stores the action as drawn, which the probability ratio needs; the task clips it to the
    limits when it is applied.
    """

    def _chosen(self, agent: Chooser, expert_action: np.ndarray | None) -> np.ndarray:
        """Return normalised actions (N, actions), drawn and not clipped."""
        assert isinstance(agent, Ppo)
        return self._finite(agent.sample(self.observation))
