"""Messages of maps that the package fills."""

from types import SimpleNamespace

from ogm_mcmc.geometry import CellBox, GridSpec
from ogm_mcmc.io.bags import typestore
from ogm_mcmc.io.messages import fill_grid_header, fill_grid_update


def empty(name):
    """Make a rosbags message whose numbers are all 77 and whose texts are 'old'."""
    kinds = typestore().fielddefs[name][1]
    values = []
    for _, (node, detail) in kinds:
        if node.name == 'NAME':
            values.append(empty(detail))
        elif node.name == 'BASE':
            values.append('old' if detail[0] == 'string' else 77)
        else:
            values.append(None)
    return typestore().types[name](*values)


def test_fill_grid_header():
    grid = empty('nav_msgs/msg/OccupancyGrid')
    spec = GridSpec(0.05, 30, 20, column0=-7, row0=3, anchor_x_m=0.1, anchor_y_m=-0.2)
    fill_grid_header(grid, spec, 'map', 1_134_864_629_895_182_001)
    assert grid.header.frame_id == 'map'
    for stamp in (grid.header.stamp, grid.info.map_load_time):
        assert (stamp.sec, stamp.nanosec) == (1_134_864_629, 895_182_001)
    assert (grid.info.resolution, grid.info.width, grid.info.height) == (0.05, 30, 20)
    origin = grid.info.origin
    assert (origin.position.x, origin.position.y) == (0.1 - 7 * 0.05, -0.2 + 3 * 0.05)
    assert origin.orientation.w == 1.0
    assert grid.data is None


def test_fill_grid_update():
    update = SimpleNamespace(header=empty('std_msgs/msg/Header'))
    spec = GridSpec(0.05, 30, 20, column0=-7, row0=3)
    fill_grid_update(update, spec, CellBox(-5, 4, 1, 14), 'map', 1_500_000_000)
    assert (update.header.frame_id, update.header.stamp.sec) == ('map', 1)
    assert update.header.stamp.nanosec == 500_000_000
    assert (update.x, update.y, update.width, update.height) == (2, 1, 6, 10)
