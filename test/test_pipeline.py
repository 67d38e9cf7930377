import contextlib
import itertools
import math

import numpy as np
import pytest
from support import pictures
from support.strategies import fan

from ogm_mcmc.config import (
    MapperConfig,
    OutputConfig,
    PoseUncertainConfig,
    StepModelConfig,
    settings_of,
)
from ogm_mcmc.engine.live_map import warm_up_mapping
from ogm_mcmc.engine.map_view import MAX_STALE_BOXES, MapView
from ogm_mcmc.errors import ConfigError, GridError
from ogm_mcmc.geometry import (
    CellBox,
    GridMap,
    GridSpec,
    PlacedScan,
    Pose2D,
    PoseBelief,
    Scan,
    SensorMount,
)
from ogm_mcmc.mapping import METHODS, ProbabilityBeams, live_settings
from ogm_mcmc.mapping.beam_evidence_kernels import sum_steps_per_beam
from ogm_mcmc.mapping.evidence_kernels import sum_per_scan
from ogm_mcmc.mapping.gaussian_field_kernels import take_in
from ogm_mcmc.mapping.quadtree_counting_kernels import count_seen
from ogm_mcmc.mapping.sonar_kernels import add_cone
from ogm_mcmc.mapping.two_assumption_kernels import fuse_per_beam, fuse_per_scan
from ogm_mcmc.pipeline import MappingPipeline

KINDS = [
    ('', OutputConfig()),
    ('', OutputConfig(output='trinary', occupied_thresh=0.7, free_thresh=0.3)),
    ('entropy', OutputConfig(output='probability')),
]
every_kind = pytest.mark.parametrize(('kind', 'output'), KINDS, ids=['percent', 'three', 'bits'])


def pipeline(**settings):
    return MappingPipeline(MapperConfig(**{'resolution': 0.1, **settings}))


def sweep(seed):
    """A scan all around."""
    rng = np.random.default_rng(seed)
    return fan(*rng.uniform(0.5, 4.0, 60), bearing=-3.1, increment=0.1)


def at(x, y, yaw=0.0):
    return PoseBelief(Pose2D(x, y, yaw))


def same_map(one, other):
    a, b = one.map(), other.map()
    return a.spec == b.spec and np.array_equal(a.probability, b.probability, equal_nan=True)


def whole(source, output, kind):
    """Render everything at once."""
    view = MapView(source, output, kind)
    view.refresh()
    return view.values


# -- MapView ----------------------------------------------------------------------------------


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


# -- MappingPipeline ----------------------------------------------------------------------------


def test_picture_of_a_scan():
    """Three beams of a robot that looks up: left, ahead and right."""
    source = pipeline(resolution=1.0)
    scan = fan(2.0, 3.0, 1.0, bearing=math.pi / 2, increment=-math.pi / 2)
    source.update(PlacedScan(scan, at(2.5, 0.5, math.pi / 2)))
    result = source.map()
    expected = """
        ??#?
        ??.?
        ??.?
        #..#
    """
    assert result.spec == GridSpec(1.0, 4, 4)
    drawn = pictures.draw(np.log(result.probability) - np.log1p(-result.probability))
    assert np.array_equal(pictures.read(drawn), pictures.read(expected))


def test_the_mount_carries_the_sensor():
    """Half a metre ahead of a robot that looks up, turned to the left."""
    mounted, direct = pipeline(), pipeline()
    mount = SensorMount(Pose2D(0.5, 0.2, 1.0))
    mounted.update(PlacedScan.on_robot(sweep(1), at(1.013, 2.017, math.pi / 2), mount))
    direct.update(PlacedScan(sweep(1), at(1.013 - 0.2, 2.017 + 0.5, math.pi / 2 + 1.0)))
    assert same_map(mounted, direct)


