"""Points as CSV: what is read, and the line that is at fault."""

import math
from functools import partial

import numpy as np
import pytest

from ogm_mcmc.cli.evaluate_path import read_way
from ogm_mcmc.errors import PointsError
from ogm_mcmc.files.input_files import text_of
from ogm_mcmc.io.point_files import _probability, read_points, write_prediction


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
        b'"x (m)","y (m)"\n"1,5","-2,0"\n"3,00000", "4"\n',
        b"'1,5','-2'\n'3','4'\n",
        b'"1,5" "-2,0"\n3 4\n',
        b'x\ty\n1,5\t-2,0\n3\t4\n',
        b'why\tx\ty\tz\n\t1.5\t-2\t9\nbig door\t3\t4\t9\n',
        b'why,x,y\n"door, left",1.5,-2\n,3,4\n',
        'x;y\r\n1,5;-2\r\n3;4\r\n'.encode('utf-16'),
        b'\xfe\xff' + '1.5\t-2\n3\t4\n'.encode('utf-16-be'),
    ],
    ids=[
        *('bom', 'bom names', 'crlf', 'cr', ';', 'decimal comma', 'tab', 'quotes', 'remarks'),
        *('quoted commas', 'single quotes', 'blanks', 'tab commas', 'empty column'),
        *('quoted words', 'utf-16', 'utf-16 be'),
    ],
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
        'easting,northing,\n1,2,\n',
        'stamp,pose_x,pose_y\n9,1,2\n',
        'time,position_x,position_y,yaw\n9,1,2,0\n',
        'x,y,vel_x,vel_y\n1,2,3,4\n',
        'x [m] y [m]\n1 2\n',
        'x y (m)\n1 2\n',
        'x,y,2nd\n1,2,3\n',
        'x,y,-log p\n1,2,3\n',
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
        ('1,inf\n', 'line 1: 1, inf: expected finite numbers up to 1e\\+07 m'),
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
        ('stamp,x0,y0\n9,1,2\n', 'line 1: stamp x0 y0: expected one column x and one y'),
        (',easting,northing\n9,1,2\n', 'expected one column x and one y'),
        ('x,y,x\n1,2,3\n', 'expected one column x and one y'),
        ('pose_x,pose_y,twist_x,twist_y\n1,2,3,4\n', 'expected one column x and one y'),
        ('"1,500","2,500"\n', 'line 1: 1,500 2,500: expected x,y'),
        ('x;y\n1,5\n', 'line 2: 1,5: expected x,y'),
        ('x\ty\n1,5\n', 'line 2: 1,5: expected x,y'),
        ('x y\n1,2 0.3\n', 'line 2: 1 2 0.3: expected x,y'),
        ('"1,5\n', 'line 1: 1,5: expected x,y'),
        ('1' * 200_000 + ',2\n', 'expected lines x,y in m .field larger'),
    ],
)
def test_what_is_no_point_is_named(tmp_path, content, said):
    path = tmp_path / 'points.csv'
    path.write_bytes(content.encode('latin-1'))
    with pytest.raises(PointsError, match=said):
        read_points(path)
    with pytest.raises(PointsError):
        read_points(tmp_path)


def test_a_file_that_is_too_large_is_refused(tmp_path, monkeypatch):
    path = tmp_path / 'points.csv'
    path.write_text('1,2\n' * 6)
    for module in ('ogm_mcmc.io.point_files', 'ogm_mcmc.cli.evaluate_path'):
        monkeypatch.setattr(f'{module}.text_of', partial(text_of, most=20))
    for read in (read_points, read_way):
        with pytest.raises(PointsError, match='too large: expected at most 20 bytes'):
            read(path)


def test_a_way_may_have_decimal_commas(tmp_path):
    path = tmp_path / 'way.csv'
    path.write_text('x;y;yaw\n1,5;-2,5;0,1\n')
    assert read_way(path).tolist() == [[1.5, -2.5]]


def test_what_is_told_comes_back(tmp_path):
    path = tmp_path / 'told.csv'
    write_prediction(path, np.array([[0.1, -3.0]]), np.array([-80.0]), np.array([0.25]))
    table = np.genfromtxt(path, delimiter=',', names=True)
    told = [float(table[name]) for name in table.dtype.names]
    assert told == pytest.approx([0.1, -3.0, -80.0, 0.25, math.exp(-80.0)], rel=1e-8)
    assert (_probability(-800.0), _probability(0.0), _probability(800.0)) == (0.0, 0.5, 1.0)
