"""Sessions of the logger to samples that training reads; the samples themselves are made where those of recordings are."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Final

from radar_app.logger.event import LoggedEvent, read_event
from radar_app.logger.store import Session
from radar_core import GESTURES, OWN_GESTURE, DataError, PointCloud, RadarFrame
from radar_core.files import write_whole
from radar_lab.datasets.labelled import Moment
from radar_lab.datasets.samples import read_sample
from radar_lab.evaluation.scoring import TruthSegment

SUBJECTS: Final = "subjects.json"
"""Names of a data set's subjects and their numbers, in its folder; subjects that only have numbers are not in it."""

MakeMoment = Callable[[RadarFrame | PointCloud], Moment]
"""Makes what a data set keeps of one frame or cloud."""


def subject_numbers(folder: Path, names: Iterable[str]) -> dict[str, int]:
    """Give the subjects of a data set numbers, and write down the new ones: the same name has the same number in every session.

    Raises `DataError` when its list of subjects cannot be read or written.
    """
    path, known = folder / SUBJECTS, dict[str, int]()
    if path.exists():
        try:
            known = {str(name): int(number) for name, number in json.loads(path.read_text(encoding="utf-8")).items()}
        except (OSError, ValueError, AttributeError, TypeError) as error:
            raise DataError(f"{path}: cannot be read ({error}); it has to hold names and numbers, e.g. {{'anna': 0}}") from None
    new = [name for name in dict.fromkeys(names) if name not in known]
    if new:
        taken = {int(read_sample(sample)["subject"]) for sample in folder.glob("sample_*.npz")} | set(known.values())
        known |= {name: number for number, name in enumerate(new, max(taken, default=-1) + 1)}
        try:
            folder.mkdir(parents=True, exist_ok=True)
            write_whole(path, json.dumps(known, indent=1, ensure_ascii=False) + "\n")
        except OSError as error:
            raise DataError(f"{path}: cannot be written ({error.strerror}); name another folder") from None
    return known


def session_cuts(
    session: Session, subjects: Mapping[str, int], make: MakeMoment | None = None
) -> Iterator[tuple[TruthSegment, list[Moment]]]:
    """Give every labelled event of a session with its clouds, in the order of the labels.

    Parameters
    ----------
    session : Session
        As `read_session` gives it.
    subjects : mapping of str to int
        Numbers of the subjects; the session's own name stands for who was not named.
    make : callable or None
        Makes a moment of a raw frame; None: the clouds are taken as they were seen.

    Raises
    ------
    DataError
        When a file cannot be read, or ``make`` is given and raw frames were not kept.
    """
    for decision in session.labels:
        event = read_event(session.files[decision.event], raw=make is not None)
        person = subjects[subject_of(session, decision.subject)]
        own = "" if decision.gesture in GESTURES else decision.gesture
        number = OWN_GESTURE if own else GESTURES.index(decision.gesture)
        label = TruthSegment(person, number, event.start_ns, event.end_ns, own)
        if make is None:
            places = [{person: place} for place in event.position]
            yield label, [Moment(cloud, None, place) for cloud, place in zip(event.clouds, places, strict=True)]
        elif event.frames:
            yield label, _from_frames(event, person, make)
        else:
            raise DataError(f"{session.files[decision.event]}: holds no raw frames; leave --one-tx and --param out to take its clouds")


def subject_of(session: Session, name: str) -> str:
    """Name of who performed a gesture; the session's own name where nobody was named."""
    return name or session.folder.resolve().name


def _from_frames(event: LoggedEvent, person: int, make: MakeMoment) -> list[Moment]:
    """Make the moments of an event from its raw frames; a cloud's stamp is half the acquisition after its frame's."""
    half = event.info.waveform.acquisition_ns // 2
    known = {cloud.stamp_ns: {person: place} for cloud, place in zip(event.clouds, event.position, strict=True)}
    return [replace(make(frame), places=known.get(frame.stamp_ns + half, {})) for frame in event.frames]
