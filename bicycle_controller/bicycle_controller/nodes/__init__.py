"""ROS 2 side of the controllers; the only folder of this package that imports rclpy."""
