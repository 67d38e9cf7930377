"""online_mapper in place of map_server: poses from tf, started by Nav2's lifecycle manager.

Without a bond that manager does not notice a node that comes again, and would leave it
unconfigured: with `respawn:=true` the mapper starts itself, every time, and no manager is started.
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.conditions import UnlessCondition
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

# Through the ament index: a symlink install leaves this file in the source tree.
PARAMETERS = PathJoinSubstitution([FindPackageShare('ogm_mcmc'), 'config', 'online_mapper.yaml'])

ARGUMENTS = (
    ('namespace', '', 'namespace of the node and its topics'),
    ('params_file', PARAMETERS, 'parameters of online_mapper'),
    ('use_sim_time', 'false', 'follow /clock'),
    ('log_level', 'info', 'debug, info, warn, error or fatal'),
    ('respawn', 'false', 'start again when it ends by itself; without a lifecycle manager'),
    ('scan_topic', 'scan', 'LaserScan'),
    ('map_topic', 'map', 'the map that goes out'),
    ('tf_topic', '/tf', 'transforms'),
    ('tf_static_topic', '/tf_static', 'transforms that never change'),
)

GIVEN = {
    'use_sim_time': LaunchConfiguration('use_sim_time'),
    'autostart': LaunchConfiguration('respawn'),
    'pose_source': 'tf',
}

REMAPS = [
    ('scan', LaunchConfiguration('scan_topic')),
    ('map', LaunchConfiguration('map_topic')),
    ('/tf', LaunchConfiguration('tf_topic')),
    ('/tf_static', LaunchConfiguration('tf_static_topic')),
]

NODE = Node(
    package='ogm_mcmc',
    executable='online_mapper',
    name='online_mapper',
    namespace=LaunchConfiguration('namespace'),
    output='screen',
    respawn=LaunchConfiguration('respawn'),
    respawn_delay=2.0,
    parameters=[LaunchConfiguration('params_file'), GIVEN],
    remappings=REMAPS,
    arguments=['--ros-args', '--log-level', LaunchConfiguration('log_level')],
)

# Nav2's; bondpy is not used, so the bond is off.
MANAGER = Node(
    package='nav2_lifecycle_manager',
    executable='lifecycle_manager',
    name='lifecycle_manager_map',
    namespace=LaunchConfiguration('namespace'),
    output='screen',
    condition=UnlessCondition(LaunchConfiguration('respawn')),
    parameters=[
        {
            'use_sim_time': LaunchConfiguration('use_sim_time'),
            'autostart': True,
            'node_names': ['online_mapper'],
            'bond_timeout': 0.0,
        }
    ],
)


def generate_launch_description() -> LaunchDescription:
    declared = [
        DeclareLaunchArgument(name, default_value=default, description=text)
        for name, default, text in ARGUMENTS
    ]
    return LaunchDescription([*declared, NODE, MANAGER])
