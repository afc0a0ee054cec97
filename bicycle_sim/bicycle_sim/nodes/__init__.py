"""ROS 2 side of the simulator; the only folder of this package that imports rclpy."""
