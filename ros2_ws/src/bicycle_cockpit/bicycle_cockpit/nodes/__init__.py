"""ROS side of the cockpit."""
