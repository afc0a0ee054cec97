"""A simulated bicycle: plants, tasks, an environment for learning, and a ROS 2 node.

`gymnasium.make("bicycle_sim:BicycleGoal-v0")` imports this package to find its environments. A
program that imports this package first gets them with `import bicycle_sim.task.gym_env`.
"""

import sys

__version__ = "0.1.0"

if "gymnasium" in sys.modules:  # load Gymnasium environments only for programs that use Gymnasium
    from bicycle_sim.task import registration

    registration.register()
