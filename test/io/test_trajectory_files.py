import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.strategies import REPEATABLE

from ogm_mcmc.errors import OutputError, PoseError
from ogm_mcmc.geometry import Pose2D
from ogm_mcmc.io.trajectory_files import read_trajectory, write_tum

approx = pytest.approx
NOW = 1_700_000_000_123_456_789
HALF = math.sqrt(0.5)

TUM = f"""# timestamp x y z qx qy qz qw
1700000000.123456789 1 2 0.5 0 0 {HALF} {HALF}

1700000001.5 3.25 -4 0 0 0 0 1
"""
EUROC = f"""#timestamp [ns], p_x [m], p_y, p_z, q_w [], q_x, q_y, q_z, v_x, v_y, v_z
{NOW},1,2,0.5,{HALF},0,0,{HALF},0.1,0.2,0.3
1700000001500000000,3.25,-4,0,1,0,0,0,0,0,0
"""
KITTI = '0 -1 0 1 1 0 0 2 0 0 1 0.5\n1 0 0 3.25 0 1 0 -4 0 0 1 0\n'
TIMES = '1700000000.123456789\n1700000001.5\n'
G2O = f"""FIX 7
VERTEX_SE2 9 3.25 -4 0
VERTEX_SE2 7 1 2 {math.pi / 2}
EDGE_SE2 7 9 1 0 0 1 0 0 1 0 1
"""
CSV = f"""stamp_ns,x_m,y_m,yaw_rad
{NOW},1,2,{math.pi / 2}
1700000001500000000,3.25,-4,0
"""
IDS = '7 1700000000.123456789\n8 1.0\n9 1700000001.5\n'


@pytest.fixture
def reading(tmp_path):
    def read(text, stamps=None):
        (tmp_path / 'poses.txt').write_text(text)
        beside = None
        if stamps is not None:
            beside = tmp_path / 'stamps.txt'
            beside.write_text(stamps)
        return read_trajectory(tmp_path / 'poses.txt', beside)

    return read


@pytest.mark.parametrize(
    ('kind', 'text', 'stamps'),
    [
        ('TUM', TUM, None),
        ('EuRoC', EUROC, None),
        ('KITTI', KITTI, TIMES),
        ('g2o', G2O, IDS),
        ('CSV', CSV, None),
    ],
)
def test_every_format_is_told_by_its_content(reading, kind, text, stamps):
    found = reading(text, stamps)
    assert found.format == kind
    assert found.stamps_ns.tolist() == [NOW, 1_700_000_001_500_000_000]
    first, second = found.poses
    assert (first.x_m, first.y_m, first.yaw_rad) == approx((1.0, 2.0, math.pi / 2))
    assert second == Pose2D(3.25, -4.0, 0.0)


LINE = '1 0 0 0 0 0 0 1\n'


