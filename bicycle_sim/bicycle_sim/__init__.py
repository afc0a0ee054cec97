"""A simulated bicycle: plants, tasks, an environment for learning, and a ROS 2 node.

`gymnasium.make("bicycle_sim:BicycleGoal-v0")` imports this package to find its environments. It
may be imported before Gymnasium or after it.
"""

from bicycle_sim.task.registration_hook import register_with_gymnasium

__version__ = "0.1.0"

register_with_gymnasium()
