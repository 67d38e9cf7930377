"""How far surfaces are off, by where beams that graze them meet the first solid cell."""

import math
from dataclasses import replace

import numpy as np
import pytest
from support.strategies import fan

from ogm_mcmc.config import ChainConfig, SamplerConfig, WindowConfig
from ogm_mcmc.config.nodes import NodeModelConfig
from ogm_mcmc.engine.beams_found import alike
from ogm_mcmc.engine.grazing import (
    ALIKE_M,
    HALF,
    SEEN_BEFORE,
    Grazing,
    _Misses,
    _misses,
    _spread,
    filled_in_part,
    grazing_of,
)
from ogm_mcmc.engine.range_spread import Spread
from ogm_mcmc.engine.refinement import Refinement
from ogm_mcmc.engine.sensor_fit import fit_sensor
from ogm_mcmc.errors import WindowError
from ogm_mcmc.geometry import CellBox, PlacedScan, Pose2D

CELL = 0.1


def told(found):
    """What counts of what was found where readings are sharp."""
    return Grazing.of(found, 1.0).used


def scans_beside(wall_m, count=60):
    """Scans along a wall on the left, that is met from square to grazing."""
    bearings = math.pi / 2.0 + math.radians(2.0) * np.arange(-40, 41)
    for number in range(count):
        y = wall_m - 0.6 - 0.017 * (number % 30)
        ranges = (wall_m - y) / np.sin(bearings)
        scan = fan(*ranges, bearing=bearings[0], increment=math.radians(2.0))
        yield PlacedScan.at(scan, Pose2D(0.013 * number, y))


def found(wall_m):
    """What beams say of a wall that makes the row of cells from 1.0 to 1.1 m solid."""
    hits, misses = np.zeros((2, 40, 200), np.int64)
    hits[10] = 5
    box = CellBox(-100, 0, 100, 40)
    return grazing_of(list(scans_beside(wall_m)), WindowConfig(CELL), hits, misses, box)


def test_a_wall_that_begins_with_its_cells_is_not_off_and_one_far_in_them_is():
    """Beams end where they enter the first cell, or far behind in the same row."""
    near, far = found(1.001), found(1.095)
    assert told(near) < 0.25 * told(far)
    # A median of distances that hardly differ is taken for that of a Gaussian.
    expected = 0.9 / HALF * CELL
    assert 0.8 * expected < told(far) < 1.05 * expected
    # It is one wall, some squares long, whose ends are grazed most.
    assert 0.6 * expected < far.low_95 < told(far) < far.high_95 < 1.5 * expected
    assert far.beams > 100


def test_codes_of_no_return_are_no_readings_of_a_wall():
    """Above the range's limit they say what +inf does, wherever solid cells are."""
    solid, box = np.ones((600, 600), np.bool_), CellBox(-300, -300, 300, 300)
    [wall] = scans_beside(1.07, count=1)

    def misses_of(code):
        ranges = np.where(np.arange(81) % 20 < 7, np.float32(code), wall.scan.ranges_m)
        placed = wall._replace(scan=replace(wall.scan, ranges_m=ranges))
        return [array.tolist() for array in _misses(placed, CELL, solid, box)]

    assert misses_of(20.5) == misses_of(math.inf)
    slants, _, places = misses_of(20.5)
    assert len(slants) > 20
    # Walls up to four m to either side lie in a few squares.
    assert 2 <= len(set(places)) <= 2 * (8.0 / ALIKE_M + 1)


def spread_of(slants, misses, places=None):
    """The spread of readings, each at a place of its own where none is named."""
    places = np.arange(len(slants)) if places is None else places
    return _spread(_Misses(slants, misses, places), CELL)


