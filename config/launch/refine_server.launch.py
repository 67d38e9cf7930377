"""`ros2 launch ogm_mcmc refine_server.launch.py [NAME:=VALUE ...]`; `--show-args` lists them."""

from launch import LaunchDescription

from ogm_mcmc.ros.launching import POSES, Topic, started

MAP = Topic('map_topic', 'map_refined', 'the map that goes out')


def generate_launch_description() -> LaunchDescription:
    return LaunchDescription(started('refine_server', [POSES, MAP]))
