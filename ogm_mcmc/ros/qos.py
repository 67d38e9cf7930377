"""Quality of service, in one place."""

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

__all__ = ['LATCHED', 'POSES', 'SENSOR']

# Fits publishers of either kind; a few scans deep, so that publishing a large map loses none.
SENSOR = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)

POSES = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE)

LATCHED = QoSProfile(
    depth=1,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
