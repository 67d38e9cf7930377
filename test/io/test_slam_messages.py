"""Graphs of SLAM systems as stamps and poses: joined by id, refused where nothing fits."""

from types import SimpleNamespace

import pytest

from ogm_mcmc.errors import PoseError
from ogm_mcmc.io.slam_messages import GraphNodes, read_trajectory_answer


def stamp(seconds):
    return SimpleNamespace(sec=seconds, nanosec=5)


def pose(x):
    return SimpleNamespace(
        position=SimpleNamespace(x=x, y=2.0, z=0.0),
        orientation=SimpleNamespace(x=0.0, y=0.0, z=0.0, w=1.0),
    )


def event(node_id, seconds):
    return SimpleNamespace(new_node_id=node_id, stamp=stamp(seconds), pose=pose(0.0))


def graph(*nodes):
    return SimpleNamespace(nodes=[SimpleNamespace(node_id=n, pose=pose(x)) for n, x in nodes])


def test_stamps_and_poses_are_joined_by_id():
    nodes = GraphNodes()
    for node_id, seconds in ((7, 10), (9, 11), (8, 12)):
        nodes.note(event(node_id, seconds))
    stamps, poses = nodes.read(graph((8, 3.0), (7, 1.0), (5, 99.0)))
    assert stamps.tolist() == [10_000_000_005, 12_000_000_005]
    assert poses[:, 0].tolist() == [1.0, 3.0]
    nodes.clear()
    with pytest.raises(PoseError, match='2 nodes without stamps: expected a new_node_event'):
        nodes.read(graph((8, 3.0), (7, 1.0)))
    with pytest.raises(PoseError, match='no pose in it'):
        nodes.read(graph())


def test_an_answer_of_cartographer():
    posed = [
        SimpleNamespace(header=SimpleNamespace(stamp=stamp(s)), pose=pose(float(s)))
        for s in (1, 2)
    ]
    answer = SimpleNamespace(trajectory=posed, status=SimpleNamespace(message=''))
    stamps, poses = read_trajectory_answer(answer)
    assert stamps.tolist() == [1_000_000_005, 2_000_000_005]
    assert poses[:, 0].tolist() == [1.0, 2.0]
    said = SimpleNamespace(message='Trajectory with ID 3 does not exist.')
    with pytest.raises(PoseError, match=r'trajectory_query: Trajectory with ID 3 does not exist'):
        read_trajectory_answer(SimpleNamespace(trajectory=[], status=said))
