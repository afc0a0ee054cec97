"""Controllers of the simulated bicycle: trained policies, LQR, training and ROS 2 nodes."""

__version__ = "0.1.0"
