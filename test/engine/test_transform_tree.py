import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.strategies import REPEATABLE

from ogm_mcmc.engine import transform_tree
from ogm_mcmc.engine.transform_tree import TransformError, TransformTree
from ogm_mcmc.errors import PoseError
from ogm_mcmc.geometry import Pose2D
from ogm_mcmc.geometry.rigid_transform import RigidTransform, StampedTransform

approx = pytest.approx
S = 1_000_000_000


def entry(parent, child, stamp_s, x=0.0, y=0.0, yaw=0.0):
    turn = (0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2))
    return StampedTransform(parent, child, round(stamp_s * S), RigidTransform((x, y, 0.0), turn))


def tree_of(*entries, static=(), **options):
    tree = TransformTree(**options)
    for one in static:
        tree.add(one, static=True)
    for one in entries:
        tree.add(one)
    return tree


def planar(tree, target, source, stamp_s, **options):
    pose, _ = tree.lookup(target, source, round(stamp_s * S), **options).planar()
    return pose.x_m, pose.y_m, pose.yaw_rad


ROBOT = (
    entry('map', 'odom', 0.0),
    entry('map', 'odom', 2.0, x=2.0),
    entry('odom', 'base_link', 0.5, x=10.0),
    entry('odom', 'base_link', 1.5, x=20.0),
)
LASER = entry('base_link', 'laser', 0.0, x=0.5, yaw=math.pi / 2)


def test_every_edge_is_taken_at_the_stamp():
    tree = tree_of(*ROBOT, static=[LASER])
    assert planar(tree, 'map', 'base_link', 1.0) == approx((16.0, 0.0, 0.0))
    assert planar(tree, 'map', 'laser', 1.25) == approx((1.25 + 17.5 + 0.5, 0.0, math.pi / 2))
    assert planar(tree, 'laser', 'base_link', 99.0) == approx((0.0, 0.5, -math.pi / 2))
    assert planar(tree, 'odom', 'map', 1.0) == approx((-1.0, 0.0, 0.0))


def test_frames_beside_each_other_meet_below_the_root():
    """What happens above the frame where they meet does not matter."""
    tree = tree_of(static=[LASER, entry('base_link', 'sonar', 0.0, x=-0.5)])
    tree.add(entry('odom', 'base_link', 100.0))
    assert planar(tree, 'sonar', 'laser', 1.0) == approx((1.0, 0.0, math.pi / 2))


def test_a_frame_in_itself():
    assert TransformTree().lookup('x', 'x', 5) == RigidTransform()


def test_halfway_turn_goes_the_short_way_round():
    tree = tree_of(
        entry('odom', 'base', 0.0, yaw=3.0), entry('odom', 'base', 1.0, x=1.0, yaw=-3.0)
    )
    x, _, yaw = planar(tree, 'odom', 'base', 0.5)
    assert x == 0.5
    assert abs(yaw) == approx(math.pi)


def test_stamps_of_today_do_not_lose_a_nanosecond():
    now = 1_700_000_000 * S
    tree = TransformTree()
    for k in range(3):
        tree.add(StampedTransform('odom', 'base', now + k, RigidTransform((k, 0.0, 0.0))))
    assert [tree.lookup('odom', 'base', now + k).translation[0] for k in range(3)] == [0, 1, 2]


@pytest.mark.parametrize(
    ('target', 'source', 'stamp_s', 'reason', 'message'),
    [
        ('world', 'laser', 1.0, 'unknown',
         "frame 'world' is not there; known: base_link, camera, laser, map, odom, rig"),
        ('map', 'camera', 1.0, 'unconnected',
         "'map' and 'camera' are not connected "
         '(trees: rig > camera; map > odom > base_link > laser)'),
        ('map', 'laser', 0.25, 'early',
         'stamp 0.250 s is earlier than all of odom -> base_link (0.500 to 1.500 s)'),
        ('map', 'laser', 1.75, 'late',
         'stamp 1.750 s is later than all of odom -> base_link (0.500 to 1.500 s)'),
        ('laser', 'map', 1.75, 'late',
         'stamp 1.750 s is later than all of odom -> base_link (0.500 to 1.500 s)'),
    ],
)  # fmt: skip
def test_errors_say_what_is_there(target, source, stamp_s, reason, message):
    tree = tree_of(*ROBOT, static=[LASER, entry('rig', 'camera', 0.0)])
    with pytest.raises(TransformError) as caught:
        tree.lookup(target, source, round(stamp_s * S))
    assert caught.value.reason == reason
    assert str(caught.value) == message


def test_an_empty_tree_says_so():
    with pytest.raises(TransformError, match="frame 'map' is not there; known: none"):
        TransformTree().lookup('map', 'laser', 0)
    assert str(TransformTree()) == 'nothing'


