"""A controller of one's own inside the controller node, which brings goals and the safety layer.

PYTHONPATH=ros2_ws/src/examples:$PYTHONPATH ros2_ws/ride.sh controller.policy:=own_policy:Steer
"""

import numpy as np

GAINS = np.array([-9.0, -1.3, 26.0, 14.4, 0.0, 2.6])
"""N m for theta, theta dot, omega, omega dot, omega dot dot and psi_g, in the paper's signs."""


class Steer:
    """Called without arguments; has `policy_id` and `act`."""

    policy_id = "pd@1"

    def act(self, observation: np.ndarray, speed: np.ndarray) -> np.ndarray:
        """Return T (N m), d (m) and F (N), (N, 3), for (N, 6) observations and (N,) m/s."""
        seen = observation.copy()
        seen[:, 5] = np.clip(seen[:, 5], -0.4, 0.4)
        action = np.zeros((len(seen), 3))
        action[:, 0] = np.clip(seen @ GAINS, -2.0, 2.0)
        return action
