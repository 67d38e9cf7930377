"""Shapes: a cell belongs to one if its centre does."""

import numpy as np
from support.pictures import read

from ogm_mcmc.simulation.drawing import Canvas


def same(canvas, picture):
    return np.array_equal(canvas.cells, read(picture) == 1)


def test_strokes_discs_and_boxes_on_paper():
    assert same(Canvas(5, 3).stroke((1.2, 1.5), (3.8, 1.5), 1.0), '.....\n.###.\n.....')
    assert same(Canvas(5, 5).disc((2.5, 2.5), 1.1), '.....\n..#..\n.###.\n..#..\n.....')
    assert same(Canvas(4, 3).box((2.0, 1.5), (2.0, 1.0), 0.0), '....\n.##.\n....')
    assert same(Canvas(3, 4).box((1.5, 2.0), (2.0, 1.0), np.pi / 2), '...\n.#.\n.#.\n...')


def test_turned_box_and_polygon_hold_the_centres_inside():
    rng = np.random.default_rng(2)
    for _ in range(20):
        centre, sides, angle = rng.uniform(5, 25, 2), rng.uniform(2, 14, 2), rng.uniform(0, 3)
        drawn = Canvas(30, 30).box(tuple(centre), tuple(sides), angle).cells
        half = sides / 2 * np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        assert np.array_equal(Canvas(30, 30).polygon(half @ turn.T + centre).cells, drawn)
        # A twin of few words: turn every centre back and look whether it is inside.
        rows, columns = np.indices((30, 30)) + 0.5
        back = (np.stack((columns, rows), axis=-1) - centre) @ turn
        assert np.array_equal((abs(back) <= sides / 2).all(axis=-1), drawn)


def test_touched_and_grown():
    canvas = Canvas(20, 10).disc((4.5, 5.5), 0.2)
    assert canvas.cells.sum() == canvas.cells[canvas.touched].sum() == 1
    assert canvas.grown(1.0).sum() == 5
    assert canvas.grown(1.5).sum() == 9
    # Off the canvas nothing is drawn, and nothing breaks.
    assert not Canvas(4, 4).disc((40.0, -7.0), 2.0).cells.any()
