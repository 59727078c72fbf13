"""RGB-D frames of simulated people with known joints: to try the camera reference without a camera, and to measure how good it is."""

from __future__ import annotations

import colorsys
import dataclasses
import math
from collections.abc import Mapping
from functools import cached_property
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from radar_core import ConfigError
from radar_core.config import config, knob
from radar_core.types import Float32Array, Float64Array
from radar_lab.camera.pinhole import CameraModel, CameraMount
from radar_lab.camera.pose import RgbdFrame
from radar_sim.bodies.base import BONES, Pose
from radar_sim.bodies.make import Figure, make_figure
from radar_sim.bodies.skin import MeshBody, at
from radar_sim.scene import Scene
from radar_sim.world import World

_jit = numba.njit(cache=True, nogil=True)

JOINTS: Mapping[str, str] = {
    f"{side}_{joint}": f"{bone}_{side[0]}"
    for side in ("left", "right")
    for joint, bone in (("shoulder", "upperarm"), ("elbow", "lowerarm"), ("wrist", "hand"), ("hip", "thigh"))
}
"""Joints, and the bones that begin there; ``left_hand`` and ``right_hand`` are the middles of the hands."""
_HANDS = ("left_hand", "right_hand")
_SKIN, _SHIRT, _TROUSERS, _SHOES, _HAIR = (224, 172, 140), (70, 80, 110), (60, 60, 66), (45, 40, 38), (62, 44, 34)
_WALL, _FLOOR = (196, 194, 188), (150, 138, 122)
_SPAN = 1e-3  # s: poses are asked for at three times; only the middle one counts
_NEAR = 0.05  # m: triangles with a corner nearer than this are left out
_LIGHT = np.array([-0.5, 0.35, 0.8]) / np.sqrt(0.25 + 0.1225 + 0.64)  # in the room: from the front, above, a little left


@config
class SyntheticCameraConfig:
    """The camera, what the person wears, and what is wrong with the images."""

    camera: CameraModel = CameraModel()
    mount: CameraMount = CameraMount()
    markers: tuple[str, ...] = knob(("right_hand",), doc="joints that wear a coloured ball, e.g. right_hand, left_wrist")
    hues: tuple[float, ...] = knob((120.0,), unit="deg", low=0.0, high=360.0, doc="hue of each ball: 0 red, 120 green, 240 blue")
    radius: tuple[float, ...] = knob((0.05,), unit="m", low=0.005, high=0.3, doc="radius of the balls: one for all, or one for each")
    jitter: float = knob(
        0.0, unit="px", low=0.0, high=50.0, doc="balls are drawn beside the joint by this, in u and v: pixel noise of a known size"
    )
    noise_floor: float = knob(0.0, unit="m", low=0.0, high=1.0, doc="standard deviation of depth, the part that does not grow with depth")
    noise_growth: float = knob(0.0, unit="1/m", low=0.0, high=1.0, doc="the part that grows with the square of depth")
    correlation: float = knob(
        1.0, unit="px", low=1.0, high=20.0, doc="depth errors of pixels nearer than this hang together; 1: each its own"
    )
    colour_noise: float = knob(0.0, low=0.0, high=100.0, doc="standard deviation of red, green and blue, of 255")
    holes: float = knob(0.0, low=0.0, high=1.0, doc="share of the pixels without a depth")
    latency: float = knob(0.0, unit="s", low=-1.0, high=2.0, doc="an image is stamped this long after what it shows")
    wall: float = knob(4.5, unit="m", low=0.5, high=100.0, doc="x of the wall behind everything, in the room")
    millimetres: bool = knob(True, doc="depth in whole millimetres (16UC1); off: float metres (32FC1)")
    seed: int = knob(0, low=0, high=1 << 62, doc="of everything random")

    def validate(self) -> None:
        """Raise `ConfigError` when markers, hues and radii differ in number, or a joint does not exist."""
        n = len(self.markers)
        if len(self.hues) != n or len(self.radius) not in (1, n):
            raise ConfigError(
                f"SyntheticCameraConfig has {n} markers, {len(self.hues)} hues and {len(self.radius)} radii; give one of each"
            )
        unknown = [name for name in self.markers if name not in (*JOINTS, *_HANDS)]
        if unknown:
            raise ConfigError(
                f"SyntheticCameraConfig.markers: {', '.join(unknown)} is no joint; choose from {', '.join((*JOINTS, *_HANDS))}"
            )


