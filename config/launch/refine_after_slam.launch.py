"""refine_server beside a SLAM system: its poses from tf, what it corrects from `trajectory`."""

from launch import LaunchDescription

from ogm_mcmc.ros.launching import Topic, started

TOPICS = [
    Topic('trajectory_topic', 'trajectory', 'Path of corrected poses with their stamps'),
    Topic('map_topic', 'map_refined', 'the map that goes out'),
]


def generate_launch_description() -> LaunchDescription:
    return LaunchDescription(started('refine_server', TOPICS, given={'pose_source': 'tf'}))
