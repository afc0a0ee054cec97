"""The ROS 2 side of the controllers; the only place in this package that imports rclpy."""
