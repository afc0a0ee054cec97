"""A simulated bicycle after Choi, Le et al. (2019): dynamics, reward, task and ROS 2 node."""

__version__ = "0.1.0"
