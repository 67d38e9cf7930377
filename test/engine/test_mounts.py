"""Where sensors sit: by parameters, by tf, at the base; and what is said about it."""

import math

import pytest

from ogm_mcmc.config import MountConfig
from ogm_mcmc.engine.mounts import MAX_TOLD, Mounts
from ogm_mcmc.engine.pose_history import Unplaceable, Waiting
from ogm_mcmc.engine.tf_poses import TfPoses
from ogm_mcmc.engine.transform_tree import TransformTree
from ogm_mcmc.geometry import Pose2D, SensorMount
from ogm_mcmc.geometry.rigid_transform import RigidTransform, StampedTransform

approx = pytest.approx
S = 1_000_000_000
ROLLED = (1.0, 0.0, 0.0, 0.0)
TILTED = (0.0, math.sin(0.2), 0.0, math.cos(0.2))


def entry(stamp_s, x=0.0, yaw=0.0, turn=None, child='laser'):
    turn = turn or (0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2))
    transform = RigidTransform((x, 0.0, 0.0), turn)
    return StampedTransform('base_link', child, round(stamp_s * S), transform)


class Bench:
    """Mounts and what they told."""

    def __init__(self, config=None, tf=True, **options):
        self.tree = TransformTree()
        self.told = []
        self.mounts = Mounts(
            config or MountConfig(),
            'base_link',
            transforms=TfPoses(self.tree, '', 'base_link') if tf else None,
            tell=self.told.append,
            **options,
        )

    def at(self, stamp_s, now_s=0.0, frame='laser'):
        return self.mounts.at(frame, round(stamp_s * S), now_s)

    def why_not(self, stamp_s, now_s=0.0):
        with pytest.raises(Unplaceable) as caught:
            self.at(stamp_s, now_s)
        return str(caught.value)


def test_tf_static_says_where_the_laser_sits():
    bench = Bench()
    bench.tree.add(entry(1, 0.2, math.pi / 2), static=True)
    mount = bench.at(5)
    assert (mount.pose.x_m, mount.pose.yaw_rad) == (approx(0.2), approx(math.pi / 2))
    assert bench.at(6) == mount
    (found,) = bench.told
    assert str(found) == 'laser on base_link at 0.2 0 m, turned by 90 degrees (from tf_static)'
    assert not found.guessed


def test_a_roll_of_half_a_turn_is_upside_down():
    bench = Bench()
    bench.tree.add(entry(1, turn=ROLLED), static=True)
    assert bench.at(1).upside_down
    assert 'upside down (from tf_static)' in str(bench.told[0])


def test_a_sensor_that_is_not_level_cannot_be_used():
    bench = Bench()
    bench.tree.add(entry(1, turn=TILTED), static=True)
    assert bench.why_not(1) == 'scan_bad_mount'


def test_a_corrected_mount_counts_from_then_on_and_is_told():
    bench = Bench()
    bench.tree.add(entry(1, 0.2), static=True)
    assert bench.at(1).pose.x_m == approx(0.2)
    bench.tree.add(entry(5, 0.4), static=True)
    assert bench.at(4).pose.x_m == approx(0.2)
    assert bench.at(5).pose.x_m == approx(0.4)
    assert [found.mount.pose.x_m for found in bench.told] == approx([0.2, 0.4])


def test_a_mount_that_moves_is_that_at_the_stamp():
    bench = Bench()
    bench.tree.add(entry(1, yaw=0.0))
    bench.tree.add(entry(2, yaw=1.0))
    assert bench.at(1.25).pose.yaw_rad == approx(0.25)
    assert bench.at(1.75).pose.yaw_rad == approx(0.75)
    with pytest.raises(Waiting):
        bench.at(2.5, now_s=100.0)
    assert bench.why_not(0.5) == 'scan_no_mount'
    bench.tree.add(entry(9, yaw=1.0))
    assert bench.why_not(5) == 'scan_no_mount'
    assert [found.origin for found in bench.told] == ['tf']


