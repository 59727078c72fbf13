"""Stone Soup (dstl, MIT licence; ``pip install stonesoup``) as a peer: a tracker on the same clouds, its association and update timed."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from stonesoup.dataassociator.neighbour import GNNWith2DAssignment  # type: ignore[import-untyped]
from stonesoup.deleter.time import UpdateTimeDeleter  # type: ignore[import-untyped]
from stonesoup.hypothesiser.distance import DistanceHypothesiser  # type: ignore[import-untyped]
from stonesoup.initiator.simple import MultiMeasurementInitiator  # type: ignore[import-untyped]
from stonesoup.measures import Mahalanobis  # type: ignore[import-untyped]
from stonesoup.models.measurement.linear import LinearGaussian  # type: ignore[import-untyped]
from stonesoup.models.transition.linear import CombinedLinearGaussianTransitionModel, ConstantVelocity  # type: ignore[import-untyped]
from stonesoup.predictor.kalman import KalmanPredictor  # type: ignore[import-untyped]
from stonesoup.types.detection import Detection  # type: ignore[import-untyped]
from stonesoup.types.state import GaussianState  # type: ignore[import-untyped]
from stonesoup.types.track import Track as PeerTrack  # type: ignore[import-untyped]
from stonesoup.types.update import Update  # type: ignore[import-untyped]
from stonesoup.updater.kalman import KalmanUpdater  # type: ignore[import-untyped]

from benchmarks.report import choice, measure
from radar_core import DataError, PointCloud
from radar_core.config import config, knob
from radar_tracking import Track, Tracks, TrackStatus, dbscan
from radar_tracking.assignment import assign_tracks, mahalanobis
from radar_tracking.estimators import EstimatorConfig, make_estimator
from radar_tracking.estimators.base import Belief, Estimator, Measurement

Float64Array = NDArray[np.float64]
IndexArray = NDArray[np.int64]

_EPOCH = datetime(1970, 1, 1, tzinfo=UTC).replace(tzinfo=None)  # Stone Soup subtracts times without a zone
_HEIGHT, _HEIGHT_STD = 1.0, 0.5  # m: the peer tracks on the floor plane; our result wants a height too
_ORDER = np.array([0, 2, 1, 3])  # from (x, vx, y, vy), Stone Soup's, to (x, y, vx, vy)
N_TRACKS = 10
GATE = 4.0  # standard deviations
DT = 0.02  # s
_BATCH = 5


@config
class StoneSoupConfig:
    """Everything that `StoneSoupTracker` can be told; the defaults are those of our own tracker where it has the same knob."""

    eps: float = knob(0.4, unit="m", low=0.01, high=10.0, doc="DBSCAN: points this near are neighbours (floor plane)")
    min_points: int = knob(3, low=1, high=1000, doc="DBSCAN: neighbours of a core point, itself included")
    min_speed: float = knob(0.0, unit="m/s", low=0.0, high=10.0, doc="points slower than this radially are ignored")
    process_noise: float = knob(1.0, unit="m^2/s^3", low=1e-6, high=1e4, doc="spectral density of the acceleration")
    position_std: float = knob(0.1, unit="m", low=1e-3, high=10.0, doc="how far a cluster's centroid is from the body's centre")
    initial_speed_std: float = knob(1.0, unit="m/s", low=1e-3, high=100.0, doc="how fast a new track may move")
    gate: float = knob(GATE, low=0.5, high=100.0, doc="Mahalanobis distance up to which a detection may be a track's")
    confirm_updates: int = knob(10, low=1, high=1000, doc="updates after which a track is published: 0.2 s at 50 clouds a second")
    tentative_after: float = knob(0.15, unit="s", low=0.0, high=60.0, doc="an unpublished track unseen for longer is deleted")
    delete_after: float = knob(1.0, unit="s", low=0.0, high=600.0, doc="a published track unseen for longer is deleted")


@dataclass(frozen=True)
class Models:
    """What the parts of a Stone Soup tracker share; Stone Soup's classes have no types."""

    transition: Any
    sensor: Any
    predictor: Any
    updater: Any
    associator: Any


