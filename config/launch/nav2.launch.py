"""online_mapper in place of map_server: poses from tf, started by Nav2's lifecycle manager.

Without a bond (see MANAGER) that manager does not notice a node that comes again, and would leave
it unconfigured: with `respawn:=true` the mapper starts itself, every time, and no manager is
started.
"""

from launch import LaunchDescription
from launch.conditions import UnlessCondition
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from ogm_mcmc.ros.launching import Topic, started

MAP = Topic('map_topic', 'map', 'the map that goes out')

# Nav2's. The mapper bonds itself while it is active, but only where the messages of `bond` are
# there for its Python, which a virtual environment may not see: a manager that waited for the bond
# would then shut the mapper down. So it does not wait for one here. Where they are there, leave
# `bond_timeout` out (docs/nav2.md).
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
    mapper = started(
        'online_mapper',
        [MAP],
        given={'pose_source': 'tf', 'autostart': LaunchConfiguration('respawn')},
        respawn='start again when it ends by itself; without a lifecycle manager',
    )
    return LaunchDescription([*mapper, MANAGER])