class SyntheticCamera:
    """Take pictures of a scene's people; the first one wears the markers.

    Everybody is drawn as the mesh of `radar_sim`, whatever the scene says for the radar: motion and size are the same. Raises `ConfigError`
    when nobody is there who could wear the markers, or a script cannot be kept.
    """

    def __init__(self, scene: Scene, config: SyntheticCameraConfig | None = None) -> None:
        self.config = config or SyntheticCameraConfig()
        if self.config.markers and not scene.people:
            raise ConfigError("SyntheticCamera: nobody is in the scene to wear the markers; add a person, or leave markers empty")
        people = tuple(dataclasses.replace(person, body="mesh") for person in scene.people)
        self._world = World(dataclasses.replace(scene, people=people))
        self._figures: tuple[Figure, ...] = tuple(make_figure(person, scene.seed) for person in people)
        self._clothes = [_clothes(figure) for figure in self._figures]
        self._radii = np.broadcast_to(np.array(self.config.radius), len(self.config.markers))

    def joints(self, time: float) -> dict[str, Float64Array]:
        """Places of the first person's joints at a time of the scene [s], each of shape (3,), in ``room`` [m]."""
        return _joints(self._world.poses(time, _SPAN)[0])

    def process(self, time: float, sequence: int = 0) -> RgbdFrame:
        """Take one picture of what is seen at a time of the scene [s]: a function of config, ``time`` and ``sequence`` only.

        The stamp is later by the latency; the sequence also chooses the noise.
        """
        c = self.config
        rng = np.random.default_rng((c.seed, sequence))
        poses = self._world.poses(time, _SPAN)
        colour, depth = (image.copy() for image in self._room)
        for figure, clothes, pose in zip(self._figures, self._clothes, poses, strict=True):
            self._draw_person(figure, clothes, pose, colour, depth)
        for i, name in enumerate(c.markers):
            self._draw_marker(i, _joints(poses[0])[name], rng, colour, depth)
        if c.colour_noise:
            colour += rng.normal(0.0, c.colour_noise, colour.shape)
        stamp_ns = round((time + c.latency) * 1e9)
        return RgbdFrame(stamp_ns, sequence, np.clip(np.rint(colour), 0, 255).astype(np.uint8), self._measured(depth, rng))

    def _draw_person(self, figure: Figure, clothes: Float64Array, pose: Pose, colour: Float64Array, depth: Float64Array) -> None:
        assert isinstance(figure.body, MeshBody)
        vertices, faces = figure.body.vertices(at(pose, 1)), figure.body.subject.faces
        corner = vertices[faces]
        normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
        normal /= np.maximum(np.sqrt((normal**2).sum(-1, keepdims=True)), 1e-12)
        light = 0.55 + 0.45 * np.clip(normal @ (self.config.mount.rotation @ _LIGHT), 0.0, 1.0)
        draw_triangles(self.config.camera, self.config.mount.from_room(vertices), faces, clothes * light[:, None], colour, depth)

    def _draw_marker(self, i: int, place: Float64Array, rng: np.random.Generator, colour: Float64Array, depth: Float64Array) -> None:
        camera, mount = self.config.camera, self.config.mount
        centre = mount.from_room(place)
        if self.config.jitter:
            pixel = camera.project(centre) + rng.normal(0.0, self.config.jitter, 2)
            centre = camera.unproject(pixel, centre[2])
        radius = float(self._radii[i])
        if np.isfinite(centre).all() and centre[2] > 2 * radius:
            shade = 255.0 * np.array(colorsys.hsv_to_rgb(self.config.hues[i] / 360.0, 0.9, 0.95))
            u, v = camera.project(centre)
            reach = 3.0 * radius / (centre[2] - radius) * max(camera.fx, camera.fy)  # more than the outline at 60 degrees beside the view
            rows, columns = (slice(max(int(a - reach), 0), max(int(a + reach) + 2, 0)) for a in (v, u))
            draw_ball(self._rays[rows, columns], centre, radius, shade, colour[rows, columns], depth[rows, columns])

    @cached_property
    def _rays(self) -> Float64Array:
        """Direction of every pixel in the optical frame, shape (height, width, 3)."""
        camera = self.config.camera
        return camera.rays(np.stack(np.meshgrid(np.arange(camera.width), np.arange(camera.height)), -1))

    @cached_property
    def _room(self) -> tuple[Float64Array, Float64Array]:
        """Colour and depth of the empty room: a wall and the floor."""
        mount, ray = self.config.mount, self._rays
        towards = mount.to_room(ray) - mount.origin
        with np.errstate(divide="ignore", invalid="ignore"):
            wall = (self.config.wall - mount.x) / towards[..., 0]
            floor = -mount.z / towards[..., 2]
        wall, floor = (np.where(d > 0, d, np.inf) for d in (wall, floor))
        return np.where((floor < wall)[..., None], np.array(_FLOOR, np.float64), _WALL), np.minimum(wall, floor)

    def _measured(self, depth: Float64Array, rng: np.random.Generator) -> NDArray[np.uint16] | Float32Array:
        """Tell what the camera says of true depths: with noise and holes, in its own unit."""
        c = self.config
        sigma = c.noise_floor + c.noise_growth * np.where(np.isfinite(depth), depth, 0.0) ** 2
        if c.noise_floor or c.noise_growth:
            noise = rng.standard_normal(depth.shape)
            if c.correlation > 1.0:
                noise = ndimage.gaussian_filter(noise, c.correlation / 2, mode="wrap")
                noise /= noise.std()
            depth = depth + sigma * noise
        missing = ~np.isfinite(depth) | (depth <= 0)
        if c.holes:
            missing |= rng.random(depth.shape) < c.holes
        depth = np.where(missing, 0.0, depth)
        if c.millimetres:
            return np.clip(np.rint(depth * 1e3), 0, 65535).astype(np.uint16)
        return depth.astype(np.float32)


