"""Poses of a trajectory file in place of those of a bag, and odometry between them."""

import numpy as np
import pytest
from support.transforms import transform

from ogm_mcmc.engine.bag_scans import PlacedScans
from ogm_mcmc.engine.bag_topics import choose_topics
from ogm_mcmc.engine.stream_choice import StreamChoice
from ogm_mcmc.errors import BagError, PoseError
from ogm_mcmc.geometry import Pose2D
from ogm_mcmc.io import ros_types
from ogm_mcmc.io.bags import BagReader

SECOND = 1_000_000_000
STAMPS = [20 * SECOND + k * SECOND // 10 for k in range(8)]
LASER = ('/tf_static', 1, transform(1, 'base_link', 'laser', 0.0, 0.0, 0.0))


@pytest.fixture
def choose(write_bag, tmp_path):
    """Choose from records with a file of (seconds, x, y) poses: (stream, placed, lines said)."""

    def run(records, rows, spreads=(), **choice):
        said = []
        lines = [f'{row[0]} {" ".join(map(str, row[1:]))} 0 0 0 0 1\n' for row in rows]
        (tmp_path / 'poses.tum').write_text(''.join(lines))
        said_of = [
            f'{row[0]},{",".join(map(str, spread))}\n'
            for row, spread in zip(rows, spreads, strict=False)
        ]
        if spreads:
            beside = tmp_path / 'poses_deviations.csv'
            beside.write_text(''.join(['stamp_s,x_m,y_m,yaw_rad\n', *said_of]))
        wanted = StreamChoice(trajectory=tmp_path / 'poses.tum', **choice)
        with BagReader(write_bag(records)) as bag:
            scans = PlacedScans(bag, choose_topics(bag, wanted), wanted, tell=said.append)
            placed = list(scans)
            scans.wheels = scans.odometry()
        return scans, placed, said

    return run


@pytest.fixture
def scans(make_scan):
    def make(stamps=STAMPS):
        return [LASER, *(('/scan', stamp, make_scan(stamp, frame='laser')) for stamp in stamps)]

    return make


def wheels(places, stamps=STAMPS):
    return [
        ('/odom', stamp, ros_types.odometry(stamp, Pose2D(*place), 0.0, 0.0))
        for stamp, place in zip(stamps, places, strict=True)
    ]


def seconds(*at):
    return [round(second * SECOND) for second in at]


def test_a_trajectory_in_place_of_the_poses_of_the_bag(choose, scans):
    laser = ('/tf_static', 1, transform(1, 'base_link', 'laser', 0.2, 0.0, 0.0))
    records = [laser, *scans()[1:], *wheels([(0.1 * k,) for k in range(8)])]
    rows = [(20.0, 1, 2), (20.7, 1, 9)]
    stream, placed, said = choose(records, rows)
    assert stream.topics.pose_source == 'trajectory'
    assert placed[0].pose.x_m == pytest.approx(1.2)
    assert placed[1].pose.y_m == pytest.approx(3.0)
    assert said[0] == (
        'poses from poses.tum (trajectory file, 100 % of 8 scans); also there: /odom 100 %'
    )
    _, placed, _ = choose(records, rows, trajectory_frame='laser')
    assert placed[0].pose.x_m == pytest.approx(1.0)
    with pytest.raises(BagError, match=r'no poses at the stamps .*poses\.tum 1\.0 to 1\.0 s'):
        choose(records, [(1.0, 1, 2)])


def test_between_poses_of_a_trajectory_the_robot_goes_as_odometry_says(choose, scans):
    steps = [0.0, 0.0, 0.0, 0.0, 0.1, 0.2, 0.3, 0.4]  # it stands, then it goes
    rows = [(20.0, 5, 0), (20.7, 5.4, 0)]
    stream, placed, said = choose([*scans(), *wheels([(step,) for step in steps])], rows)
    assert [one.pose.x_m - 5.0 for one in placed] == pytest.approx(steps)
    assert said[1] == 'between poses of poses.tum motion is that of /odom 100 %'
    # Wheels that poses were filled in by are no second witness.
    assert stream.wheels is None
    _, placed, said = choose(scans(), rows)
    assert placed[1].pose.x_m == pytest.approx(5.0 + 0.4 / 7.0)
    assert 'motion' not in str(said)


@pytest.mark.parametrize('n_poses', [3, 5])
def test_odometry_that_foretells_no_pose_fills_nothing(choose, scans, n_poses):
    """The file goes straight ahead, what was recorded sways; ends of the file are no witnesses."""
    rows = [(20.0 + 0.2 * k, 0.2 * k, 0) for k in range(n_poses)]
    steps = range(-1, 2 * n_poses)
    stamps = seconds(*(20.0 + 0.1 * k for k in steps))
    sway = [(0.1 * k, 0.04 * (0, 1, 2, 1)[k % 4]) for k in steps]
    stream, placed, said = choose([*scans(stamps[1:-1]), *wheels(sway, stamps)], rows)
    assert {one.pose.y_m for one in placed} == {0.0}
    assert 'motion' not in str(said)
    assert stream.wheels(STAMPS[0]) == Pose2D()


def test_what_a_file_is_silent_about_for_long_stays_lost(choose, scans):
    """It was carried 30 m while the file said nothing, and the wheels turned."""
    file = [1, 2, 3, 4, 104, 105, 106]
    stamps = seconds(*range(1, 107))
    records = [*scans(stamps), *wheels([(0.1 * k,) for k in range(106)], stamps)]
    rows = [(at, 0.1 * (at - 1) + 30.0 * (at > 50), 0) for at in file]
    stream, placed, _ = choose(records, rows)
    assert [one.scan.stamp_ns for one in placed] == seconds(*file)
    assert stream.placer.dropped == {'pose_gap': 99}
    # Nor where nothing was carried: 100 s are beyond what wheels are good for.
    _, placed, _ = choose(records, [(at, 0.1 * (at - 1), 0) for at in file])
    assert [one.scan.stamp_ns for one in placed] == seconds(*file)


def test_poses_every_few_seconds_are_filled_in_and_counted_so(choose, scans):
    """The bag without them would be refused: no scan is at a pose."""
    stamps = seconds(*range(20, 28))
    records = [*scans(stamps), *wheels([(0.2 * k,) for k in range(8)], stamps)]
    rows = [(20.5, 1.1, 0), (26.5, 2.3, 0)]
    _, placed, said = choose(records, rows)
    assert [one.pose.x_m for one in placed] == pytest.approx([1.2, 1.4, 1.6, 1.8, 2.0, 2.2])
    assert said[0].startswith('poses from poses.tum (trajectory file, 75 % of 8 scans)')
    with pytest.raises(BagError, match='no poses at the stamps'):
        choose(scans(stamps), rows)
    # Whoever wants shorter gaps has them, up to five times as long where odometry fills them.
    with pytest.raises(BagError, match='no poses at the stamps'):
        choose(records, rows, max_pose_gap_s=1.1)
    # The robot went elsewhere in between: wheels do not err by 0.9 m in 1.2 m.
    with pytest.raises(BagError, match='no poses at the stamps'):
        choose(records, [rows[0], (26.5, 3.2, 0)])


def test_stamps_of_a_trajectory_may_be_rounded(choose, scans):
    """By float64 to 100 ns, by a printf to milliseconds: first and last scan are placed."""
    for first, last in (('20.0000001', '20.6999999'), ('20.0004', '20.6995')):
        _, placed, said = choose(scans(), [(first, 0, 0), (last, 1, 0)])
        assert '100 % of 8 scans' in said[0]
        assert (placed[0].pose.x_m, placed[-1].pose.x_m) == (0.0, 1.0)
    assert len(choose(scans(), [(20.002, 0, 0), (20.7, 1, 0)])[1]) == 7


def test_standard_deviations_beside_a_trajectory_are_covariances(choose, scans):
    """Variances go straight between poses, also where odometry fills in; ends are held."""
    rows, spreads = [(20.0, 0, 0), (20.7, 0.7, 0)], [(0.1, 0.3, 0.2), (0.2, 0.3, 0.0)]
    every = np.stack([np.linspace(0.01, 0.04, 8), np.full(8, 0.09), np.linspace(0.04, 0.0, 8)])
    moved = wheels([(0.01 * k * k,) for k in range(8)])
    for records in (scans(), [*scans(), *moved]):
        _, placed, said = choose(records, rows, spreads)
        told = np.array([np.diag(one.belief.covariance) for one in placed])
        assert told == pytest.approx(every.T)
        assert 'standard deviations of its poses from poses_deviations.csv' in said
        for unread in ({'beliefs': False}, {'deviations': False}):
            _, placed, said = choose(records, rows, spreads, **unread)
            assert {one.belief.covariance for one in placed} == {None}
            assert 'standard' not in str(said)
    held = scans([STAMPS[0] - 500_000, STAMPS[-1] + 500_000])
    _, placed, _ = choose(held, rows, spreads)
    assert [one.belief.covariance[0, 0] for one in placed] == pytest.approx([0.01, 0.04])
    with pytest.raises(
        PoseError, match=r'deviations of 1 pose: expected those of 2 in .*poses.tum'
    ):
        choose(scans(), rows, spreads[:1])
