"""ROS 2 side of the hardware; the only folder of this package that imports rclpy."""