def _joints(pose: Pose) -> dict[str, Float64Array]:
    found = {name: pose.joint[1, BONES.index(bone)] for name, bone in JOINTS.items()}
    return found | {name: pose.hand[1, side] for side, name in enumerate(_HANDS)}


def _clothes(figure: Figure) -> Float64Array:
    """Colour of every face of a body, shape (n_face, 3): skin, shirt, trousers, shoes, hair."""
    assert isinstance(figure.body, MeshBody)
    subject = figure.body.subject
    main = subject.bone[np.arange(len(subject.bone)), subject.weight.argmax(1)]
    colours = np.tile(np.array(_SHIRT, np.float64), (len(BONES), 1))
    for prefixes, colour in ((("head", "neck", "hand"), _SKIN), (("pelvis", "thigh", "calf"), _TROUSERS), (("foot", "ball"), _SHOES)):
        colours[[i for i, bone in enumerate(BONES) if bone.startswith(prefixes)]] = colour
    shade = colours[main[subject.faces[:, 0]]]
    middle = subject.vertices[subject.faces].mean(1)
    crown = subject.stature * 0.94
    head = subject.joint[BONES.index("head")]
    hair = (main[subject.faces[:, 0]] == BONES.index("head")) & ((middle[:, 2] > crown) | (middle[:, 0] < head[0]))
    shade[hair] = _HAIR
    return np.asarray(shade)


