"""Ways that are asked of: what a product of cells says, and what is counted as known."""

import numpy as np
import pytest
from support.naive_collision import met

from ogm_mcmc.geometry import GridMap, GridSpec, SampleBits
from ogm_mcmc.lab.experiments import collisions
from ogm_mcmc.lab.experiments.localization_maps import Maps

SPEC = GridSpec(0.1, 12, 9, column0=3, row0=-2)


def test_a_product_takes_every_cell_of_the_way_for_a_chance_of_its_own():
    rng = np.random.default_rng(2)
    probability = rng.random((9, 12)).astype(np.float32)
    probability[rng.random((9, 12)) < 0.2] = np.nan
    way = np.array([(0.9, 0.15), (1.7, 0.33)])  # leaves the map on its right
    cells = met(*(tuple(place) for place in SPEC.in_cells(way)), 2.0, (9, 12))
    chances = [probability[j, i] if 0 <= j < 9 and 0 <= i < 12 else np.nan for j, i in cells]
    clear = np.prod([1.0 - (0.3 if np.isnan(p) else float(p)) for p in chances])
    found = collisions.product_risk(GridMap(SPEC, probability), way, 0.2, 0.3)
    assert found == pytest.approx(1.0 - clear, rel=1e-6)


def test_what_is_said_is_compared_with_the_building(monkeypatch):
    """Samples that are the truth, known all over, say what is; half a map says so of that half."""
    world = collisions.generate_floor(9, 3)
    cells = world.occupied[np.newaxis]
    known = np.ones(world.occupied.shape, bool)
    bits = SampleBits.of_maps(world.spec, cells, known)
    monkeypatch.setattr(collisions, 'WAYS', 100)
    monkeypatch.setattr(collisions, 'log_of', lambda *_: _Log())
    monkeypatch.setattr(collisions, 'some_beams', lambda *_: [])

    def taken(maps):
        monkeypatch.setattr(collisions, 'maps_of', lambda *_: maps)
        return collisions.score(9, 1, 3)

    truth = world.truth()
    exact = taken(Maps(truth, truth, bits, 0.3))
    assert exact['all'] == exact['known'] == exact['product']
    assert exact['all']['error'] == 0.0
    assert exact['unknown']['ways'] == 0
    known[:, 250:] = False
    half = GridMap(world.spec, np.where(known, truth.probability, np.float32(np.nan)))
    left = taken(Maps(half, half, bits.known_in(half), 0.3))
    assert left['known']['error'] == 0.0
    assert left['known']['ways'] + left['unknown']['ways'] == 100
    assert left['unknown']['said'] < 1.0


class _Log:
    def placed(self, _):
        return []
