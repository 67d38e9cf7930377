"""What the launch files share: a node, its parameter file and the arguments that reach it.

A launch file of `config/launch` names the topics of its node, and what it decides itself; the
rest is here, because under ROS such files cannot import one another. Needs `launch` and
`launch_ros`, which come with ROS 2 and are not on PyPI.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

__all__ = ['POSES', 'Topic', 'started']


class Topic(NamedTuple):
    """A topic of the node, the argument that gives it another name, and what it carries."""

    argument: str
    name: str
    text: str


POSES = Topic('pose_topic', 'pose', 'PoseWithCovarianceStamped (pose_source pose)')

SCANS = Topic('scan_topic', 'scan', 'LaserScan')
TRANSFORMS = (
    Topic('tf_topic', '/tf', 'transforms'),
    Topic('tf_static_topic', '/tf_static', 'transforms that never change'),
)


def started(
    executable: str,
    topics: Sequence[Topic],
    *,
    given: Mapping[str, Any] | None = None,
    respawn: str = 'start again when it ends by itself',
) -> list[Any]:
    """Return the declared arguments of a node, then the node.

    topics   of this node beside scans and transforms
    given    parameters that the launch file decides: of these no argument is declared
    respawn  what that argument is said to do
    """
    # Through the ament index: a symlink install leaves launch files in the source tree.
    file = PathJoinSubstitution([FindPackageShare('ogm_mcmc'), 'config', f'{executable}.yaml'])
    given, mapped = given or {}, (SCANS, *topics, *TRANSFORMS)
    arguments: dict[str, tuple[Any, str]] = {
        'namespace': ('', 'namespace of the node and its topics'),
        'params_file': (file, f'parameters of {executable}'),
        'use_sim_time': ('false', 'follow /clock'),
        'log_level': ('info', 'debug, info, warn, error or fatal'),
        'respawn': ('false', respawn),
        'autostart': ('true', 'false: wait for a lifecycle manager'),
        **{topic.argument: (topic.name, topic.text) for topic in mapped},
    }
    declared = [
        DeclareLaunchArgument(name, default_value=default, description=text)
        for name, (default, text) in arguments.items()
        if name not in given
    ]
    by_argument = {name: LaunchConfiguration(name) for name in ('use_sim_time', 'autostart')}
    node = Node(
        package='ogm_mcmc',
        executable=executable,
        name=executable,
        namespace=LaunchConfiguration('namespace'),
        output='screen',
        respawn=LaunchConfiguration('respawn'),
        respawn_delay=2.0,
        parameters=[LaunchConfiguration('params_file'), {**by_argument, **given}],
        remappings=[(topic.name, LaunchConfiguration(topic.argument)) for topic in mapped],
        arguments=['--ros-args', '--log-level', LaunchConfiguration('log_level')],
    )
    return [*declared, node]
