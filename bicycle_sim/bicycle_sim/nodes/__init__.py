"""The ROS 2 side of the simulator; the only place in this package that imports rclpy."""