def test_a_gap_is_not_filled():
    tree = tree_of(*ROBOT)
    assert planar(tree, 'map', 'odom', 1.0, max_gap_ns=2 * S) == approx((1.0, 0.0, 0.0))
    message = r'map -> odom: entries 2 s apart around 1.000 s: expected at most 1.9 s'
    with pytest.raises(TransformError, match=message):
        tree.lookup('map', 'base_link', S, max_gap_ns=1_900_000_000)
    # At the very entries there is no gap.
    assert planar(tree, 'map', 'odom', 2.0, max_gap_ns=1) == (2.0, 0.0, 0.0)


def test_frames_in_a_ring():
    tree = tree_of(static=[entry('a', 'b', 0.0), entry('b', 'c', 0.0), entry('c', 'a', 0.0)])
    tree.add(entry('r', 'x', 0.0), static=True)
    with pytest.raises(TransformError, match='frames in a ring: a -> c -> b -> a; expected'):
        tree.lookup('x', 'a', 0)
    assert tree.newest_common_ns('x', 'a') is None


@pytest.mark.parametrize(('parent', 'child'), [('', 'a'), ('a', ''), ('a', 'a')])
def test_an_entry_needs_two_frames(parent, child):
    with pytest.raises(PoseError, match='expected two frames'):
        TransformTree().add(entry(parent, child, 0.0))


def test_late_entries_find_their_place_and_a_repeated_stamp_replaces():
    tree = tree_of(
        entry('odom', 'base', 0.0),
        entry('odom', 'base', 2.0, x=2.0),
        entry('odom', 'base', 1.0, x=9.0),
        entry('odom', 'base', 2.0, x=11.0),
    )
    xs = [planar(tree, 'odom', 'base', stamp)[0] for stamp in (0.5, 1.0, 1.5, 2.0)]
    assert xs == approx([4.5, 9.0, 10.0, 11.0])


def test_a_corrected_static_transform_counts_from_its_own_stamp():
    tree = tree_of(static=[entry('base', 'laser', 5.0, x=1.0), entry('base', 'laser', 8.0, x=2.0)])
    xs = [planar(tree, 'base', 'laser', stamp)[0] for stamp in (0.0, 7.9, 8.0, 100.0)]
    assert xs == [1.0, 1.0, 2.0, 2.0]


def test_a_corrected_static_transform_without_a_stamp_counts_from_its_arrival():
    tree = TransformTree()
    tree.add(entry('base', 'laser', 0.0, x=1.0), static=True, arrival_ns=3 * S)
    tree.add(entry('base', 'laser', 0.0, x=2.0), static=True, arrival_ns=8 * S)
    tree.add(entry('base', 'laser', 0.0, x=2.0), static=True, arrival_ns=20 * S)  # again
    tree.add(entry('base', 'laser', 0.0, x=3.0), static=True, arrival_ns=25 * S)
    xs = [planar(tree, 'base', 'laser', stamp)[0] for stamp in (7.0, 8.0, 24.0, 25.0)]
    assert xs == [1.0, 2.0, 2.0, 3.0]


def test_a_moving_mount_is_looked_up_at_each_stamp():
    tree = tree_of(
        entry('base', 'head', 0.0), entry('base', 'head', 1.0, yaw=1.0),
        static=[entry('head', 'laser', 0.0, x=2.0)],
    )  # fmt: skip
    assert planar(tree, 'base', 'laser', 0.5) == approx(
        (2 * math.cos(0.5), 2 * math.sin(0.5), 0.5)
    )