def models(process_noise: float, position_std: float, gate: float) -> Models:
    """Make a constant-velocity Kalman filter on (x, vx, y, vy) with a global nearest neighbour association by 2-D assignment."""
    axis = ConstantVelocity(process_noise)
    transition = CombinedLinearGaussianTransitionModel([axis, axis])
    sensor = LinearGaussian(ndim_state=4, mapping=(0, 2), noise_covar=np.eye(2) * position_std**2)
    predictor, updater = KalmanPredictor(transition), KalmanUpdater(sensor)
    hypothesiser = DistanceHypothesiser(predictor, updater, Mahalanobis(), missed_distance=gate)
    return Models(transition=transition, sensor=sensor, predictor=predictor, updater=updater, associator=GNNWith2DAssignment(hypothesiser))


class StoneSoupTracker:
    """Cluster first, track later, by Stone Soup: DBSCAN centroids, a Kalman filter, 2-D assignment, multi-measurement initiation."""

    def __init__(self, config: StoneSoupConfig | None = None) -> None:
        self.config = config if config is not None else StoneSoupConfig()
        self.reset()

    def reset(self) -> None:
        """Forget everything; ids start again."""
        knobs = self.config
        self._models = models(knobs.process_noise, knobs.position_std, knobs.gate)
        speed, place = knobs.initial_speed_std**2, knobs.position_std**2
        self._initiator = MultiMeasurementInitiator(
            prior_state=GaussianState(np.zeros((4, 1)), np.diag([place, speed, place, speed])),
            deleter=UpdateTimeDeleter(timedelta(seconds=knobs.tentative_after)),
            data_associator=self._models.associator,
            updater=self._models.updater,
            measurement_model=self._models.sensor,
            min_points=knobs.confirm_updates,
        )
        self._deleter = UpdateTimeDeleter(timedelta(seconds=knobs.delete_after))
        self._tracks: set[Any] = set()
        self._ids: dict[str, int] = {}

    def process(self, cloud: PointCloud) -> Tracks:
        """Take in a cloud in ``room``, not older than the one before; published tracks only, heights assumed, extents unknown."""
        if cloud.frame_id != "room":
            raise DataError(f"tracking needs clouds in 'room', this one is in {cloud.frame_id!r}; level it with PointCloud.to_room(mount)")
        now = moment(cloud.stamp_ns)
        labels = self._cluster(cloud)
        detections = set(self._detections(cloud, labels, now))
        used = set()
        for track, hypothesis in self._models.associator.associate(self._tracks, detections, now).items():
            if hypothesis:
                track.append(self._models.updater.update(hypothesis))
                used.add(hypothesis.measurement)
            else:
                track.append(hypothesis.prediction)
        self._tracks -= self._deleter.delete_tracks(self._tracks, timestamp=now)
        self._tracks |= self._initiator.initiate(detections - used, now)
        return self._publish(cloud, labels, now)

    def _cluster(self, cloud: PointCloud) -> IndexArray:
        """Cluster of every point of the cloud; -1: noise, or not used."""
        labels = np.full(len(cloud), -1, np.int64)
        use = np.flatnonzero(np.isfinite(cloud.x) & np.isfinite(cloud.y) & ~(np.abs(cloud.radial_speed) < self.config.min_speed))
        points = np.stack([cloud.x[use], cloud.y[use]], axis=-1).astype(np.float64)
        labels[use] = dbscan(points, self.config.eps, self.config.min_points)
        return labels

    def _detections(self, cloud: PointCloud, labels: IndexArray, now: datetime) -> list[Any]:
        """Centroids of the clusters, weighted by amplitude (thesis, 6.2.2)."""
        amplitude = 10 ** (np.nan_to_num(cloud.snr.astype(np.float64)) / 20)
        found = []
        for label in range(int(labels.max(initial=-1)) + 1):
            own = labels == label
            place = [np.average(axis[own], weights=amplitude[own]) for axis in (cloud.x, cloud.y)]
            found.append(Detection(np.array(place)[:, None], now, measurement_model=self._models.sensor, metadata={"cluster": label}))
        return found

    def _publish(self, cloud: PointCloud, labels: IndexArray, now: datetime) -> Tracks:
        """Say it in our words; a track's number is its place in the order of publication."""
        for track in sorted(self._tracks, key=lambda t: (t[0].timestamp, tuple(np.ravel(t[0].state_vector).tolist()))):
            self._ids.setdefault(track.id, len(self._ids) + 1)
        owner = np.full(len(cloud), -1, np.int32)
        published = []
        for track in sorted(self._tracks, key=lambda t: self._ids[t.id]):
            number = self._ids[track.id]
            updates = [state for state in track if isinstance(state, Update)]
            seen = bool(updates) and updates[-1] is track[-1] and track.timestamp == now
            if seen:
                owner[labels == track[-1].hypothesis.measurement.metadata["cluster"]] = number
            unseen = 0.0 if seen else (now - updates[-1].timestamp).total_seconds()
            age = (now - track[0].timestamp).total_seconds()
            published.append(_track(number, track.state, seen, (age, unseen), int((owner == number).sum())))
        return Tracks(cloud.stamp_ns, cloud.sequence, cloud.frame_id, tuple(published), owner, every=cloud.every)


