"""Where sensors stand to each other, from what they see of the same moving person or hand."""

from radar_lab.alignment.rigid import Rigid as Rigid
from radar_lab.alignment.rigid import RigidConfig as RigidConfig
from radar_lab.alignment.rigid import align_points as align_points
from radar_lab.alignment.solver import NotObservableError as NotObservableError
from radar_lab.alignment.trajectory import Trajectory as Trajectory
from radar_lab.alignment.trajectory import TrajectoryAlignment as TrajectoryAlignment
from radar_lab.alignment.trajectory import TrajectoryConfig as TrajectoryConfig
from radar_lab.alignment.trajectory_fit import align_trajectories as align_trajectories
