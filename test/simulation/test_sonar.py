"""A ring of sonars in rooms: readings on paper, and maps from them."""

import json
import math

import numpy as np
import pytest
from support.pictures import read

from ogm_mcmc.config import MapperConfig, MountConfig
from ogm_mcmc.engine.placing import sensor_mount
from ogm_mcmc.errors import ConfigError
from ogm_mcmc.geometry import GridSpec, Pose2D
from ogm_mcmc.io.map_files import load_map
from ogm_mcmc.io.sonar_bag import write_sonar_recording
from ogm_mcmc.pipeline import MappingPipeline
from ogm_mcmc.simulation import Building, GridWorld, SonarRing, walk

approx = pytest.approx

# A room of 5 m x 4 m; off the borders of cells.
ROOM = np.array([(0, 0, 5, 0), (5, 0, 5, 4), (5, 4, 0, 4), (0, 4, 0, 0)], float) + 0.02
WAY = np.array([(1.0, 1.0), (4.0, 1.0), (4.0, 3.0), (1.0, 3.0), (1.2, 1.2)])
HALL = Building(ROOM, WAY)


def ring_readings(ring, seed=3):
    rng = np.random.default_rng(seed)
    poses = walk(WAY, period_s=0.2, speed_m_s=0.5, turn_rad_s=1.0)
    for k, robot in enumerate(poses):
        yield from ring.measure(HALL, robot, rng, 10**9 + k * 200_000_000)


def test_a_sonar_hears_the_nearest_wall_of_its_cone():
    """0.8 m from the mount to a wall seen at right angles, at the edge of a cone 0.6 rad wide."""
    wall = Building(np.array([(-9.0, 1.0, 9.0, 1.0)]), WAY)
    ring = SonarRing(sonars=1, radius_m=0.2, field_of_view_rad=0.6, noise_m=0.0, dropout=0.0)
    straight, askew, away = (
        next(ring.measure(wall, Pose2D(0, 0, yaw), np.random.default_rng(1))).scan
        for yaw in (math.pi / 2, math.pi / 2 - 0.5, -math.pi / 2)
    )
    assert straight.ranges_m[0] == approx(0.8, rel=1e-6)
    # The cone's edge points 0.2 rad off the normal.
    height = 1.0 - 0.2 * math.cos(0.5)
    assert askew.ranges_m[0] == approx(height / math.cos(0.2), rel=1e-6)
    assert away.ranges_m[0] == math.inf
    assert straight.beam_width_rad == 0.6


PILLAR = read("""
    #########
    #.......#
    #.......#
    #.....#.#
    #.......#
    #.......#
    #.......#
    #.......#
    #########
""")


@pytest.mark.parametrize(('resolution', 'column0', 'row0'), [(1.0, 0, 0), (0.1, 3, -2)])
def test_a_sonar_in_a_world_of_cells_on_paper(resolution, column0, row0):
    """Four sonars in the middle, 3.5 cells from the walls, and a pillar ahead on the left.

    Seen from there its lower corners are at (1.5, 0.5) and (2.5, 0.5).
    """
    world = GridWorld.checked(GridSpec(resolution, 9, 9, column0=column0, row0=row0), PILLAR == 1)

    def ranges(width, depth=0.0, yaw=0.0):
        ring = SonarRing(4, 0.0, field_of_view_rad=width, range_max_m=9.0 * resolution)
        robot = Pose2D((column0 + 4.5) * resolution, (row0 + 4.5) * resolution, yaw)
        return (ring.exact_ranges(world, robot, depth) / resolution).tolist()

    right, left = 2.0 * math.atan2(0.5, 2.5), 2.0 * math.atan2(0.5, 1.5)
    assert ranges(right - 1e-6) == approx([3.5, 3.5, 3.5, 3.5])
    # The border of the cone meets its lower side, and further to the left the wider it is.
    assert ranges(right + 1e-6) == approx([math.hypot(2.5, 0.5), 3.5, 3.5, 3.5], rel=1e-5)
    corner = math.hypot(1.5, 0.5)
    assert ranges(left + 1e-6) == approx([corner, 3.5, 3.5, 3.5])
    # Half way through the cell, straight on; the corner's beam leaves it again at its right side.
    assert ranges(0.2, depth=0.5) == approx([4.0, 4.0, 4.0, 4.0])
    assert ranges(0.7, depth=0.5)[0] == approx(0.5 * (1.0 + 2.5 / 1.5) * corner)
    # Turned so that the lower wall is at right angles to no beam of the cone any more.
    assert ranges(0.6, yaw=-0.5 * math.pi + 0.5)[0] == approx(3.5 / math.cos(0.2))


def test_a_sonar_behind_a_wall_is_pressed_into_it():
    """0.15 m to a wall of 0.1 m, and the ring is wider: it must not hear the next room."""
    cells = np.zeros((60, 60), np.uint8)
    cells[:, 30] = 1
    world = GridWorld.checked(GridSpec(0.1, 60, 60), cells)
    wall = Building(np.array([(3.0, 0.0, 3.0, 6.0)]), WAY)
    ring = SonarRing(sonars=4, radius_m=0.3, noise_m=0.0, dropout=0.0)
    for place in (world, wall):
        exact = ring.exact_ranges(place, Pose2D(2.85, 3.0), 0.0)
        assert exact[0] == 0.0
        # Those beside hear it at the edge of their cones.
        assert exact[[1, 3]] == approx(0.15 / math.sin(0.5 * ring.field_of_view_rad))
        assert exact[2] == math.inf
        first = next(ring.measure(place, Pose2D(2.85, 3.0), np.random.default_rng(1)))
        assert first.scan.ranges_m[0] == -math.inf


