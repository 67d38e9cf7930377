"""Quality of service, in one place."""

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from ogm_mcmc.io.bags import Offer

__all__ = [
    'LATCHED',
    'LATEST',
    'POSES',
    'QUESTIONS',
    'SENSOR',
    'TF',
    'TF_STATIC',
    'best_effort',
    'recorded_profile',
]


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

# Of what a recording does not say.
DEFAULT_DEPTH = 100


def recorded_profile(name: str, offer: Offer) -> QoSProfile:
    """Return the profile to publish a topic of a recording with: that of what offered it."""
    # Old recordings do not say what was latched; of these two everybody knows.
    latched = offer.latched or name.endswith(('/tf_static', '/map'))
    depth = offer.depth if offer.latched else DEFAULT_DEPTH
    best_effort = offer.best_effort and not latched
    if name.endswith('/tf_static'):
        depth = max(depth, DEFAULT_DEPTH)  # one publisher for the transforms of many
    return QoSProfile(
        depth=depth,
        reliability=(ReliabilityPolicy.BEST_EFFORT if best_effort else ReliabilityPolicy.RELIABLE),
        durability=(DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE),
    )