@pytest.mark.parametrize('upside_down', [True, False])
def test_an_upside_down_mount_negates_the_bearings(upside_down):
    scan = sweep(2)
    mirrored = Scan.checked(
        scan.ranges_m,
        angle_min_rad=-scan.angle_min_rad,
        angle_increment_rad=-scan.angle_increment_rad,
        range_min_m=scan.range_min_m,
        range_max_m=scan.range_max_m,
    )
    mounted, direct = pipeline(), pipeline()
    mount = SensorMount(upside_down=upside_down)
    mounted.update(PlacedScan.on_robot(scan, at(0.013, 0.017, 0.4), mount))
    direct.update(PlacedScan(mirrored if upside_down else scan, at(0.013, 0.017, 0.4)))
    assert same_map(mounted, direct)
    other = pipeline()
    other.update(PlacedScan(scan if upside_down else mirrored, at(0.013, 0.017, 0.4)))
    assert not same_map(mounted, other)


def test_map_is_cropped_to_the_measured_cells():
    source = pipeline()
    box = source.update(PlacedScan(sweep(1), at(7.013, -3.017)))
    result = source.map()
    assert isinstance(result, GridMap)
    assert result.spec.box == box
    assert np.isfinite(result.probability[[0, -1]]).any(axis=1).all()


def test_counts_and_changes_since_the_last_reset():
    source = pipeline()
    boxes = [source.update(PlacedScan(sweep(k), at(3.0 * k + 0.01, 0.02))) for k in range(3)]
    assert source.scans_used == 3
    assert source.changed == boxes[0].union(boxes[1]).union(boxes[2])
    source.reset()
    assert (source.scans_used, source.changed.empty) == (0, True)
    assert np.isnan(source.map().probability).all()


def test_a_refused_scan_is_not_counted():
    source = pipeline(max_cells=4096)
    source.update(PlacedScan(fan(1.0), at(0.05, 0.05)))
    before, changed = source.map(), source.changed
    with pytest.raises(GridError, match='max_cells'):
        source.update(PlacedScan(fan(1.0), at(100.0, 0.0)))
    assert (source.scans_used, source.changed) == (1, changed)
    assert np.array_equal(source.map().probability, before.probability)


# -- many scans at once -------------------------------------------------------------------------


@pytest.mark.parametrize('method', ['two_assumption', 'counting', 'pose_uncertain'])
def test_many_scans_at_once_make_the_map_of_one_after_the_other(method):
    """Also where one of them leads too far away; of uncertain poses all the doubt is used."""
    doubt = np.diag([0.01, 0.02, 0.003])
    places = [Pose2D(0.1 * k, 0.2) for k in range(5)]
    places.insert(2, Pose2D(1e5, 0.0))
    scans = [PlacedScan(sweep(k), PoseBelief(p, doubt)) for k, p in enumerate(places)]
    one, together = pipeline(method=method), pipeline(method=method)
    for scan in scans:
        with contextlib.suppress(GridError):
            one.update(scan)
    changed = together.update_all(scans)
    assert same_map(one, together)
    assert together.scans_used == one.scans_used == 5
    assert together.changed == one.changed == changed
    given_up = pipeline(method=method)
    given_up.update_all(scans, lambda: True)
    assert not np.isfinite(given_up.method.probabilities(given_up.method.spec.box)).any()
    assert given_up.scans_used == 0


@pytest.mark.parametrize('method', ['two_assumption', 'counting'])
def test_scans_that_were_added_before_it_was_cancelled_are_counted(method):
    scans = [PlacedScan(sweep(k), at(0.1 * k, 0.2)) for k in range(5)]
    one, cancelled = pipeline(method=method), pipeline(method=method)
    for scan in scans[:2]:
        one.update(scan)
    asked = iter((False, False, True))
    cancelled.update_all(scans, lambda: next(asked))
    assert cancelled.scans_used == 2
    box = cancelled.method.spec.box
    assert np.array_equal(
        one.method.probabilities(box), cancelled.method.probabilities(box), equal_nan=True
    )


# -- warm_up ------------------------------------------------------------------------------------

CONFIGS = [
    MapperConfig(
        method=method,
        inverse_model=model,
        fusion=fusion,
        resolution=resolution,
        no_return=no_return,
        max_range=max_range,
    )
    for method, model, fusion, resolution, no_return, max_range in itertools.product(
        sorted(METHODS),
        ('step', 'gaussian'),
        ('per_scan', 'per_beam'),
        (0.001, 0.05, 10.0),
        ('clear', 'ignore'),
        (0.0, 1e-3, 100.0),
    )
]


