"""What is shown of a map that grows: refreshed in part, always as if rendered whole."""

import math

import numpy as np
import pytest
from support.pipelines import at, pipeline, sweep
from support.strategies import fan

from ogm_mcmc.config import OutputConfig
from ogm_mcmc.engine.map_view import MAX_STALE_BOXES, MapView
from ogm_mcmc.geometry import CellBox, PlacedScan

KINDS = [
    ('', OutputConfig()),
    ('', OutputConfig(output='trinary', occupied_thresh=0.7, free_thresh=0.3)),
    ('entropy', OutputConfig(output='probability')),
]

every_kind = pytest.mark.parametrize(('kind', 'output'), KINDS, ids=['percent', 'three', 'bits'])


def whole(source, output, kind):
    """Render everything at once."""
    view = MapView(source, output, kind)
    view.refresh()
    return view.values


@every_kind
def test_refreshing_equals_rendering_everything(kind, output):
    """After updates in place, growth to every side, and several updates at once."""
    source = pipeline()
    view = MapView(source, output, kind)
    places = [(0, 0), (0.4, 0.2), (9, 0), (9, 1), (-9, -9), (3, 30), (60, 30), (0, 0)]
    specs = set()
    for k, (x, y) in enumerate(places):
        view.mark(source.update(PlacedScan(sweep(k), at(x + 0.013, y + 0.017, 0.3 * k))))
        if k % 3 != 1:
            view.refresh()
            specs.add(view.spec)
            assert view.values.dtype == np.int8
            assert np.array_equal(view.values, whole(source, output, kind))
    assert len(specs) > 3


@every_kind
def test_refresh_writes_only_the_box_it_returns(kind, output):
    source = pipeline()
    view = MapView(source, output, kind)
    view.mark(source.update(PlacedScan(sweep(1), at(0.013, 0.017))))
    view.refresh()
    view.values.fill(77)
    changed = source.update(PlacedScan(fan(1.0), at(0.513, 0.517)))
    view.mark(changed)
    (box,) = view.refresh()
    assert box == changed == CellBox(5, 5, 16, 6)
    written = view.values != 77
    assert written[view.spec.slices(box)].all()
    assert written.sum() == 11


def test_growth_copies_what_was_shown_and_is_unknown_elsewhere():
    source = pipeline()
    view = MapView(source, OutputConfig())
    view.mark(source.update(PlacedScan(sweep(1), at(0.013, 0.017))))
    view.refresh()
    before, shown = view.spec, view.values.copy()
    view.mark(source.update(PlacedScan(fan(1.0), at(50.05, 0.05))))
    view.refresh()
    assert view.spec != before
    assert np.array_equal(view.values[view.spec.slices(before.box)], shown)
    assert (view.values >= 0).sum() == (shown >= 0).sum() + 11


def test_changes_far_apart_do_not_cost_what_lies_between():
    source = pipeline()
    view = MapView(source, OutputConfig())
    view.mark(source.update(PlacedScan(fan(1.0), at(0.05, 0.05))))
    view.mark(source.update(PlacedScan(fan(1.0), at(200.05, 200.05))))
    view.mark(source.update(PlacedScan(fan(1.0), at(0.15, 0.05))))
    boxes = view.refresh()
    assert len(boxes) == 2
    assert sum(box.n_cells for box in boxes) == 12 + 11
    assert np.array_equal(view.values, whole(source, OutputConfig(), ''))


def test_many_changes_far_apart_are_all_shown():
    source = pipeline()
    view = MapView(source, OutputConfig())
    for k in range(40):
        view.mark(
            source.update(PlacedScan(fan(1.0), at(0.05 + 20.0 * (k % 7), 0.05 + 20.0 * (k // 7))))
        )
    assert len(view.refresh()) <= MAX_STALE_BOXES
    assert np.array_equal(view.values, whole(source, OutputConfig(), ''))


def test_stale_until_refreshed():
    source = pipeline()
    view = MapView(source, OutputConfig())
    assert view.stale
    view.refresh()
    assert not view.stale
    assert view.refresh() == []
    view.mark(source.update(PlacedScan(fan(math.nan), at(0.0, 0.0))))
    assert not view.stale
    view.mark(source.update(PlacedScan(fan(1.0), at(0.05, 0.05))))
    assert view.stale


def test_restart_after_a_reset():
    source = pipeline()
    view = MapView(source, OutputConfig())
    view.mark(source.update(PlacedScan(sweep(1), at(30.013, 0.017))))
    view.refresh()
    source.reset()
    view.restart()
    view.refresh()
    assert view.spec == source.method.spec
    assert (view.values == -1).all()


def test_another_output_shows_after_marking_all_that_ever_changed():
    source = pipeline()
    view = MapView(source, OutputConfig())
    for k in range(3):
        view.mark(source.update(PlacedScan(sweep(k), at(2.013 * k, 0.017))))
    view.refresh()
    view.output = OutputConfig(output='trinary')
    view.mark(source.changed)
    view.refresh()
    assert np.array_equal(view.values, whole(source, view.output, ''))
    assert set(np.unique(view.values)) == {-1, 0, 100}


@every_kind
def test_shown_values_on_paper(kind, output):
    """One hit and one miss at equal steps: 80, 20 and 50 per cent."""
    source = pipeline(resolution=1.0)
    box = source.update(PlacedScan(fan(2.0), at(0.5, 0.5))).union(
        source.update(PlacedScan(fan(3.0), at(0.5, 0.5)))
    )
    view = MapView(source, output, kind)
    view.refresh()
    expected = {
        # log-odds of -2, -2, 0 and +1 steps of log 4: 1/17, 1/17, 1/2, 4/5
        ('', 'probability'): [6, 6, 50, 80],
        ('', 'trinary'): [0, 0, -1, 100],
        ('entropy', 'probability'): [32, 32, 100, 72],
    }[kind, output.output]
    assert view.values[view.spec.slices(box)][0].tolist() == expected


def test_a_subclass_says_where_values_live():
    buffer = np.zeros(64 * 64, np.int8)

    class InMessage(MapView):
        def _allocate(self, spec):
            return buffer.reshape(spec.height, spec.width)

    source = pipeline()
    view = InMessage(source, OutputConfig())
    view.mark(source.update(PlacedScan(fan(1.0), at(0.05, 0.05))))
    view.refresh()
    assert np.shares_memory(view.values, buffer)
    assert (buffer >= 0).sum() == 11
