"""`ros2 launch ogm_mcmc refine_server.launch.py [params_file:=...] [use_sim_time:=true]`."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare


def generate_launch_description() -> LaunchDescription:
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                'params_file',
                # Through the ament index: a symlink install leaves this file in the source tree.
                default_value=PathJoinSubstitution(
                    [FindPackageShare('ogm_mcmc'), 'config', 'refine_server.yaml']
                ),
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