def test_medians_on_paper():
    slants, misses = np.array([0.1] * 101 + [2.0] * 401), np.zeros(502)
    misses[:101] = 0.2
    misses[101:] = np.linspace(-1.0, 1.0, 401) * 2.0
    one = spread_of(slants, misses)
    known = 401 / (401 + SEEN_BEFORE)
    across = math.sqrt(known * (1.0 - 0.2**2)) / HALF / 2.0
    assert one.mean == pytest.approx(CELL * across, rel=0.01)
    assert one.low_95 < one.mean < one.high_95
    off = 0.98 / math.sqrt(401)
    half, much = np.quantile(np.abs(misses[101:]), [0.5 - off, 0.5 + off])
    ends = np.sqrt(known * (np.array([half, much]) ** 2 - 0.2**2)) / HALF / 2.0 * CELL
    assert (one.low_95, one.high_95) == pytest.approx(ends, rel=0.01)
    assert told(one) == one.mean


def test_neighbours_on_a_wall_make_nothing_surer():
    """Twenty readings that err alike say as much as one of them, wherever in a scan they stand."""
    rng = np.random.default_rng(2)
    slants = np.array([0.1] * 40 + [2.0] * 80)
    misses = np.concatenate((np.full(40, 0.2), rng.normal(0.0, 1.5, 80)))
    alone = spread_of(slants, misses)
    places = np.tile(np.arange(120), 20)
    many = spread_of(np.tile(slants, 20), np.tile(misses, 20), places)
    more = math.sqrt((1600 / (1600 + SEEN_BEFORE)) / (80 / (80 + SEEN_BEFORE)))
    assert (many.mean, many.low_95, many.high_95) == pytest.approx(
        (alone.mean * more, alone.low_95 * more, alone.high_95 * more), rel=0.05
    )
    unfounded = spread_of(np.tile(slants, 20), np.tile(misses, 20))
    assert unfounded.high_95 - unfounded.low_95 < 0.4 * (many.high_95 - many.low_95)
    # And one wall, however long one looks at it, says nothing of others.
    assert told(spread_of(slants, misses, np.zeros(120, np.int64))) == 0.0


def test_intervals_hold_as_often_as_they_say():
    rng, held = np.random.default_rng(5), 0
    truth = CELL * math.sqrt(1.5**2 - 0.2**2) / 2.0
    for _ in range(100):
        places = np.repeat(np.arange(60), 8)
        walls = 1.5 * np.abs(rng.normal(size=60))
        misses = np.concatenate((np.full(480, 0.2 * HALF), np.repeat(walls, 8)))
        slants = np.repeat([0.1, 2.0], 480)
        one = spread_of(slants, misses, np.concatenate((places, places)))
        known = math.sqrt(480 / (480 + SEEN_BEFORE))
        held += one.low_95 <= truth * known <= one.high_95
    assert 88 <= held <= 99


def test_what_chance_may_have_made_and_what_nobody_met_do_not_count():
    slants, misses = np.array([0.1] * 9 + [2.0] * 9), np.full(18, 0.2)
    misses[14:] = 3.0
    few = spread_of(slants, misses)
    assert few.mean == few.low_95 == told(few) == 0.0
    assert few.high_95 > 0.0
    assert spread_of(np.zeros(0), np.zeros(0)) == Spread(0.0, None, 0, 0.0, 0.0)
    assert told(Spread(0.1, 0.1, 9, 0.0, 0.3)) == 0.0


def test_grazing_below_zero_is_found_where_readings_are_of_their_cells_and_a_number_holds():
    scans = list(scans_beside(1.07))
    window, given = WindowConfig(CELL), ChainConfig()
    model, numbers = fit_sensor(scans, SamplerConfig(NodeModelConfig(sigma=0.03), window, given))
    assert model.grazing == numbers.grazing.used == numbers.grazing.found.mean > 0.0
    assert numbers.sigma is None
    assert 'grazing 0.0' in str(numbers)
    between = SamplerConfig(NodeModelConfig(sigma=0.06), window, given)
    model, half = fit_sensor(scans, between)
    assert half.grazing.found == numbers.grazing.found
    assert model.grazing == half.grazing.used == pytest.approx(0.5 * half.grazing.found.mean)
    plain = half.as_dict()['grazing']
    assert list(plain) == ['mean', 'deviation', 'beams', 'low_95', 'high_95', 'used']
    assert plain['used'] == model.grazing
    assert Grazing.of_dict(plain) == half.grazing
    blurred = SamplerConfig(NodeModelConfig(sigma=0.09), window, given)
    model, numbers = fit_sensor(scans, blurred)
    assert (model.grazing, numbers.grazing) == (0.0, None)
    fixed = SamplerConfig(NodeModelConfig(sigma=0.03, grazing=0.05), window, given)
    assert fit_sensor(scans, fixed) == (fixed.model, None)


