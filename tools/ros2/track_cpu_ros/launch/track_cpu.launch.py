"""Starts the node: ros2 launch track_cpu_ros track_cpu.launch.py image:=/camera/image_raw"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node


def generate_launch_description():
    defaults = {"image": "/camera/image_raw", "model": "drmim-p50", "threads": "1"}
    arguments = [
        DeclareLaunchArgument(name, default_value=value) for name, value in defaults.items()
    ]
    node = Node(
        package="track_cpu_ros",
        executable="track_cpu",
        remappings=[("image", LaunchConfiguration("image"))],
        parameters=[{name: LaunchConfiguration(name) for name in ("model", "threads")}],
    )
    return LaunchDescription([*arguments, node])
