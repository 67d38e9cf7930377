"""Rays that are held are cast once, the others each time; all come in order."""

from support.strategies import fan

from ogm_mcmc.geometry import GridSpec, HeldRays, PlacedScan, Pose2D, cast_rays


def test_the_first_are_held_and_the_others_cast_again():
    spec, cast = GridSpec(0.1, 1, 1), []

    def one(scan, sensor):
        cast.append(sensor.x_m)
        return cast_rays(scan, sensor, spec)

    scans = [PlacedScan.at(fan(1.0, 2.0), Pose2D(float(x))) for x in range(5)]
    rays = HeldRays(scans, one, most=7)
    first, second = list(rays), list(rays)
    assert cast == [0.0, 1.0, 2.0, 3.0, 4.0, 3.0, 4.0]
    assert [one.column for one in first] == [one.column for one in second] == [0, 10, 20, 30, 40]
    assert [a is b for a, b in zip(first, second, strict=True)] == [True] * 3 + [False] * 2


def test_a_loop_that_ends_early_does_no_harm():
    spec = GridSpec(0.1, 1, 1)
    scans = [PlacedScan.at(fan(1.0), Pose2D(float(x))) for x in range(3)]
    rays = HeldRays(scans, lambda scan, sensor: cast_rays(scan, sensor, spec))
    next(iter(rays))
    assert [one.column for one in rays] == [0, 10, 20]