def _track(number: int, state: Any, seen: bool, times: tuple[float, float], n_points: int) -> Track:
    """Make our track of a Stone Soup state; ``times``: age and time unseen [s]."""
    x, vx, y, vy = (float(value) for value in np.ravel(state.state_vector))
    covariance = np.diag([0.0, 0.0, _HEIGHT_STD**2, 0.0, 0.0, _HEIGHT_STD**2])
    plane = np.array([0, 3, 1, 4])
    covariance[np.ix_(plane, plane)] = np.asarray(state.covar, np.float64)
    return Track(
        id=number,
        status=TrackStatus.CONFIRMED if seen else TrackStatus.COASTING,
        age=times[0],
        unseen=times[1],
        n_points=n_points,
        position=np.array([x, y, _HEIGHT]),
        velocity=np.array([vx, vy, 0.0]),
        extent=np.full(3, np.nan),
        covariance=covariance,
    )


def moment(stamp_ns: int) -> datetime:
    """Stone Soup's clock, to the microsecond."""
    return _EPOCH + timedelta(microseconds=round(stamp_ns / 1000))


def drawn(seed: int, n_tracks: int = N_TRACKS) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Draw tracks (means, covariances) of (x, y, vx, vy) and detections of all of them in another order."""
    rng = np.random.default_rng(seed)
    grid = 1.5 * np.array([(i, j) for i in range(1, 5) for j in range(4)], np.float64)
    place = grid[rng.permutation(len(grid))[:n_tracks]] + rng.uniform(-0.3, 0.3, (n_tracks, 2))
    mean = np.concatenate([place, rng.normal(0, 1, (n_tracks, 2))], axis=1)
    spread = rng.normal(0, 0.05, (n_tracks, 4, 4))
    covariance = spread @ np.swapaxes(spread, 1, 2) + np.diag([0.01, 0.01, 0.1, 0.1])
    seen = place + DT * mean[:, 2:] + rng.normal(0, 0.1, (n_tracks, 2))
    return mean, covariance, seen[rng.permutation(n_tracks)]


def their_inputs(mean: Float64Array, covariance: Float64Array, seen: Float64Array) -> tuple[list[Any], list[Any]]:
    """Tracks and detections as Stone Soup wants them."""
    inverse = np.argsort(_ORDER, kind="stable")
    start, now = moment(0), moment(round(DT * 1e9))
    tracks = [
        PeerTrack([GaussianState(m[inverse][:, None], c[np.ix_(inverse, inverse)], timestamp=start)])
        for m, c in zip(mean, covariance, strict=True)
    ]
    return tracks, [Detection(place[:, None], now) for place in seen]


def their_step(parts: Models, tracks: list[Any], detections: list[Any]) -> list[Any]:
    """Predict, gate, assign and update by Stone Soup; the hypotheses, one per track."""
    found = parts.associator.associate(set(tracks), set(detections), moment(round(DT * 1e9)))
    for track, hypothesis in found.items():
        track.append(parts.updater.update(hypothesis) if hypothesis else hypothesis.prediction)
    return [found[track] for track in tracks]


def our_inputs(
    mean: Float64Array, covariance: Float64Array, seen: Float64Array, position_std: float, dimensions: int
) -> tuple[Belief, Measurement]:
    """Make the same tracks and detections as our estimators want them; in space all heights are equal."""
    n, d = len(mean), dimensions
    index = np.array([0, 1, d, d + 1])
    state, spread = np.zeros((n, 1, 2 * d)), np.tile(np.eye(2 * d), (n, 1, 1, 1))
    state[:, 0, index] = mean
    spread[:, 0, index[:, None], index] = covariance
    place = np.zeros((len(seen), d))
    place[:, :2] = seen
    noise = np.tile(np.eye(d) * position_std**2, (len(seen), 1, 1))
    unknown = np.full(len(seen), np.nan)
    return Belief(state, spread, np.ones((n, 1))), Measurement(place, noise, unknown, unknown, np.zeros((len(seen), d)))


def our_step(estimator: Estimator, belief: Belief, measurement: Measurement, gate: float = GATE) -> tuple[Belief, IndexArray]:
    """Predict, gate, assign and update by ours; belief and pairs of (track, detection)."""
    predicted = estimator.predict(belief, DT)
    mean, covariance = estimator.kinematics(predicted)
    d = estimator.dimensions
    cost = mahalanobis(mean[:, :d], covariance[:, :d, :d], measurement.position, measurement.covariance)
    pairs = assign_tracks(cost, gate)
    tracks, seen = pairs[:, 0], pairs[:, 1]
    updated, _ = estimator.update(predicted.select(tracks), measurement.select(seen))
    return predicted.put(tracks, updated), pairs


def our_estimator(dimensions: int) -> Estimator:
    """Our linear Kalman filter with the same noise as Stone Soup's."""
    return make_estimator(EstimatorConfig(), dimensions)