def test_noise_lost_echoes_and_limits_of_a_ring():
    """20 times 1000 sonars in a hall of 5 m x 4 m."""
    rng = np.random.default_rng(4)
    ring = SonarRing(sonars=1000, range_min_m=1.4, range_max_m=2.0, noise_m=0.03, dropout=0.1)
    exact = ring.exact_ranges(HALL, Pose2D(2.5, 2.0))
    measured = np.array(
        [
            [reading.scan.ranges_m[0] for reading in ring.measure(HALL, Pose2D(2.5, 2.0), rng)]
            for _ in range(20)
        ]
    )
    assert np.isnan(measured).mean() == approx(0.1, abs=0.01)
    echoes = np.isfinite(measured) & (exact > 1.6) & (exact < 1.8)
    errors = (measured - exact)[echoes]
    assert errors.size > 1500
    assert errors.std() == approx(0.03, rel=0.05)
    assert abs(errors.mean()) < 5.0 * 0.03 / math.sqrt(errors.size)
    assert np.isinf(measured[:, exact > 2.2]).sum() == (~np.isnan(measured[:, exact > 2.2])).sum()
    near = SonarRing(sonars=8, range_min_m=1.99, noise_m=0.0, dropout=0.0)
    got = [r.scan.ranges_m[0] for r in near.measure(HALL, Pose2D(2.5, 1.0), rng)]
    assert got[6] == -math.inf
    assert 2.2 < got[0] < 2.5


@pytest.mark.parametrize(
    ('wrong', 'reason'),
    [
        ({'sonars': 0}, 'sonars is 0'),
        ({'radius_m': -0.1}, 'ring_radius is -0.1'),
        ({'field_of_view_rad': math.pi}, 'field_of_view is 3.14'),
        ({'range_min_m': 4.0}, 'range_max is 4.0'),
        ({'range_max_m': math.inf}, 'range_max is inf'),
        ({'noise_m': -1.0}, 'noise is -1.0'),
        ({'noise_m': math.nan}, 'noise is nan'),
        ({'dropout': 1.0}, 'dropout is 1.0'),
        ({'clutter': -0.5}, 'clutter is -0.5'),
    ],
)
def test_what_is_no_ring_of_sonars(wrong, reason):
    with pytest.raises(ConfigError, match=reason):
        SonarRing(**wrong)


def test_the_depth_of_a_reflection_is_a_share():
    world = GridWorld.checked(GridSpec(1.0, 9, 9), PILLAR == 1)
    with pytest.raises(ConfigError, match=r'depth is 1\.5'):
        SonarRing().exact_ranges(world, Pose2D(1.5, 1.5), 1.5)


def test_mounts_as_a_parameter_are_the_mounts():
    ring = SonarRing(sonars=5)
    config = MountConfig(x=9.0, frames=ring.mounts_setting())
    for frame, pose in ring.mounts().items():
        found = sensor_mount(config, frame).pose
        assert (found.x_m, found.y_m, found.yaw_rad) == approx(
            (pose.x_m, pose.y_m, pose.yaw_rad), abs=1e-6
        )
    assert sensor_mount(config, 'laser').pose == Pose2D(9.0, 0.0, 0.0)


@pytest.mark.parametrize('frames', ['a 1 2', 'a 1 2 x', 'a 1 2 nan', 'a 1 2 3 4', 'a 1 2 3; b'])
def test_mounts_that_cannot_be_read(frames):
    with pytest.raises(ConfigError, match=r'mount\.frames is .*: expected FRAME X Y YAW'):
        MountConfig(frames=frames)


def assert_shows_the_room(grid_map):
    """The floor is free, the walls are occupied, and nothing behind them is known as free."""
    spec, probability = grid_map.spec, grid_map.probability

    def at(x, y):
        column, row = spec.cell_of(x, y)
        return probability[row, column]

    floor = [at(x, y) for x in np.arange(0.7, 4.4, 0.1) for y in np.arange(0.7, 3.4, 0.1)]
    assert np.mean(np.array(floor) < 0.2) > 0.99
    # Along the middle of each wall a sonar has looked straight at it.
    sides = [at(x, y) for x in np.arange(1.2, 4.0, 0.1) for y in (0.07, 4.07)]
    sides += [at(x, y) for x in (0.07, 5.07) for y in np.arange(1.2, 3.0, 0.1)]
    assert np.mean(np.array(sides) > 0.6) > 0.9
    assert not (probability[[0, -1]] < 0.5).any()
    assert not (probability[:, [0, -1]] < 0.5).any()


def test_a_ring_of_sonars_maps_a_room():
    ring = SonarRing()
    pipeline = MappingPipeline(MapperConfig(method='sonar', resolution=0.1))
    for placed in ring_readings(ring):
        pipeline.update(placed)
    assert_shows_the_room(pipeline.map())


def test_a_bag_of_ranges_maps_the_same_room(run_cli, tmp_path):
    ring = SonarRing()
    count = write_sonar_recording(tmp_path / 'bag', ring_readings(ring), ring.mounts())
    done = run_cli(
        *('map', 'bag', '-o', 'out', '--method', 'sonar', '--resolution', '0.1', '--json'),
        *('--mount.frames', ring.mounts_setting()),
    )
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert (result['scans'], result['scans_used']) == (count, count)
    assert result['scan_topic'] == '/range'
    with np.load(tmp_path / 'out' / 'map.npz') as data:
        probability = data['probability']
    trinary = load_map(tmp_path / 'out' / 'map.yaml')
    assert_shows_the_room(trinary._replace(probability=probability))
    laser = run_cli('map', 'bag', '-o', 'other')
    assert laser.returncode == 2
    assert 'no scans in it' in laser.stderr
