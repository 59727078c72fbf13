"""Where sensors stand to each other, from what they see of the same moving person or hand."""

from radar_lab.alignment.rigid import Rigid, RigidConfig, align_points
from radar_lab.alignment.solver import NotObservableError
from radar_lab.alignment.trajectory import Trajectory, TrajectoryAlignment, TrajectoryConfig
from radar_lab.alignment.trajectory_fit import align_trajectories

__all__ = [
    "NotObservableError",
    "Rigid",
    "RigidConfig",
    "Trajectory",
    "TrajectoryAlignment",
    "TrajectoryConfig",
    "align_points",
    "align_trajectories",
]
