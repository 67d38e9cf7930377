"""Quality of service, in one place."""

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

__all__ = ['LATCHED', 'LATEST', 'POSES', 'QUESTIONS', 'SENSOR', 'TF', 'TF_STATIC', 'best_effort']


def best_effort(depth: int) -> QoSProfile:
    """Return a profile that hears publishers of either kind."""
    return QoSProfile(depth=depth, reliability=ReliabilityPolicy.BEST_EFFORT)


# Fits publishers of either kind; a second of scans deep, so that growing or saving a very large
# map loses none.
SENSOR = best_effort(50)

POSES = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE)

# Only the newest counts, as of corrected trajectories.
LATEST = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE)

# Each has its answer.
QUESTIONS = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)

# As tf2 has them.
TF = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE)

TF_STATIC = QoSProfile(
    depth=100,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)

LATCHED = QoSProfile(
    depth=1,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
