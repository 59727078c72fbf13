"""Clustering of points into bodies: DBSCAN, OPTICS, k-means, and two methods for range and azimuth (thesis, 6.2.2 and Fig. A.19)."""

from typing import TYPE_CHECKING

from radar_core.lazy import lazily

if TYPE_CHECKING:
    from radar_tracking.clustering.base import ClusteringConfig, ClusterPoints, seen_from
    from radar_tracking.clustering.choose import Clustering
    from radar_tracking.clustering.density import cluster, dbscan, thin
    from radar_tracking.clustering.lloyd import kmeans
    from radar_tracking.clustering.reachability import Optics, optics, split

__all__ = [
    "ClusterPoints", "Clustering", "ClusteringConfig", "Optics", "cluster", "dbscan", "kmeans", "optics", "seen_from", "split", "thin",
]  # fmt: skip
__getattr__ = lazily(
    __name__,
    {
        "ClusteringConfig ClusterPoints seen_from": "base",
        "Clustering": "choose",
        "cluster dbscan thin": "density",
        "kmeans": "lloyd",
        "Optics optics split": "reachability",
    },
)
