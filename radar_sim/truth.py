"""What the simulator knows to be true."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from radar_core import GESTURES, RadarFrame


@dataclass(frozen=True, eq=False)
class Truth:
    """State of every person when a frame's acquisition is half done, in ``room``; arrays have one entry (row) per person.

    Attributes
    ----------
    stamp_ns : int
        Middle of the acquisition, equal to the cloud's [ns].
    sequence : int
        Of the frame.
    frame_id : str
        Always ``room``.
    person_id : ndarray of uint32, shape (n_people,)
        Who.
    position, velocity : ndarray of float64, shape (n_people, 3)
        Centre of the body [m] and its motion [m/s].
    hand_position, hand_velocity : ndarray of float64, shape (n_people, 3)
        The acting hand [m], [m/s].
    gesture : ndarray of uint8, shape (n_people,)
        Index into ``labels`` while one is performed, else ``NO_GESTURE``.
    gesture_index : ndarray of uint32, shape (n_people,)
        Counts this person's scripted gestures.
    walking, drawing : ndarray of bool, shape (n_people,)
        What else the person does.
    gesture_start_ns, gesture_end_ns : ndarray of int64, shape (n_people,)
        First and last moment of the gesture being performed, 0 while there is none; empty: not known [ns].
    other_hand_position, other_hand_velocity : ndarray of float64, shape (n_people, 3)
        The hand that does not act; empty: not known [m], [m/s].
    scatterer_position : ndarray of float32, shape (n_scatterers, 3)
        What the radar sees: surface elements that face it and that nothing hides [m]; empty: not known.
    scatterer_owner : ndarray of int32, shape (n_scatterers,)
        Index into `person_id`; negative: a thing.
    scatterer_rcs : ndarray of float32, shape (n_scatterers,)
        Radar cross-section towards the radar [m^2].
    labels : tuple of str
        Names of the gestures by their numbers: the ten, then those of the scene's own strokes.
    """

    stamp_ns: int
    sequence: int
    frame_id: str
    person_id: NDArray[np.uint32]
    position: NDArray[np.float64]
    velocity: NDArray[np.float64]
    hand_position: NDArray[np.float64]
    hand_velocity: NDArray[np.float64]
    gesture: NDArray[np.uint8]
    gesture_index: NDArray[np.uint32]
    walking: NDArray[np.bool_]
    drawing: NDArray[np.bool_]
    gesture_start_ns: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, np.int64))
    gesture_end_ns: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, np.int64))
    other_hand_position: NDArray[np.float64] = field(default_factory=lambda: np.empty((0, 3)))
    other_hand_velocity: NDArray[np.float64] = field(default_factory=lambda: np.empty((0, 3)))
    scatterer_position: NDArray[np.float32] = field(default_factory=lambda: np.empty((0, 3), np.float32))
    scatterer_owner: NDArray[np.int32] = field(default_factory=lambda: np.empty(0, np.int32))
    scatterer_rcs: NDArray[np.float32] = field(default_factory=lambda: np.empty(0, np.float32))
    labels: tuple[str, ...] = GESTURES


@dataclass(frozen=True, eq=False)
class SimulatedFrame:
    """A raw frame and what is true in its middle."""

    frame: RadarFrame
    truth: Truth
