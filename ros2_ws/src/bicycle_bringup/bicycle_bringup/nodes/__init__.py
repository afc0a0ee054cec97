"""ROS 2 side of the ride; the only folder of this package that imports rclpy."""
