"""What a graph gives of somebody who performs one gesture after the other, as it comes into the feed of a page."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from small_sets import stroke_clouds

from radar_app.view.feed import Feed
from radar_app.view.maps import event_maps
from radar_core import RadarInfo
from radar_lab.pipeline import Pipeline, PipelineConfig

S = 10**9
STEP = 0.02  # s
LONG = 3.2  # s, of one performance with the rest around it
SPEEDS = {"push": -1.5, "pull": 1.5}
BODY = 12  # of the points
SWAY = 0.25  # m/s: nobody stands as still as the body of these clouds, and who never moves is furniture


def clouds_of(gestures, start=0.0):
    """Clouds of somebody who performs these, each with a rest around it; in the sensor frame."""
    clouds = []
    for k, name in enumerate(gestures):
        for cloud in stroke_clouds(speed=SPEEDS[name], start=1.3, end=LONG):
            stamp = cloud.stamp_ns + round((start + LONG * k) * S)
            rate = cloud.radial_speed.copy()
            rate[:BODY] += np.float32(SWAY * np.sin(2.5e-9 * stamp))
            clouds.append(replace(cloud, stamp_ns=stamp, sequence=round(stamp / (STEP * S)), radial_speed=rate))
    return clouds


class Player:
    """Puts clouds, and what the library makes of them, into a feed."""

    def __init__(self, info=None):
        self.info, self.feed = info or RadarInfo(), Feed()
        self.feed.know(self.info)
        self.pipeline = Pipeline(self.info, PipelineConfig())

    def put(self, clouds, each=lambda cloud: None):
        """Put them in; ``each`` is told of every cloud first."""
        for cloud in clouds:
            each(cloud)
            result = self.pipeline.process_cloud(cloud)
            self.feed.put("clouds", cloud.stamp_ns, cloud.to_room(self.info.mount))
            self.feed.put("tracks", cloud.stamp_ns, result.tracks)
            for gesture in result.gestures:
                self.feed.put("gestures", gesture.stamp_ns, gesture)
                self.feed.put("maps", gesture.stamp_ns, event_maps(self.feed.history(), gesture))
