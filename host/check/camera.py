"""The camera of a machine at rest: does it deliver, the right way up, to a laptop that keeps up?"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from host.check.notes import Notes
from host.runs.drive import fits, fitted
from host.sensors.jpeg import JpegDecoder
from host.sensors.picture_watch import PictureWatch
from host.vision.mounted.detector import make_detector

PICTURE_S: Final = 6.0
"""Time in which a phone's stream must bring two pictures; connecting takes it 1 to 3 s."""
WATCH_S: Final = 2.5
"""How long pictures are counted."""
LEAST_RATE: Final = 5.0
"""Pictures a second: with fewer the machine drives 10 cm blindly at 0.5 m/s."""
SLOWEST_S: Final = 0.045
"""Processor time (s) for one picture, of the step's 50 ms."""
SURE: Final = 0.6
"""Least confidence (0..1) with which the detector sees the edge at a corner; by judgement."""
SURER: Final = 0.25
"""By so much confidence a turned picture must be clearer for the camera to count as turned."""


def camera(notes: Notes) -> bool:
    """Whether its pictures can be used while rolling."""
    hands = notes.hands
    taken: list[tuple[float, bytes | None, NDArray[np.uint8]]] = []
    decoder = JpegDecoder()
    shape: tuple[int, int] | None = None
    end = hands.clock() + PICTURE_S
    while len(taken) < 2 and hands.clock() < end:
        hands.pump(0.05)
        picture = hands.picture()
        if picture is not None:
            frame = fitted(picture, decoder, hands.mount, 0.0)
            shape = (frame.bgr.shape[1], frame.bgr.shape[0])
            if not fits(frame, hands.mount) and frame.bgr.size:
                return _wrong_size(notes, shape)
            taken.append((picture.stamp, picture.jpeg, frame.bgr))
    if len(taken) < 2:
        why = hands.camera_problem or "-"
        notes.skip("picture", "laptop")
        return notes.note("camera", "bad", "camera.none", why=why)
    begin = hands.clock()
    count, same = 0, 0
    while hands.clock() - begin < WATCH_S:
        hands.pump(0.03)
        picture = hands.picture()
        if picture is not None:
            count += 1
            same += picture.jpeg is not None and picture.jpeg == taken[-1][1]
            taken.append(
                (picture.stamp, picture.jpeg, fitted(picture, decoder, hands.mount, 0.0).bgr)
            )
    rate = count / WATCH_S
    if count in (0, same):
        notes.skip("picture", "laptop")
        return notes.note("camera", "bad", "camera.frozen")
    if rate < LEAST_RATE:
        notes.note("camera", "bad", "camera.slow", rate=round(rate, 1), least=LEAST_RATE)
    else:
        width, height = shape or (0, 0)
        notes.note("camera", "ok", "camera.ok", width=width, height=height, rate=round(rate, 1))
    frames = [bgr for _, _, bgr in taken if bgr.size][-12:]
    return _looks(notes, frames)


def _wrong_size(notes: Notes, shape: tuple[int, int]) -> bool:
    mount = notes.hands.mount
    sizes = {"width": shape[0], "height": shape[1]}
    wanted = {"wide": mount.width_px, "high": mount.height_px}
    notes.skip("picture", "laptop")
    if shape[0] < shape[1] and mount.width_px > mount.height_px:
        return notes.note("camera", "bad", "camera.upright", **sizes, **wanted)
    return notes.note("camera", "bad", "camera.size", **sizes, **wanted)


def _looks(notes: Notes, frames: list[NDArray[np.uint8]]) -> bool:
    hands = notes.hands
    watch = PictureWatch(hands.mount.width_px, hands.mount.height_px)
    problem = ""
    for bgr in frames[-4:]:
        problem = watch.problem(bgr)
    if problem and "repeats" not in problem:
        notes.skip("laptop")
        return notes.note("picture", "bad", "picture.bad", why=problem)
    clear = _confidence(notes, frames, lambda bgr: bgr)
    values = {"confidence": clear}
    if clear >= SURE:
        notes.note("picture", "ok", "picture.ok", **values)
    else:
        ways: dict[str, Callable[[NDArray[np.uint8]], NDArray[np.uint8]]] = {
            "picture.upside_down": lambda bgr: _u8(cv2.rotate(bgr, cv2.ROTATE_180)),
            "picture.mirrored": lambda bgr: _u8(cv2.flip(bgr, 1)),
            "picture.turned": lambda bgr: _quarter(bgr, cv2.ROTATE_90_CLOCKWISE),
            "picture.turned_left": lambda bgr: _quarter(bgr, cv2.ROTATE_90_COUNTERCLOCKWISE),
        }
        found = {name: _confidence(notes, frames, way) for name, way in ways.items()}
        best = max(found, key=lambda name: found[name])
        if found[best] > max(SURE, clear + SURER):
            notes.skip("laptop")
            return notes.note("picture", "bad", best.removesuffix("_left"), confidence=found[best])
        notes.note("picture", "bad", "picture.no_edge", **values)
    return _speed(notes, frames)


def _confidence(
    notes: Notes,
    frames: list[NDArray[np.uint8]],
    way: Callable[[NDArray[np.uint8]], NDArray[np.uint8]],
) -> float:
    hands = notes.hands
    detector = make_detector(hands.mode, hands.vehicle, hands.mount)
    sure = [detector.see(np.ascontiguousarray(way(bgr))).confidence for bgr in frames]
    return float(np.median(sure[len(sure) // 3 :]))


def _speed(notes: Notes, frames: list[NDArray[np.uint8]]) -> bool:
    hands = notes.hands
    detector = make_detector(hands.mode, hands.vehicle, hands.mount)
    took = []
    for bgr in frames:
        begin = hands.busy_s()
        detector.see(bgr)
        took.append(hands.busy_s() - begin)
    step = float(np.median(took))
    values = {"ms": round(step * 1e3, 1), "most": round(SLOWEST_S * 1e3)}
    notes.judge("laptop", step <= SLOWEST_S, "laptop.slow", **values)
    return True


def grey(bgr: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Of the same size."""
    return _u8(cv2.cvtColor(bgr, cv2.COLOR_BGR2GRAY))


def _u8(picture: object) -> NDArray[np.uint8]:
    return np.asarray(picture, np.uint8)


def _quarter(bgr: NDArray[np.uint8], way: int) -> NDArray[np.uint8]:
    """A picture turned by a quarter, its middle cut out to the old proportions and size."""
    height, width = bgr.shape[:2]
    turned = cv2.rotate(bgr, way)
    keep = round(turned.shape[1] * height / width)
    top = (turned.shape[0] - keep) // 2
    return _u8(cv2.resize(turned[top : top + keep], (width, height)))