def draw_triangles(
    camera: CameraModel, corner: Float64Array, faces: NDArray[np.int32], shade: Float64Array, colour: Float64Array, depth: Float64Array
) -> None:
    """Draw triangles into both images, the nearest in front.

    Parameters
    ----------
    camera : CameraModel
        Who looks.
    corner : ndarray, shape (n_corner, 3)
        In the optical frame [m].
    faces : ndarray of int32, shape (n_face, 3)
        Corners of each triangle, anticlockwise seen from outside; those that look away are left out.
    shade : ndarray, shape (n_face, 3)
        Red, green, blue, 0 to 255.
    colour, depth : ndarray, shapes (height, width, 3), (height, width)
        Are drawn into; depth in [m], infinity: nothing there yet.
    """
    pixel = camera.project(corner)
    usable = np.isfinite(pixel).all(-1) & (corner[:, 2] > _NEAR)
    a, b, c = (corner[faces[:, k]] for k in range(3))
    facing = (np.cross(b - a, c - a) * a).sum(-1) < 0
    kept = np.flatnonzero(facing & usable[faces].all(-1))
    _fill(pixel, corner[:, 2].copy(), faces[kept], shade[kept], colour, depth)


@_jit
def _fill(pixel: Any, z: Any, faces: Any, shade: Any, colour: Any, depth: Any) -> None:
    height, width = depth.shape
    for f in range(len(faces)):
        i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
        u0, v0, u1, v1, u2, v2 = pixel[i, 0], pixel[i, 1], pixel[j, 0], pixel[j, 1], pixel[k, 0], pixel[k, 1]
        area = (u1 - u0) * (v2 - v0) - (u2 - u0) * (v1 - v0)
        if abs(area) < 1e-12:
            continue
        left, right = max(0, math.ceil(min(u0, u1, u2))), min(width - 1, math.floor(max(u0, u1, u2)))
        top, bottom = max(0, math.ceil(min(v0, v1, v2))), min(height - 1, math.floor(max(v0, v1, v2)))
        for v in range(top, bottom + 1):
            for u in range(left, right + 1):
                w0 = ((u1 - u) * (v2 - v) - (u2 - u) * (v1 - v)) / area
                w1 = ((u2 - u) * (v0 - v) - (u0 - u) * (v2 - v)) / area
                w2 = 1.0 - w0 - w1
                if w0 < 0.0 or w1 < 0.0 or w2 < 0.0:
                    continue
                here = 1.0 / (w0 / z[i] + w1 / z[j] + w2 / z[k])  # 1 / depth is linear in the image, depth is not
                if here < depth[v, u]:
                    depth[v, u] = here
                    for channel in range(3):
                        colour[v, u, channel] = shade[f, channel]


def draw_ball(
    ray: Float64Array, centre: Float64Array, radius: float, shade: Float64Array, colour: Float64Array, depth: Float64Array
) -> None:
    """Draw a ball into both images.

    Parameters
    ----------
    ray : ndarray, shape (height, width, 3)
        Direction of every pixel in the optical frame, with z = 1.
    centre, radius : ndarray, shape (3,), and float
        In the optical frame [m].
    shade, colour, depth : ndarray, shapes (3,), (height, width, 3), (height, width)
        As in `draw_triangles`.
    """
    along = ray @ centre
    square = (ray**2).sum(-1)
    root = along**2 - square * (centre @ centre - radius**2)
    near = np.full(depth.shape, np.inf)
    hit = root >= 0
    near[hit] = (along[hit] - np.sqrt(root[hit])) / square[hit]
    front = hit & (near > _NEAR) & (near < depth)
    depth[front] = near[front]
    normal = (ray[front] * near[front][:, None] - centre) / radius
    light = 0.6 + 0.4 * np.clip(-normal[:, 2], 0.0, 1.0)
    colour[front] = shade * light[:, None]