def over_stone_soup(quick: bool) -> dict[str, Any]:
    """Measure predict, associate and update of ten tracks with ten detections, always fresh ones, five steps of each in turn.

    ``over_stone_soup``: median of our steps in space over that of theirs on the floor plane; the same by our steps on the plane, and by our
    first of five, which run with cold caches; ``choices`` with the difference of means.
    """
    rounds = 2 if quick else 100
    knobs = StoneSoupConfig()
    parts = models(knobs.process_noise, knobs.position_std, knobs.gate)
    draws = [drawn(seed) for seed in range((rounds + 1) * _BATCH)]
    theirs = iter([their_inputs(*draw) for draw in draws])
    steps: dict[str, Callable[[], Any]] = {"Stone Soup": lambda: their_step(parts, *next(theirs))}
    for dimensions in (2, 3):
        inputs = iter([our_inputs(*draw, knobs.position_std, dimensions) for draw in draws])
        steps[f"ours, {dimensions}-D"] = partial(_next_step, our_estimator(dimensions), inputs, knobs.gate)
    times = _in_turn(steps, rounds)
    apart = max(difference(seed, parts, knobs) for seed in range(20))
    rows = [
        choice("predict, associate, update", name, accuracy=("means apart", apart, "m"), times_ms=spent, reference_ms=times["Stone Soup"])
        for name, spent in times.items()
    ]
    median = {name: float(np.median(spent)) for name, spent in times.items()}
    cold = float(np.median(times["ours, 3-D"][::_BATCH]))
    return {
        "over_stone_soup": median["ours, 3-D"] / median["Stone Soup"],
        "over_stone_soup_2d": median["ours, 2-D"] / median["Stone Soup"],
        "over_stone_soup_cold": cold / median["Stone Soup"],
        "stone_soup_step_ms": median["Stone Soup"],
        "our_step_ms": median["ours, 3-D"],
        "choices": rows,
    }


def _in_turn(steps: dict[str, Callable[[], Any]], rounds: int) -> dict[str, list[float]]:
    """Milliseconds of each step, in batches by turns; the first round is not counted."""
    times: dict[str, list[float]] = {name: [] for name in steps}
    for turn in range(rounds + 1):
        for name, step in steps.items():
            spent = measure(step, repeat=_BATCH, warmup=0)
            times[name] += spent if turn else []
    return times


def _next_step(estimator: Estimator, inputs: Iterator[tuple[Belief, Measurement]], gate: float) -> None:
    our_step(estimator, *next(inputs), gate)


def difference(seed: int, parts: Models, knobs: StoneSoupConfig) -> float:
    """Largest difference between the updated means of both, over our two and three dimensions [m, m/s]; infinite: other pairs."""
    draw = drawn(seed)
    tracks, detections = their_inputs(*draw)
    hypotheses = their_step(parts, tracks, detections)
    theirs = np.array([np.ravel(track.state_vector).astype(np.float64)[_ORDER] for track in tracks])
    chosen = [(row, detections.index(found.measurement)) for row, found in enumerate(hypotheses) if found]
    apart = 0.0
    for d in (2, 3):
        belief, pairs = our_step(our_estimator(d), *our_inputs(*draw, knobs.position_std, d), knobs.gate)
        if [tuple(pair) for pair in pairs.tolist()] != chosen:
            return np.inf
        apart = max(apart, float(np.abs(belief.mean[:, 0][:, [0, 1, d, d + 1]] - theirs).max()))
    return apart


run = over_stone_soup
