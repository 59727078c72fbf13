"""Which points are one body: DBSCAN, OPTICS, k-means, and two methods that know how a radar sees (thesis, 6.2.2 and Fig. A.19)."""

from radar_tracking.clustering.base import Clustering, ClusteringConfig, ClusterPoints, seen_from
from radar_tracking.clustering.choose import make_clustering
from radar_tracking.clustering.density import cluster, dbscan, thin
from radar_tracking.clustering.lloyd import kmeans
from radar_tracking.clustering.optics import Optics, optics, split

__all__ = [
    "ClusterPoints",
    "Clustering",
    "ClusteringConfig",
    "Optics",
    "cluster",
    "dbscan",
    "kmeans",
    "make_clustering",
    "optics",
    "seen_from",
    "split",
    "thin",
]
