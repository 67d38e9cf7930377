"""`ros2 launch ogm_mcmc refine_server.launch.py [params_file:=...] [use_sim_time:=true]`."""

from pathlib import Path

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

SHARE = Path(__file__).resolve().parents[1]


def generate_launch_description() -> LaunchDescription:
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                'params_file',
                default_value=str(SHARE / 'config' / 'refine_server.yaml'),
                description='parameters of refine_server',
            ),
            DeclareLaunchArgument(
                'use_sim_time', default_value='false', description='follow /clock'
            ),
            Node(
                package='ogm_mcmc',
                executable='refine_server',
                output='screen',
                parameters=[
                    LaunchConfiguration('params_file'),
                    {'use_sim_time': LaunchConfiguration('use_sim_time')},
                ],
            ),
        ]
    )
