"""The ROS 2 nodes: parameters, wiring and conversion; the only room that imports rclpy."""
