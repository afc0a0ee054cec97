"""The ROS side of the cockpit."""
