"""Which points are one body: DBSCAN, OPTICS, k-means, and two methods for range and azimuth (thesis, 6.2.2 and Fig. A.19)."""

from typing import TYPE_CHECKING

from radar_core.lazy import lazily

if TYPE_CHECKING:
    from radar_tracking.clustering.base import Clustering, ClusterPoints, seen_from
    from radar_tracking.clustering.choose import make_clustering
    from radar_tracking.clustering.config import ClusteringConfig
    from radar_tracking.clustering.density import cluster, dbscan
    from radar_tracking.clustering.large import thin
    from radar_tracking.clustering.lloyd import kmeans
    from radar_tracking.clustering.reachability import Optics, optics, split

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
__getattr__ = lazily(
    __name__,
    {
        "Clustering ClusterPoints seen_from": "base",
        "ClusteringConfig": "config",
        "make_clustering": "choose",
        "cluster dbscan": "density",
        "thin": "large",
        "kmeans": "lloyd",
        "Optics optics split": "reachability",
    },
)
