"""Kernels of the forward models; the equations are in `ForwardModel`.

model        `ForwardModel`
reading, reach, distance  m; reading inf: no return (any reading beyond the reach counts as
             one); distance inf: nothing on the ray. Strictly positive likelihoods, so finite.
"""

import math

from numba import njit

SQRT_2 = math.sqrt(2.0)
LOG_SQRT_2PI = 0.5 * math.log(2.0 * math.pi)

# A hit so many sigma away adds less than 1e-12 to any clutter that may be set.
FAR = 9.0

# Short returns come from at least so many m in front of the sensor: no room is no density.
NEAREST = 1e-9


@njit(cache=True, nogil=True)
def below(x):
    """Phi(x), the standard normal distribution function."""
    return 0.5 * math.erfc(-x / SQRT_2)


@njit(cache=True, nogil=True)
def background(model, reading, reach, distance):
    """p(z) without its hit: clutter, and short returns from in front of `distance`."""
    density = model.clutter / reach
    if model.short > 0.0 and reading <= distance:
        near = max(min(distance, reach), NEAREST)
        decay = model.short_decay
        density += model.short * decay * math.exp(-decay * reading) / -math.expm1(-decay * near)
    return density


@njit(cache=True, nogil=True)
def range_log_likelihood(model, reading, reach, distance):
    """Log p(z | first occupied cell at `distance`), nats."""
    sigma = model.sigma_m
    if model.is_gaussian:
        off = (min(reading, reach) - min(distance, reach)) / sigma
        return -0.5 * off * off - math.log(sigma) - LOG_SQRT_2PI
    if reading > reach:
        if distance == math.inf:
            return math.log(model.missing + model.hit)
        beyond = below((distance - reach) / sigma) / below(distance / sigma)
        return math.log(model.missing + model.hit * beyond)
    density = background(model, reading, reach, distance)
    off = (reading - distance) / sigma
    if abs(off) < FAR:
        peak = model.hit * math.exp(-0.5 * off * off - LOG_SQRT_2PI) / sigma
        density += peak if distance > FAR * sigma else peak / below(distance / sigma)
    return math.log(density)


@njit(cache=True, nogil=True)
def range_log_likelihoods(model, readings, reach, distances, log_p):
    """Fill log_p (N,) with the log-likelihood of each reading given each distance, nats."""
    for n in range(log_p.size):
        log_p[n] = range_log_likelihood(model, readings[n], reach, distances[n])


@njit(cache=True, nogil=True)
def unseen_log_likelihood(model, reading, reach, cut):
    """Log-likelihood given to "nothing up to `cut`", nats; nothing at all if that is the reach.

    Behind a cut the likelihood is taken as level: of `gaussian` at its value there, of `beam`
    at the background alone.
    """
    # reach / side of a cell * side of a cell may be a bit less than the reach.
    if cut >= reach * (1.0 - 1e-12):
        return range_log_likelihood(model, reading, reach, math.inf)
    if model.is_gaussian:
        return range_log_likelihood(model, reading, reach, cut)
    return math.log(background(model, reading, reach, cut))


@njit(cache=True, nogil=True)
def level_log_likelihood(model, reading, reach):
    """Return (level, near): the log-likelihood of every distance at least `near` from a reading.

    Without a return, of those at least `near` from the reach and in front of it. `near` is inf
    where there is no such level. Saves a logarithm for nearly all cells of a ray.
    """
    near = FAR * model.sigma_m
    if model.is_gaussian:
        return 0.0, math.inf
    if reading > reach:
        return math.log(model.missing), near
    if model.short > 0.0:
        return 0.0, math.inf
    return math.log(model.clutter / reach), near
