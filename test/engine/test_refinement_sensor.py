"""Twice as many scans are asked again what the sensor is like: what is indexed anew, and when."""

import weakref
from dataclasses import replace

import pytest
from support.refinements import FIRST, SECOND, THIRD, maps, run, scan_at, settings, taken

from ogm_mcmc.engine.sensor_fit import SensorNumbers
from ogm_mcmc.errors import WindowError
from ogm_mcmc.sampling.ray_filing import extended


def fitting(monkeypatch, **changes):
    """Let beams tell of this sensor from now on."""
    model = replace(settings().model, **changes)
    numbers = SensorNumbers(None, None, None)
    monkeypatch.setattr('ogm_mcmc.engine.beams_found.fit_sensor', lambda *args: (model, numbers))
    return model


def test_rays_stay_where_twice_as_many_scans_tell_of_nearly_the_same_sensor(monkeypatch):
    fitting(monkeypatch)
    refinement = taken(FIRST)
    window, told = refinement.window, refinement.beams.model
    close = {'sigma': 1.05 * told.sigma, 'clutter': 1.1 * told.clutter}
    fitting(monkeypatch, **close)
    refinement.take([FIRST, SECOND])
    assert refinement.window is window
    assert refinement.beams.model == told
    # These two are no longer asked before there are four.
    fitting(monkeypatch, sigma=0.9)
    refinement.take([FIRST, SECOND, THIRD])
    assert refinement.window is window
    refinement.take([FIRST, SECOND, THIRD, FIRST])
    assert refinement.window is not window
    assert refinement.window.model.sigma_m == 0.9
    other = fitting(monkeypatch, sigma=0.9, clutter=1.3 * told.clutter)
    refinement.take([FIRST, SECOND, THIRD, FIRST, *[SECOND] * 4])
    assert refinement.beams.model == other


def test_no_two_indices_are_held_where_a_recording_grew_and_tells_of_another_sensor(monkeypatch):
    fitting(monkeypatch)
    refinement = taken(FIRST)
    run(refinement, max_sweeps=20)
    before, rngs = maps(refinement), refinement.sampler.rngs
    rays, held = weakref.ref(refinement.window.index.rays), []

    def building(*args):
        held.append(rays() is not None)
        return extended(*args)

    monkeypatch.setattr('ogm_mcmc.sampling.ray_window.extended', building)
    fitting(monkeypatch, sigma=0.9)
    refinement.take([FIRST, SECOND])
    assert held == [False]
    assert refinement.sampler.rngs == rngs
    assert [one - two for one, two in zip(before, maps(refinement), strict=True)] == [set()] * 2


def test_no_room_for_a_recording_that_tells_of_another_sensor_changes_nothing(monkeypatch):
    far = scan_at(4000.0, 4000.0, 1.0, 2.0)
    fitting(monkeypatch)
    refinement = taken(FIRST, window={'max_memory_mb': 1.0})
    before = refinement.window, refinement.sampler, refinement.beams.model
    fitting(monkeypatch, sigma=0.9)
    with pytest.raises(WindowError, match='expected at most max_memory_mb = 1'):
        refinement.take([FIRST, far])
    assert (refinement.window, refinement.sampler, refinement.beams.model) == before


def test_beams_are_asked_again_when_they_would_have_been_without_an_interruption(
    monkeypatch, tmp_path
):
    """Two scans told of the sensor, so four are asked, though three were taken up."""

    def fit(scans, _):
        return replace(settings().model, clutter=0.02 * len(scans)), SensorNumbers(None, None)

    monkeypatch.setattr('ogm_mcmc.engine.beams_found.fit_sensor', fit)
    three = [FIRST, SECOND, THIRD]
    whole = taken(*three[:2])
    whole.take(three)
    whole.save(tmp_path / 'state')
    again = taken(*three)
    again.resume(tmp_path / 'state')
    for refinement in (whole, again):
        assert refinement.beams.model.clutter == 0.04
        refinement.take([*three, SECOND])
        assert refinement.window.model.clutter == 0.08
