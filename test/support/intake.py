"""An intake of scans in the test's own process."""

from ogm_mcmc.config import PlacingConfig
from ogm_mcmc.config.nodes import IntakeConfig
from ogm_mcmc.ros.scan_intake import ScanIntake
from support.local_ros import Logs, scan, transforms

__all__ = ['Bench']


class Bench:
    """An intake, what it placed, and what it logged."""

    def __init__(self, node, placing=None, **settings):
        self.logs = Logs(node)
        self.used = []
        settings = {'transform_timeout': 0.0, **settings}
        self.intake = ScanIntake(
            node, IntakeConfig(**settings), placing or PlacingConfig(), self.used.append
        )

    def scan(self, time_s, ranges=(1.0,), frame='laser', **fields):
        self.intake.on_scan(scan(time_s, ranges, frame, **fields))

    def tf(self, *entries):
        self.intake.tf.on_tf(transforms(*entries))

    def tf_static(self, *entries):
        self.intake.tf.on_tf_static(transforms(*entries))

    @property
    def where(self):
        """x, y, yaw of the sensor for each scan used."""
        poses = [placed.pose for placed in self.used]
        return [(one.x_m, one.y_m, one.yaw_rad) for one in poses]

    @property
    def problems(self):
        return dict(self.intake.problems.all())
