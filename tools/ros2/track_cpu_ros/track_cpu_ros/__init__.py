"""A ROS 2 node over the Python package track-cpu."""
