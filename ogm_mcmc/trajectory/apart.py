"""What poses leave open apart from where the map lies as a whole.

Design note. Averaged over all that poses leave open, a map is blurred by errors that every scan
shares. They move a map and blur nothing, and they may be large: the log of Intel says nothing of
how sure it is, so its poses are unsure by 16 cm together, and the live map of `pose_uncertain`
falls from 1.252 to -3.670 nats a held-out beam.
"""

from __future__ import annotations

import numpy as np

from ogm_mcmc.arrays import Float64Array

__all__ = ['moved_as_one', 'without_common_motion']


def without_common_motion(drawn: Float64Array, poses: Float64Array) -> Float64Array:
    """Return deviations (S, K, 3) of K poses (K, 3) without the shift and turn all have in common.

    That is the small rigid motion that fits the places of a draw best, of each draw its own.
    """
    swing = _swing(poses)
    left = drawn.copy()
    left[:, :, :2] -= left[:, :, :2].mean(axis=1, keepdims=True)
    lever = float((swing**2).sum())
    if lever > 0.0:
        turn = np.einsum('ki,ski->s', swing, left[:, :, :2]) / lever
    else:
        turn = left[:, :, 2].mean(axis=1)  # all poses at one place
    left[:, :, :2] -= turn[:, None, None] * swing
    left[:, :, 2] -= turn[:, None]
    return left


def moved_as_one(drawn: Float64Array, poses: Float64Array, motion: Float64Array) -> Float64Array:
    """Return deviations (K, 3) of poses (K, 3) whose common shift and turn are `motion` (3,).

    For poses that nothing but each other holds: what is solved for stops long before it has found
    a motion of all that so little holds. The turn is around the middle of the poses, m and rad.
    """
    left: Float64Array = without_common_motion(drawn[None], poses)[0]
    left[:, :2] += motion[:2] + motion[2] * _swing(poses)
    left[:, 2] += motion[2]
    return left


def _swing(poses: Float64Array) -> Float64Array:
    """Return how the places (K, 2) of poses move where all turn around their middle, m a rad."""
    from_middle = poses[:, :2] - poses[:, :2].mean(axis=0)
    return np.column_stack((-from_middle[:, 1], from_middle[:, 0]))
