"""From raw samples in a numpy array to points and people, without ROS.

python examples/numpy_cube.py            # a simulated recording
python examples/numpy_cube.py cube.npy   # your own: complex, axes (frame, transmitter, chirp, receiver, sample)
"""

import sys

import numpy as np

from radar_core import AntennaArray, Pose, RadarFrame, RadarInfo, Waveform
from radar_lab.pipeline import Pipeline

# Of your radar; these are the simulated radar's, at 77 GHz with two transmitters and four receivers.
WAVEFORM = Waveform()
ARRAY = AntennaArray()
MOUNT = Pose(z=1.2)  # m above the floor, looking straight ahead


def process(cube, waveform=WAVEFORM, array=ARRAY, mount=MOUNT):
    """Give points and tracks of every frame; ``cube`` is complex, axes (frame, transmitter, chirp, receiver, sample)."""
    info = RadarInfo(waveform=waveform, array=array, mount=mount)
    pipeline = Pipeline(info)
    for number, samples in enumerate(cube):
        stamp_ns = round(number * waveform.frame_interval * 1e9)
        frame = RadarFrame(samples.astype(np.complex64), stamp_ns, number, info.frame_id)
        result = pipeline.process(frame)
        yield result.cloud, result.tracks


def simulated(seconds=1.5):
    """Make a recording of one person who stands 2.3 m away and pushes at 2 s."""
    from radar_sim import Simulator, load_scene

    simulator = Simulator(load_scene("short"))
    first = round(1.5 / simulator.interval)
    return np.stack([simulator.process(first + k).frame.cube for k in range(round(seconds / simulator.interval))])


def main():
    """Print the points and people of every tenth frame."""
    cube = np.load(sys.argv[1]) if len(sys.argv) > 1 else simulated()
    for number, (cloud, tracks) in enumerate(process(cube)):
        if number % 10 == 0:
            people = ", ".join(f"person {t.id} at x {t.position[0]:.2f} m, y {t.position[1]:.2f} m" for t in tracks.people)
            print(f"frame {number}: {len(cloud.x)} points; {people or 'nobody'}")


if __name__ == "__main__":
    main()
