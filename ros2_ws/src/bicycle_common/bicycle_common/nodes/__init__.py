"""ROS side that all nodes share: topics, conversions, parameters, start and stop."""
