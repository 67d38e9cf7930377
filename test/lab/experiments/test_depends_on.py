"""What parts of experiments are kept by: a part made with other constants is made anew."""

import json
from pathlib import Path

import pytest

from ogm_mcmc.config.nodes import RefineSamplerConfig
from ogm_mcmc.lab.experiments import (
    collisions,
    contests,
    exploration,
    leaderboard,
    localization,
    refined_truth,
)

CONSTANTS = [
    (exploration, ['PLACES', 'BEAMS', 'PATIENCE_M', 'WORTHLESS_NATS', 'UNKNOWN', 'SETTLING']),
    (exploration, ['KEPT', 'BURN_IN', 'COUNTED']),
    (leaderboard, ['SWEEPS', 'BURN_IN', 'CHAINS_SAID', 'POINT_STEP_M', 'RUN', 'BEAMS', 'REACH_M']),
    (localization, ['LOST_M', 'LOST_RAD', 'OFF_M', 'OFF_RAD', 'FOUND_M', 'FOUND_RAD', 'TRIALS']),
    (localization, ['BURN_IN', 'SWEEPS_BETWEEN', 'MOST_SAMPLES', 'MOST_SCANS']),
    (collisions, ['WAYS', 'RADIUS_M', 'SHARE', 'LUMP_M2', 'CHAINS', 'BURN_IN', 'SWEEPS_BETWEEN']),
    (collisions, ['MOST_SAMPLES', 'MOST_SCANS']),
    (exploration, ['CHAINS']),
    (localization, ['CHAINS']),
    (refined_truth, ['MOST_SWEEPS', 'JUDGING_STEP', 'JUDGE', 'UNKNOWN']),
    (refined_truth, ['BUILDING_SEED', 'CELL_M', 'ROBOT_RADIUS_M']),
]


@pytest.mark.parametrize(('experiment', 'names'), CONSTANTS)
def test_constants_tell_parts_apart(experiment, names, tmp_path, monkeypatch):
    def asked(*_, depends_on, **__):
        raise RuntimeError(json.dumps(depends_on, sort_keys=True, allow_nan=False))

    def depends_on():
        with pytest.raises(RuntimeError) as caught:
            experiment.run(tmp_path, quick=True, seed=1)
        return str(caught.value)

    monkeypatch.setattr(experiment, 'run_all', asked)
    monkeypatch.setattr(contests.RecordedLog, 'path', lambda self: Path(self.file))
    before = depends_on()
    assert json.loads(before)['sampler']['patch.strength'] == RefineSamplerConfig().patch.strength
    for name in names:
        with monkeypatch.context() as changed:
            changed.setattr(experiment, name, 77)
            assert depends_on() != before, name
