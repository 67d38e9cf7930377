"""Points as CSV: what is read, and the line that is at fault."""

import numpy as np
import pytest

from ogm_mcmc.errors import PointsError
from ogm_mcmc.io.point_files import read_points, write_prediction


def test_points_with_and_without_names_and_remarks(tmp_path):
    path = tmp_path / 'points.csv'
    path.write_text('x,y,why\n1.5,-2,door\n# a remark\n\n3 4\n')
    assert read_points(path).tolist() == [[1.5, -2.0], [3.0, 4.0]]


@pytest.mark.parametrize(
    'content',
    [
        b'\xef\xbb\xbf1.5,-2\n3,4\n',
        b'\xef\xbb\xbfx,y\n1.5,-2\n3,4\n',
        b'x,y\r\n1.5,-2\r\n3,4\r\n',
        b'x,y\r1.5,-2\r3,4\r',
        b'x;y\n1.5;-2\n3;4\n',
        b'x;y\n1,5;-2,0\n3,0;4\n;\n',
        b'x\ty\n1.5\t-2\n3\t4',
        b'"x","y"\n"1.5","-2"\n"3","4"\n,\n',
        b'# of a tape measure\n\nx,y\n1.5,-2\n3,4 # door\n',
    ],
    ids=['bom', 'bom names', 'crlf', 'cr', ';', 'decimal comma', 'tab', 'quotes', 'remarks'],
)
def test_what_tables_of_others_look_like(tmp_path, content):
    path = tmp_path / 'points.csv'
    path.write_bytes(content)
    assert read_points(path).tolist() == [[1.5, -2.0], [3.0, 4.0]]


@pytest.mark.parametrize(
    'content',
    [
        'id,x,y\n7,1,2\n',
        'y,x\n2,1\n',
        'stamp,pose.x,pose.y,pose.yaw\n9,1,2,0\n',
        ',Y [m],X [m]\n0,2,1\n',
        't y_m x_m\n5 2 1\n',
        'easting,northing\n1,2\n',
        'x,y,x\n1,2,3\n',
    ],
)
def test_columns_are_found_by_their_names(tmp_path, content):
    path = tmp_path / 'points.csv'
    path.write_text(content)
    assert read_points(path).tolist() == [[1.0, 2.0]]


@pytest.mark.parametrize(
    ('content', 'said'),
    [
        ('', 'no point: expected lines x,y'),
        ('x,y\n', 'no point'),
        ('1,2\n3\n', 'line 2: 3: expected x,y'),
        ('1,2\na,b\n', 'line 2: a b: expected x,y'),
        ('1,inf\n', 'line 1: 1, inf: expected finite numbers up to 1e\\+06 m'),
        ('1,nan\n', 'line 1: 1, nan: expected finite'),
        ('nan,1\n2,3\n', 'line 1: nan, 1: expected finite'),
        ('1,,2\n', 'line 1: 1  2: expected x,y'),
        ('id,x,y\n1,2\n', 'line 2: 1 2: expected x,y'),
        ('x,y\nx,y\n', 'line 2: x y: expected x,y'),
        ('1o,2\n3,4\n', 'line 1: 1o 2: expected x,y'),
        ('[1,2]\n', 'line 1: .1 2.: expected x,y'),
        ('1_0,2\n', 'line 1: 1_0 2: expected x,y'),
        ('1\x1b[2J,2\n', 'line 1: \\? 2: expected x,y'),
        ('1,2\xff\n', 'expected lines x,y'),
    ],
)
def test_what_is_no_point_is_named(tmp_path, content, said):
    path = tmp_path / 'points.csv'
    path.write_bytes(content.encode('latin-1'))
    with pytest.raises(PointsError, match=said):
        read_points(path)
    with pytest.raises(PointsError):
        read_points(tmp_path)


def test_what_is_told_comes_back(tmp_path):
    path = tmp_path / 'told.csv'
    write_prediction(path, np.array([[0.1, -3.0]]), np.array([-800.0]), np.array([0.25]))
    table = np.genfromtxt(path, delimiter=',', names=True)
    assert [float(table[name]) for name in table.dtype.names] == [0.1, -3.0, -800.0, 0.25, 0.0]