def test_what_counts_is_reported_and_why_not_all_does():
    found, doubtful = Spread(0.03, 0.005, 9, 0.02, 0.04), Spread(0.02, 0.01, 9, 0.0, 0.05)
    all_of_it, half, none = Grazing.of(found, 1.0), Grazing.of(found, 0.5), Grazing.of(doubtful, 1)
    assert (all_of_it.used, half.used, none.used) == (0.03, 0.015, 0.0)
    assert str(all_of_it) == '0.0300 m (0.0200 to 0.0400)'
    assert str(half) == (
        '0.0300 m (0.0200 to 0.0400), of which 0.0150 m counts, since sigma is above 0.5 cells'
    )
    assert str(none) == (
        '0.0200 m (0.0000 to 0.0500), found but not counted, since its interval begins at 0'
    )
    nothing = Grazing.of(Spread(0.0, None, 0, 0.0, 0.0), 1.0)
    assert (nothing.used, str(nothing)) == (0.0, '0.0000 m (not told)')


def test_models_are_alike_where_grazing_changes_by_less_than_matters():
    one = NodeModelConfig(sigma=0.03, grazing=0.02)
    assert alike(one, NodeModelConfig(sigma=0.031, grazing=0.021))
    assert not alike(one, NodeModelConfig(sigma=0.03, grazing=0.03))


def test_grazing_that_would_make_the_index_too_large_does_not_count():
    """Scans are kept by what they take without: what was kept can be sampled."""
    scans = list(scans_beside(1.095))

    def refinement(grazing, max_memory_mb=1.0):
        window = WindowConfig(CELL, max_memory_mb=max_memory_mb)
        model = NodeModelConfig(grazing=grazing)
        return Refinement(SamplerConfig(model, window, ChainConfig(chains=1)))

    roomy, narrow = refinement(-1.0, 10.0), refinement(-1.0)
    roomy.take(scans)
    assert roomy.beams.model.grazing > 0.0
    narrow.take(scans[:20])
    assert narrow.beams.model.grazing > 0.0
    narrow.take(scans)
    assert narrow.beams.model.grazing == narrow.beams.sensor.grazing.used == 0.0
    assert 'not counted, since the index would be too large' in str(narrow.beams.sensor)
    assert narrow.size.n_rays == roomy.size.n_rays
    asked = refinement(roomy.beams.model.grazing)
    with pytest.raises(WindowError, match='expected at most max_memory_mb = 1'):
        asked.take(scans)


def test_walls_fill_cells_in_part_unless_beams_say_that_they_do_not():
    def part(mean, low, readings, blur=0.0):
        return filled_in_part(Grazing.of(Spread(mean, 0.0, readings, low, mean), 1.0), blur, CELL)

    assert filled_in_part(None, 0.0, CELL) == 1.0  # nobody asked
    assert part(0.0, 0.0, 0) == 1.0  # nothing was told
    assert part(0.0, 0.0, 150) == pytest.approx(0.25)
    assert part(0.0, 0.0, 150, blur=0.7) == pytest.approx(0.7)
    assert part(0.02, 0.0, 150) == pytest.approx(0.25)  # chance may have made it
    assert part(0.5 * CELL / math.sqrt(12.0), 0.001, 150) == pytest.approx(0.25 + 0.75 * 0.5)
    assert part(0.04, 0.01, 150) == part(0.04, 0.01, 10**6) == 1.0
