"""`ros2 launch ogm_mcmc online_mapper.launch.py [params_file:=...] [use_sim_time:=true]`."""

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
                default_value=str(SHARE / 'config' / 'online_mapper.yaml'),
                description='parameters of online_mapper',
            ),
            DeclareLaunchArgument(
                'use_sim_time', default_value='false', description='follow /clock'
            ),
            Node(
                package='ogm_mcmc',
                executable='online_mapper',
                output='screen',
                parameters=[
                    LaunchConfiguration('params_file'),
                    {'use_sim_time': LaunchConfiguration('use_sim_time')},
                ],
            ),
        ]
    )
