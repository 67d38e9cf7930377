"""refine_server beside a SLAM system: its poses from tf, what it corrects from `trajectory`."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

# Through the ament index: a symlink install leaves this file in the source tree.
PARAMETERS = PathJoinSubstitution([FindPackageShare('ogm_mcmc'), 'config', 'refine_server.yaml'])

ARGUMENTS = (
    ('namespace', '', 'namespace of the node and its topics'),
    ('params_file', PARAMETERS, 'parameters of refine_server'),
    ('use_sim_time', 'false', 'follow /clock'),
    ('log_level', 'info', 'debug, info, warn, error or fatal'),
    ('respawn', 'false', 'start again when it ends by itself'),
    ('autostart', 'true', 'false: wait for a lifecycle manager'),
    ('scan_topic', 'scan', 'LaserScan'),
    ('trajectory_topic', 'trajectory', 'Path of corrected poses with their stamps'),
    ('map_topic', 'map_refined', 'the map that goes out'),
    ('tf_topic', '/tf', 'transforms'),
    ('tf_static_topic', '/tf_static', 'transforms that never change'),
)

GIVEN = {
    'use_sim_time': LaunchConfiguration('use_sim_time'),
    'autostart': LaunchConfiguration('autostart'),
    'pose_source': 'tf',
}

REMAPS = [
    ('scan', LaunchConfiguration('scan_topic')),
    ('trajectory', LaunchConfiguration('trajectory_topic')),
    ('map_refined', LaunchConfiguration('map_topic')),
    ('/tf', LaunchConfiguration('tf_topic')),
    ('/tf_static', LaunchConfiguration('tf_static_topic')),
]

NODE = Node(
    package='ogm_mcmc',
    executable='refine_server',
    name='refine_server',
    namespace=LaunchConfiguration('namespace'),
    output='screen',
    respawn=LaunchConfiguration('respawn'),
    respawn_delay=2.0,
    parameters=[LaunchConfiguration('params_file'), GIVEN],
    remappings=REMAPS,
    arguments=['--ros-args', '--log-level', LaunchConfiguration('log_level')],
)


def generate_launch_description() -> LaunchDescription:
    declared = [
        DeclareLaunchArgument(name, default_value=default, description=text)
        for name, default, text in ARGUMENTS
    ]
    return LaunchDescription([*declared, NODE])
