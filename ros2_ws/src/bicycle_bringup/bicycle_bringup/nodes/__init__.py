"""The ROS 2 side of the ride; the only place in this package that imports rclpy."""