def test_parameters_that_name_a_place_come_before_tf():
    """Only for the sensors they name; the others are where tf says."""
    bench = Bench(MountConfig(frames='laser 1 0 0'))
    bench.tree.add(entry(1, 0.2), static=True)
    bench.tree.add(entry(1, 0.3, child='rear'), static=True)
    assert bench.at(1).pose == Pose2D(1.0)
    assert bench.at(1, frame='rear').pose.x_m == approx(0.3)
    assert [found.origin for found in bench.told] == ['parameters', 'tf_static']
    assert Bench(MountConfig(x=2.0)).at(1).pose == Pose2D(2.0)


def test_a_frame_that_nothing_knows_waits_and_is_then_taken_at_the_base():
    bench = Bench(patience_s=1.0)
    for now_s in (10.0, 10.9):
        with pytest.raises(Waiting):
            bench.at(1, now_s)
    assert bench.at(1, 11.0) == SensorMount()
    (found,) = bench.told
    assert found.guessed
    assert 'laser is not base_link, and neither tf nor parameters say' in str(found)
    # tf is late: it counts from now on.
    bench.tree.add(entry(1, 0.2), static=True)
    assert bench.at(2, 12.0).pose.x_m == approx(0.2)
    assert bench.told[1].origin == 'tf_static'


def test_a_sensor_that_is_the_base_needs_no_word_of_tf():
    bench = Bench()
    bench.tree.add(entry(1.0), static=True)
    bench.mounts.base_frame = bench.mounts.transforms.base_frame = 'laser'
    assert bench.at(2.0) == SensorMount()
    assert not any(found.shown for found in bench.told)


def test_the_frame_of_the_base_needs_no_word():
    bench = Bench()
    assert bench.at(1, frame='base_link') == SensorMount()
    assert not bench.told[0].guessed


def test_only_tf():
    bench = Bench(MountConfig(x=2.0), source='tf', patience_s=1.0)
    with pytest.raises(Waiting):
        bench.at(1, 0.0)
    assert bench.why_not(1, 1.0) == 'scan_no_mount'
    bench.tree.add(entry(1, 0.2), static=True)
    assert bench.at(1, 1.0).pose.x_m == approx(0.2)


def test_a_topic_of_its_own_fills_in_what_parameters_do_not_say():
    bench = Bench(MountConfig(frames='rear -0.2 0 3.0'), source='topic', patience_s=0.0)
    assert bench.why_not(1.0) == 'scan_no_mount'
    bench.tree.add(entry(1.0, 0.2, 0.5))
    bench.tree.add(entry(2.0, 0.2, 1.5))
    assert [bench.at(stamp).pose.yaw_rad for stamp in (1.0, 1.5, 2.0)] == approx([0.5, 1.0, 1.5])
    assert bench.at(1.0, frame='rear').pose.yaw_rad == 3.0
    assert [one.origin for one in bench.told] == ['topic', 'parameters']
    with pytest.raises(Waiting):
        bench.at(3.0)


def test_only_parameters():
    bench = Bench(source='parameters')
    bench.tree.add(entry(1, 0.2), static=True)
    assert bench.at(1) == SensorMount()
    assert bench.told[0].guessed


def test_without_tf_nothing_is_waited_for():
    assert Bench(tf=False).at(1) == SensorMount()


def test_who_stops_waiting_waits_no_longer():
    bench = Bench(patience_s=1.0)
    with pytest.raises(Waiting):
        bench.at(1, 0.0)
    bench.mounts.stop_waiting()
    assert bench.at(1, 0.0) == SensorMount()


def test_many_frames_are_not_all_told():
    bench = Bench(tf=False)
    for k in range(3 * MAX_TOLD):
        bench.at(1, frame=f'laser_{k}')
    assert len(bench.told) == MAX_TOLD


def test_a_fault_is_forgotten_once_the_mount_is_found_again():
    bench = Bench()
    bench.tree.add(entry(1, turn=TILTED), static=True)
    assert bench.why_not(1) == 'scan_bad_mount'
    assert 'tilted' in bench.mounts.faults['laser']
    bench.tree.add(entry(5, 0.2), static=True)
    assert bench.at(6).pose.x_m == approx(0.2)
    assert dict(bench.mounts.faults) == {}
