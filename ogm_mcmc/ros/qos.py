"""Quality of service, in one place."""

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

__all__ = ['LATCHED', 'POSES', 'SENSOR']

# Fits publishers of either kind; a second of scans deep, so that growing or saving a very large
# map loses none.
SENSOR = QoSProfile(depth=50, reliability=ReliabilityPolicy.BEST_EFFORT)

POSES = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE)

LATCHED = QoSProfile(
    depth=1,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