@pytest.mark.parametrize(
    ('text', 'stamps', 'message'),
    [
        ('', None, 'poses.txt: no pose in it: expected TUM (8 numbers), KITTI'),
        ('# nothing\n', None, 'poses.txt: no pose in it'),
        ('1 2 3\n', None, 'poses.txt: line 1: 3 values: expected TUM (8 numbers)'),
        (LINE + '2 0 0 0 0 0 0\n', None, 'line 2: 7 values: expected 8'),
        (LINE + '2 0 O 0 0 0 0 1\n', None, "line 2: 'O': expected a finite number"),
        (LINE + '2 0 nan 0 0 0 0 1\n', None, "line 2: 'nan': expected a finite number"),
        (
            LINE + '2 1e300 0 0 0 0 0 1\n',
            None,
            'line 2: position (1e+300, 0): expected numbers up',
        ),
        (G2O.replace('9 3.25', '9 2e7'), IDS, 'line 2: position (2e+07, -4): expected numbers up'),
        ('-1 0 0 0 0 0 0 1\n', None, "line 1: stamp '-1': expected s from 0 on"),
        ('1e300 0 0 0 0 0 0 1\n', None, "line 1: stamp '1e300': expected s"),
        ('nan 0 0 0 0 0 0 1\n', None, "line 1: stamp 'nan': expected s"),
        ('1 0 0 0 0 0 0 2\n', None, 'line 1: quaternion (0.0, 0.0, 0.0, 2.0): expected unit'),
        ('1 0 0 0 1 0 0 0\n', None, 'line 1: pose is upside down'),
        (f'1 0 0 0 {HALF} 0 0 {HALF}\n', None, 'line 1: orientation is tilted by 90 degrees'),
        (
            f'#\n{LINE}{LINE}',
            None,
            'line 3: stamp 1.000000000 s is not later than 1.000000000 s in line 2',
        ),
        (TUM, TIMES, 'poses.txt: TUM has its own stamps: expected no file beside it'),
        (KITTI, None, 'poses.txt: KITTI keeps no stamps: expected a second file'),
        (KITTI, '1\n', 'stamps.txt: 1 stamps: expected 2, one a pose of'),
        (KITTI, '1\n1\n', 'poses.txt: line 2: stamp 1.000000000 s is not later'),
        (KITTI, '1 2\n3 4\n', 'stamps.txt: line 1: 2 values: expected 1'),
        ('2 0 0 0 0 2 0 0 0 0 2 0\n', '1\n', 'line 1: expected the matrix of a rotation'),
        ('0 0 1 0 0 1 0 0 -1 0 0 0\n', '1\n', 'line 1: orientation is tilted by 90 degrees'),
        (G2O, '7 1\n', 'stamps.txt: no stamp for id 9 of line 2 in'),
        (G2O, 'x 1\n', "stamps.txt: line 1: id 'x': expected a whole number"),
        ('FIX 7\n', IDS, 'poses.txt: no VERTEX_SE2 in it'),
        ('stamp_ns,x_m,y_m,yaw_rad\n', None, 'poses.txt: no pose in it: expected poses'),
        ('stamp_ns,x_m,y_m,yaw_rad\n1,2,3\n', None, 'line 2: 3 values: expected 4'),
        ('stamp_ns,x_m,y_m,yaw_rad\n1,2,3,inf\n', None, "line 2: 'inf': expected a finite"),
        ('stamp_ns,x_m,y_m,yaw_rad\n.,2,3,0\n', None, "line 2: stamp '.': expected ns from 0"),
        (CSV, TIMES, 'poses.txt: CSV has its own stamps: expected no file beside it'),
        ('VERTEX_SE3:QUAT 0 0 0 0 0 0 0 1\n', IDS, 'line 1: VERTEX_SE3: expected poses in the pl'),
    ],
)
def test_what_is_wrong_is_said_in_one_line(reading, text, stamps, message):
    with pytest.raises(PoseError) as caught:
        reading(text, stamps)
    assert message in str(caught.value)
    assert '\n' not in str(caught.value)


def test_files_that_cannot_be_read_or_written(tmp_path):
    with pytest.raises(PoseError, match='cannot be read'):
        read_trajectory(tmp_path / 'none.txt')
    (tmp_path / 'image.txt').write_bytes(b'\x89PNG\xff')
    with pytest.raises(PoseError, match='not a text file'):
        read_trajectory(tmp_path / 'image.txt')
    with pytest.raises(OutputError, match='cannot be written'):
        write_tum(tmp_path / 'no' / 'such.txt', [1], [Pose2D()])


coordinates = st.floats(-1e4, 1e4)
poses = st.builds(Pose2D, coordinates, coordinates, st.floats(-math.pi, 3.14159))


@REPEATABLE
@given(st.dictionaries(st.integers(0, 2**62), poses, min_size=1, max_size=8))
def test_what_is_written_is_read(tmp_path_factory, track):
    path = tmp_path_factory.mktemp('tum') / 'out.txt'
    stamps = sorted(track)
    write_tum(path, stamps, [track[stamp] for stamp in stamps])
    found = read_trajectory(path)
    assert found.stamps_ns.tolist() == stamps
    for stamp, pose in zip(stamps, found.poses, strict=True):
        assert (pose.x_m, pose.y_m) == (track[stamp].x_m, track[stamp].y_m)
        assert math.remainder(pose.yaw_rad - track[stamp].yaw_rad, 2 * math.pi) == approx(
            0.0, abs=1e-12
        )
    assert [entry.name for entry in path.parent.iterdir()] == ['out.txt']


@REPEATABLE
@given(st.data())
def test_a_damaged_file_is_read_or_refused_in_one_line(tmp_path_factory, data):
    folder = tmp_path_factory.mktemp('damaged')
    text, stamps = data.draw(
        st.sampled_from([(TUM, None), (EUROC, None), (KITTI, TIMES), (G2O, IDS)])
    )
    place = data.draw(st.integers(0, len(text) - 1))
    length = data.draw(st.integers(0, 12))
    inserted = data.draw(st.text('0123456789.,-e#naif \n\tVERTX_é', max_size=4))
    (folder / 'poses').write_text(text[:place] + inserted + text[place + length :])
    beside = None
    if stamps is not None:
        beside = folder / 'stamps'
        cut = data.draw(st.integers(0, len(stamps)))
        beside.write_text(stamps[:cut])
    try:
        found = read_trajectory(folder / 'poses', beside)
    except PoseError as refused:
        found, message = None, str(refused)
    if found is None:
        assert message.startswith(str(folder))
        assert '\n' not in message
        return
    assert len(found.poses) == found.stamps_ns.size > 0
    assert (np.diff(found.stamps_ns) > 0).all()
