"""State estimation of tracks (thesis, figure A.21): Kalman filters linear, extended and unscented, IMM, MMAE and MMVelEst."""

from typing import TYPE_CHECKING

from radar_core.lazy import lazily

if TYPE_CHECKING:
    from radar_tracking.estimators.base import Belief, Estimator, Innovation, Measurement, VelocityMeasurement, join
    from radar_tracking.estimators.config import EstimatorConfig, SnapshotConfig
    from radar_tracking.estimators.make import make_estimator
    from radar_tracking.estimators.snapshot import Snapshot, SnapshotVelocity
    from radar_tracking.estimators.unbiased import from_polar

__all__ = [
    "Belief", "Estimator", "EstimatorConfig", "Innovation", "Measurement", "Snapshot", "SnapshotConfig", "SnapshotVelocity",
    "VelocityMeasurement", "from_polar", "join", "make_estimator",
]  # fmt: skip
__getattr__ = lazily(
    __name__,
    {
        "Belief Estimator Innovation Measurement VelocityMeasurement join": "base",
        "EstimatorConfig SnapshotConfig": "config",
        "make_estimator": "make",
        "Snapshot SnapshotVelocity": "snapshot",
        "from_polar": "unbiased",
    },
)