def test_warm_up_runs_for_every_configuration():
    assert min(warm_up_mapping(config) for config in CONFIGS) >= 1
    for method in METHODS:
        assert warm_up_mapping(MapperConfig(method=method, max_cells=4096)) > 1


@pytest.mark.jit
@pytest.mark.parametrize(
    ('method', 'fusion', 'kernel'),
    [
        ('two_assumption', 'per_scan', fuse_per_scan),
        ('two_assumption', 'per_beam', fuse_per_beam),
        ('pose_uncertain', 'per_scan', sum_per_scan),
        ('pose_uncertain', 'per_beam', sum_steps_per_beam),
        ('sonar', 'per_scan', add_cone),
        ('adaptive', 'per_scan', count_seen),
        ('random_field', 'per_scan', take_in),
    ],
)
def test_nothing_is_compiled_after_warm_up(method, fusion, kernel):
    config = MapperConfig(method=method, fusion=fusion)
    warm_up_mapping(config)
    compiled = kernel.signatures
    assert len(compiled) == 1
    belief = PoseBelief(Pose2D(1.013, 2.017), np.diag([0.01, 0.0, 0.001]))
    mount = SensorMount(Pose2D(0.1, 0.2, 0.3))
    MappingPipeline(config).update(PlacedScan.on_robot(sweep(1), belief, mount))
    assert kernel.signatures == compiled


@pytest.mark.parametrize('method', ['pose_uncertain', 'adaptive'])
def test_warm_up_weighs_poses_by_the_map(method, monkeypatch):
    weighed = []
    real = ProbabilityBeams.log_likelihoods

    def watched(self, poses, *beams):
        weighed.append(len(poses))
        return real(self, poses, *beams)

    monkeypatch.setattr(ProbabilityBeams, 'log_likelihoods', watched)
    warm_up_mapping(MapperConfig(method=method, pose_uncertain=PoseUncertainConfig(map_beams=5.0)))
    assert weighed == [100]


# -- settings that change while the map grows ---------------------------------------------------


def test_a_safe_change_counts_from_then_on():
    source = pipeline()
    source.update(PlacedScan(fan(1.0), at(0.05, 0.05)))
    changed = MapperConfig(resolution=0.1, step=StepModelConfig(l_occ=3.0), max_range=2.0)
    source.configure(changed)
    source.update(PlacedScan(fan(1.0), at(0.05, 0.05)))
    assert source.config == changed
    cell = CellBox(10, 0, 11, 1)
    assert source.method.log_odds(cell)[0, 0] == pytest.approx(1.3863 + 3.0)


@pytest.mark.parametrize(
    'change', [{'resolution': 0.2}, {'prior': 0.3}, {'method': 'sonar'}, {'max_cells': 10_000}]
)
def test_an_unsafe_change_is_refused_and_changes_nothing(change):
    source = pipeline()
    before = source.config
    with pytest.raises(ConfigError, match=f'^{next(iter(change))} is .* has it fixed or unused'):
        source.configure(MapperConfig(**{'resolution': 0.1, **change}))
    assert source.config == before


@pytest.mark.parametrize('method', sorted(METHODS))
def test_only_settings_that_the_method_uses_are_live(method):
    live = live_settings(method)
    assert live <= {leaf.name for leaf in settings_of(MapperConfig)}
    assert not live & {'method', 'resolution', 'prior', 'max_cells'}
    assert ('step.l_occ' in live) == (method not in ('counting', 'sonar'))


def test_a_setting_without_effect_is_refused():
    source = pipeline(method='counting')
    with pytest.raises(ConfigError, match=r'^step.l_occ is 3.0: method counting .* unused'):
        source.configure(
            MapperConfig(resolution=0.1, method='counting', step=StepModelConfig(l_occ=3.0))
        )
    source.configure(MapperConfig(resolution=0.1, method='counting', fusion='per_beam'))
    assert source.config.fusion == 'per_beam'
