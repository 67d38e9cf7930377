"""Clouds of weighted particles: what they say of a pose, and what is none."""

import math
from types import SimpleNamespace

import pytest

from ogm_mcmc.errors import PoseError
from ogm_mcmc.io.messages import read_particles


def weighted(*rows):
    """Make a nav2_msgs/ParticleCloud look-alike of (x, y, weight)."""
    return SimpleNamespace(
        particles=[
            SimpleNamespace(
                pose=SimpleNamespace(
                    position=SimpleNamespace(x=x, y=y, z=9.0),
                    orientation=SimpleNamespace(x=0.0, y=0.0, z=0.0, w=1.0),
                ),
                weight=weight,
            )
            for x, y, weight in rows
        ]
    )


def test_particle_cloud_keeps_its_weights():
    belief = read_particles(weighted((0.0, 0.0, 3.0), (4.0, 2.0, 1.0)))
    assert belief.particles.weights.tolist() == [0.75, 0.25]
    assert (belief.mean.x_m, belief.mean.y_m) == (1.0, 0.5)


@pytest.mark.parametrize('scale', [1e308, 5e-324])
def test_particle_weights_count_in_proportion(scale):
    belief = read_particles(weighted((0.0, 0.0, scale), (4.0, 2.0, scale)))
    assert belief.particles.weights.tolist() == [0.5, 0.5]


@pytest.mark.parametrize(
    'rows', [[], [(0, 0, 0.0)], [(0, 0, -1.0), (0, 1, 2.0)], [(0, 0, math.nan)]]
)
def test_particle_clouds_that_are_none(rows):
    with pytest.raises(PoseError, match=r'particles|weights'):
        read_particles(weighted(*rows))