def test_a_frame_with_another_parent_keeps_the_old_one_until_then():
    tree = tree_of(
        entry('left', 'box', 0.0, x=1.0), entry('left', 'box', 1.0, x=2.0),
        entry('right', 'box', 2.0, x=5.0), entry('right', 'box', 3.0, x=6.0),
        static=[entry('map', 'left', 0.0), entry('map', 'right', 0.0, y=100.0)],
    )  # fmt: skip
    found = [planar(tree, 'map', 'box', stamp)[:2] for stamp in (0.5, 1.5, 2.0, 2.5)]
    assert found == [(1.5, 0.0), (2.0, 0.0), (5.0, 100.0), (5.5, 100.0)]
    with pytest.raises(TransformError, match='left -> box: entries 1 s apart'):
        tree.lookup('map', 'box', 3 * S // 2, max_gap_ns=S // 2)


def test_a_frame_that_begins_to_move_is_no_longer_static():
    tree = tree_of(static=[entry('map', 'odom', 0.0, x=7.0)])
    tree.add(entry('map', 'odom', 10.0, x=1.0))
    with pytest.raises(TransformError, match='earlier than all of map -> odom'):
        tree.lookup('map', 'odom', 5 * S)


def test_old_entries_are_dropped_where_asked():
    tree = tree_of(*(entry('odom', 'base', k, x=k) for k in range(100)), keep_s=10.0)
    assert planar(tree, 'odom', 'base', 89.0)[0] == 89.0
    with pytest.raises(TransformError, match=r'\(89.000 to 99.000 s\)'):
        tree.lookup('odom', 'base', 88 * S)
    assert not tree.add(entry('odom', 'base', 88.9))
    assert tree.add(entry('odom', 'base', 89.5, x=50.0))
    assert planar(tree, 'odom', 'base', 89.5)[0] == 50.0


def test_a_restart_forgets_what_moves_and_keeps_the_newest_mount():
    tree = tree_of(*ROBOT, static=[LASER, entry('base_link', 'laser', 90.0, x=3.0)])
    tree.restart(S)  # 1 s back is late, not a restart
    assert planar(tree, 'map', 'base_link', 1.0) == approx((16.0, 0.0, 0.0))
    tree.restart(S - 1)
    assert tree.frames() == ['base_link', 'laser']
    assert planar(tree, 'base_link', 'laser', 0.0) == (3.0, 0.0, 0.0)


def test_up_to_when_all_edges_are_known():
    tree = tree_of(*ROBOT, static=[LASER])
    assert tree.newest_common_ns('map', 'laser') == 3 * S // 2
    assert tree.newest_common_ns('laser', 'map') == 3 * S // 2
    assert tree.newest_common_ns('map', 'odom') == 2 * S
    assert tree.newest_common_ns('base_link', 'laser') > 10**18
    assert tree.newest_common_ns('map', 'elsewhere') is None
    assert tree.newest_common_ns('elsewhere', 'elsewhere') is None
    stamps = tree.moving_stamps('map', 'laser')
    assert [list(edge) for edge in stamps] == [[S // 2, 3 * S // 2], [0, 2 * S]]


# -- against a naive twin: every frame as matrix in the root, by scanning lists of entries --------

PARENTS = {'b': 'a', 'c': 'b', 'd': 'b', 'e': 'a', 'f': 'e'}

steps = st.tuples(
    st.sampled_from(sorted(PARENTS)),
    st.integers(0, 12),
    st.integers(-5, 5),
    st.integers(-5, 5),
    st.integers(-3, 3),
)


def naive_edge(entries, child, stamp):
    """The child in its parent as complex position and heading, or None."""
    known = {k: (complex(x, y), yaw) for name, k, x, y, yaw in entries if name == child}
    before = [k for k in known if k <= stamp]
    after = [k for k in known if k >= stamp]
    if not before or not after:
        return None
    first, last = max(before), min(after)
    share = 0.0 if first == last else (stamp - first) / (last - first)
    turn = math.remainder(known[last][1] - known[first][1], 2 * math.pi)
    place = known[first][0] + share * (known[last][0] - known[first][0])
    return place, known[first][1] + share * turn


def naive_in_frame(entries, frame, top, stamp):
    place, heading = 0j, 0.0
    while frame != top:
        edge = naive_edge(entries, frame, stamp)
        if edge is None:
            return None
        place = edge[0] + place * np.exp(1j * edge[1])
        heading += edge[1]
        frame = PARENTS[frame]
    return place, heading


def above(frame):
    return [frame, *above(PARENTS[frame])] if frame in PARENTS else [frame]


@REPEATABLE
@given(
    st.lists(steps, max_size=40),
    st.sampled_from('abcdef'),
    st.sampled_from('abcdef'),
    st.floats(0.0, 12.0),
)
def test_against_a_naive_twin(entries, target, source, stamp):
    tree = TransformTree()
    for name, k, x, y, yaw in entries:
        tree.add(entry(PARENTS[name], name, k, x, y, yaw))
    stamp_ns = round(stamp * S)
    top = next(frame for frame in above(source) if frame in above(target))
    up = naive_in_frame(entries, source, top, stamp_ns / S)
    down = naive_in_frame(entries, target, top, stamp_ns / S)
    if target != source and (up is None or down is None):
        with pytest.raises(TransformError):
            tree.lookup(target, source, stamp_ns)
        return
    place = (up[0] - down[0]) * np.exp(-1j * down[1])
    got, upside_down = tree.lookup(target, source, stamp_ns).planar()
    assert (got.x_m, got.y_m) == approx((place.real, place.imag), abs=1e-6)
    assert math.remainder(got.yaw_rad - up[1] + down[1], 2 * math.pi) == approx(0.0, abs=1e-6)
    assert not upside_down
    # The other way round is the inverse, and a chain its product.
    back, _ = tree.lookup(source, target, stamp_ns).planar()
    assert_same(got.compose(back), Pose2D())
    if top not in (source, target):
        in_top, _ = tree.lookup(top, source, stamp_ns).planar()
        to_target, _ = tree.lookup(target, top, stamp_ns).planar()
        assert_same(to_target.compose(in_top), got)


def assert_same(pose, other):
    assert (pose.x_m, pose.y_m) == approx((other.x_m, other.y_m), abs=1e-9)
    assert math.remainder(pose.yaw_rad - other.yaw_rad, 2 * math.pi) == approx(0.0, abs=1e-9)


def test_a_wrong_stamp_of_the_future_does_not_lock_a_frame():
    """What is too old beside it in a row is a restart: also for mounts that move."""
    tree = TransformTree(keep_s=30.0)
    tree.add(entry('base', 'laser', 2e9))
    taken = [tree.add(entry('base', 'laser', 1.0 + 0.1 * k, x=float(k))) for k in range(20)]
    assert taken == [False] * 10 + [True] * 10
    assert planar(tree, 'base', 'laser', 2.5) == approx((15.0, 0.0, 0.0))
    assert tree._n_entries == 10


def test_a_mount_corrected_from_the_future_on_counts_from_its_arrival():
    tree = tree_of(static=[LASER])
    wrong, right = (entry('base_link', 'laser', 2e9, x=x) for x in (0.6, 0.7))
    tree.add(wrong, static=True, arrival_ns=10 * S)
    assert planar(tree, 'base_link', 'laser', 11.0)[0] == approx(0.6)
    tree.add(right, static=True, arrival_ns=12 * S)
    assert planar(tree, 'base_link', 'laser', 13.0)[0] == approx(0.7)
    assert planar(tree, 'base_link', 'laser', 9.0)[0] == approx(0.5)


def test_a_sender_that_makes_up_names_does_not_fill_the_memory(monkeypatch):
    """One child under ever new parents, stamps ever closer, a mount corrected again and again."""
    monkeypatch.setattr(transform_tree, 'MAX_LIVE_FRAMES', 10)
    monkeypatch.setattr(transform_tree, 'MAX_LIVE_ENTRIES', 100)
    tree = TransformTree(keep_s=30.0)
    for k in range(1000):
        tree.add(entry(f'parent {k}', 'laser', 1.0 + 0.001 * k))
        tree.add(entry('base', 'mast', 1.0, x=float(k)), static=True)
        tree.add(entry('map', 'base', 1.0 + 0.001 * k))
        assert len(tree.frames()) <= 21
        held = sum(len(history) for history in tree._frames.values())
        assert held == tree._n_entries <= 100
    assert {'parent 999', 'laser', 'base', 'mast', 'map'} <= set(tree.frames())
    assert planar(tree, 'map', 'mast', 1.99) == pytest.approx((999.0, 0.0, 0.0))
    tree.clear()
    assert tree._n_entries == 1


def test_errors_name_some_of_very_many_frames():
    tree = tree_of(*(entry('map', f'robot {k}', 0.0) for k in range(1000)))
    with pytest.raises(TransformError) as raised:
        tree.lookup('map', 'laser', 0)
    assert str(raised.value).endswith('and 981 more')
    assert len(str(raised.value)) < 400
    assert str(tree).endswith('; and 980 more')


def test_one_sender_with_a_wrong_clock_takes_no_other_frame_with_it():
    """The gripper has two senders, of which one is an hour behind and sends more often."""
    tree = TransformTree(keep_s=30.0)
    lost = 0
    for k in range(300):
        now = 5000.0 + k / 50
        tree.add(entry('odom', 'base', now, x=float(k)))
        tree.add(entry('base', 'gripper', now - 3600.0))
        if k % 50 == 0:
            tree.add(entry('base', 'gripper', now))
        lost += planar(tree, 'odom', 'base', 5000.0)[0] != 0.0
    assert lost == 0
    assert tree._n_entries == sum(len(history) for history in tree._frames.values())
    assert tree._n_entries > 300


def test_after_a_true_restart_each_frame_is_there_again():
    tree = TransformTree(keep_s=30.0)
    for start in (1000.0, 0.0):
        for k in range(40):
            tree.add(entry('map', 'odom', start + k / 10))
            tree.add(entry('odom', 'base', start + k / 10, x=start + k))
    assert planar(tree, 'map', 'base', 2.0)[0] == approx(20.0)
    assert tree.newest_common_ns('map', 'base') == round(3.9 * S)


def test_a_base_whose_transform_is_repeated_does_not_move_apart():
    tree = tree_of(entry('odom', 'base_link', 0.0), entry('odom', 'base_link', 1.0, x=1.0))
    for stamp_s in (0.0, 1.0):
        tree.add(entry('base_link', 'base_footprint', stamp_s))
    tree.add(entry('base_link', 'laser', 0.0, x=0.2), static=True)
    assert not tree.moves_apart('base_footprint', 'laser')
    assert tree.moves_apart('base_footprint', 'odom')
    tree.add(entry('base_link', 'base_footprint', 2.0, x=0.1))
    assert tree.moves_apart('base_footprint', 'laser')
