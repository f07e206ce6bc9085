"""A stand-in for rclpy: a user's ROS 2 nodes in one process, on simulated time."""
