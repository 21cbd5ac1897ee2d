"""What cameras, light and dust do to a picture, and other croppings of it: pictures to learn
confidence from, and to be judged on."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import cv2
import numpy as np
from numpy.typing import NDArray

from host.vision.photo.split import Side
from host.vision.pictures import Picture, u8

Standing = NDArray[np.bool_]
Values = NDArray[np.float32]
Rng = np.random.Generator
LEAST_SHARE = 0.08
"""Of the picture that either kind must keep, for there to be an edge to find."""
LONGER_PX = 448
"""Of the disturbed copies: larger ones take longer and tell no more."""


def _noise(size: tuple[int, int], n: int, rng: Rng) -> Values:
    """Smooth (height, width) noise 0..1 with about `n` swells a side."""
    return np.asarray(
        cv2.resize(rng.random((n, n), np.float32), size, interpolation=cv2.INTER_CUBIC)
    )


def _tinted(x: NDArray[np.floating], factor: NDArray[np.float64] | float) -> Values:
    return np.asarray(x * factor, np.float32)


def white_balance(x: Values, rng: Rng) -> Values:
    """Drifts by a sixth of a stop or two."""
    return _tinted(x, np.exp(rng.normal(0, 0.15, 3)))


def exposure(x: Values, rng: Rng) -> Values:
    """Hunts: too dark or too bright by up to a stop, in another gamma."""
    return _tinted(np.maximum(x, 0) ** math.exp(rng.normal(0, 0.25)), math.exp(rng.normal(0, 0.35)))


def flare(x: Values, rng: Rng) -> Values:
    """A veil of light that falls off from one place at the border."""
    h, w = x.shape[:2]
    u, v = np.meshgrid(np.linspace(-1, 1, w), np.linspace(-1, 1, h))
    around = rng.uniform(0, math.tau)
    far = np.hypot(u - math.cos(around), v - math.sin(around))
    veil = rng.uniform(0.2, 0.6) * np.exp(-far / rng.uniform(0.3, 1.0))
    return np.asarray(x + veil[..., None] * np.array([0.75, 0.9, 1.0]), np.float32)


def dirty_lens(x: Values, rng: Rng) -> Values:
    """Blurred brown blots."""
    h, w = x.shape[:2]
    spots = np.zeros((h, w), np.float32)
    for _ in range(int(rng.integers(3, 12))):
        at = (int(rng.integers(w)), int(rng.integers(h)))
        cv2.circle(spots, at, int(rng.uniform(0.01, 0.06) * max(h, w)), rng.uniform(0.3, 0.9), -1)
    blots = np.asarray(cv2.GaussianBlur(spots, (0, 0), 0.012 * max(h, w)), np.float32)[..., None]
    return np.asarray(x * (1 - blots) + blots * np.array([0.15, 0.22, 0.28]), np.float32)


def rolling_shutter(x: Values, rng: Rng) -> Values:
    """Rows shake sideways by up to half a percent of the width: less than labels are sharp."""
    h, w = x.shape[:2]
    v = np.arange(h, dtype=np.float32)
    turns = rng.uniform(1, 6)
    shift = 0.005 * w * np.sin(math.tau * (turns * v / h + rng.random())).astype(np.float32)
    u = np.arange(w, dtype=np.float32)[None, :] + shift[:, None]
    rows = np.broadcast_to(v[:, None], u.shape).astype(np.float32)
    return np.asarray(
        cv2.remap(x, u, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE), np.float32
    )


def jpeg(x: Values, rng: Rng) -> Values:
    """A phone's worst."""
    coded = cv2.imencode(
        ".jpg", as_picture(x), [cv2.IMWRITE_JPEG_QUALITY, int(rng.integers(8, 30))]
    )
    return np.asarray(cv2.imdecode(coded[1], cv2.IMREAD_COLOR), np.float32) / np.float32(255)


def shadow(x: Values, rng: Rng) -> Values:
    """With a straight border, of a strip or of half of the picture."""
    h, w = x.shape[:2]
    around = rng.uniform(0, math.tau)
    u, v = np.meshgrid(np.linspace(-1, 1, w), np.linspace(-1, 1, h))
    d = u * math.cos(around) + v * math.sin(around) - rng.normal(0, 0.5)
    wide = math.exp(rng.normal(-1.2, 0.7)) if rng.random() < 0.5 else 9.0
    soft = rng.uniform(0.02, 0.1)
    inside = 0.5 * (np.tanh(d / soft) - np.tanh((d - wide) / soft))
    return _tinted(x, 1 - rng.uniform(0.2, 0.6) * inside[..., None])


def dust(x: Values, rng: Rng) -> Values:
    """A cloud of it."""
    h, w = x.shape[:2]
    swell = _noise((w, h), int(rng.integers(2, 6)), rng)
    veil = np.clip(swell * rng.uniform(0.3, 1.1) - rng.uniform(0, 0.4), 0, 0.85)[..., None]
    colour = np.array([0.55, 0.65, 0.72]) * rng.uniform(0.8, 1.2)
    return np.asarray(x * (1 - veil) + colour * veil, np.float32)


def blur(x: Values, rng: Rng) -> Values:
    """Out of focus, and shaken."""
    return np.asarray(cv2.GaussianBlur(x, (0, 0), rng.uniform(0.5, 2.0)), np.float32)


def grain(x: Values, rng: Rng) -> Values:
    """Noise of the sensor."""
    sd = rng.uniform(0.01, 0.05)
    return np.asarray(x + sd * rng.standard_normal(x.shape, np.float32), np.float32)


DISTURBANCES: Mapping[str, Callable[[Values, Rng], Values]] = {
    "white balance": white_balance,
    "exposure": exposure,
    "flare": flare,
    "dirty lens": dirty_lens,
    "rolling shutter": rolling_shutter,
    "JPEG": jpeg,
    "shadow": shadow,
    "dust": dust,
    "blur": blur,
    "noise": grain,
}
"""By name: (height, width, 3) blue, green, red of about 0..1 to the same, the edge where it was."""


FORMATS: Mapping[str, tuple[int, int]] = {
    "320 x 240": (320, 240),
    "640 x 480": (640, 480),
    "480 x 640": (480, 640),
    "1280 x 720": (1280, 720),
    "1920 x 1080": (1920, 1080),
    "1080 x 1920": (1080, 1920),
}
"""Width and height of pictures as cameras give them."""


def formatted(
    bgr: Picture, standing: Standing, size: tuple[int, int]
) -> tuple[Picture, Standing] | None:
    """The middle of a labelled picture in another format; None where that shows hardly any crop, or
    hardly anything cut."""
    h, w = standing.shape
    width, height = size
    scale = min(w / width, h / height)
    cut_w, cut_h = max(1, int(width * scale)), max(1, int(height * scale))
    left, top = (w - cut_w) // 2, (h - cut_h) // 2
    rows, columns = slice(top, top + cut_h), slice(left, left + cut_w)
    kind = cv2.INTER_AREA if scale > 1 else cv2.INTER_LINEAR
    label = np.ascontiguousarray(standing[rows, columns]).astype(np.uint8)
    seen = np.asarray(cv2.resize(label, size, interpolation=cv2.INTER_NEAREST) > 0)
    if not LEAST_SHARE < seen.mean() < 1 - LEAST_SHARE:
        return None
    return u8(cv2.resize(bgr[rows, columns], size, interpolation=kind)), seen


def as_picture(x: Values) -> Picture:
    """8-bit colour of values 0..1."""
    return u8(np.clip(x * 255.0 + 0.5, 0, 255))


def disturbed(bgr: Picture, names: tuple[str, ...], rng: Rng) -> Picture:
    """The picture after the named disturbances, in their order."""
    x = bgr.astype(np.float32) / np.float32(255)
    for name in names:
        x = DISTURBANCES[name](x, rng)
    return as_picture(x)


def some(rng: Rng) -> tuple[str, ...]:
    """A random choice of disturbances: a fifth of them on average."""
    return tuple(name for name in DISTURBANCES if rng.random() < 0.2)


def reframed(bgr: Picture, standing: Standing, rng: Rng) -> tuple[Picture, Standing] | None:
    """Another cropping of a labelled picture, turned, mirrored, tilted and stretched; None where it
    would hold hardly any crop, or hardly anything cut."""
    turns, mirrored = int(rng.integers(4)), rng.random() < 0.5
    if rng.random() < 0.35:
        turns, mirrored = 0, False
    picture, mask = np.rot90(bgr, turns), np.rot90(standing, turns)
    if mirrored:
        picture, mask = picture[:, ::-1], mask[:, ::-1]
    h, w = mask.shape
    share, stretch = rng.uniform(0.45, 1.0), math.exp(rng.normal(0, 0.2))
    size = np.array([w * min(1, share * stretch), h * min(1, share / stretch)])
    middle = rng.uniform(size / 2, np.array([w, h]) - size / 2)
    tilt = math.radians(rng.normal(0, 10)) if rng.random() < 0.5 else 0.0
    scale = min(1.0, LONGER_PX / float(size.max()))
    width, height = (max(96, round(float(s) * scale)) for s in size)
    c, s = math.cos(tilt), math.sin(tilt)
    turn = np.array([[c, -s], [s, c]]) * np.array([[width / size[0]], [height / size[1]]])
    matrix = np.column_stack([turn, np.array([width, height]) / 2 - turn @ middle])
    kind = cv2.BORDER_REFLECT
    frame = cv2.warpAffine(
        np.ascontiguousarray(picture),
        matrix,
        (width, height),
        flags=cv2.INTER_LINEAR,
        borderMode=kind,
    )
    seen = cv2.warpAffine(
        np.ascontiguousarray(mask).astype(np.uint8),
        matrix,
        (width, height),
        flags=cv2.INTER_NEAREST,
        borderMode=kind,
    )
    found = np.asarray(seen > 0)
    if not LEAST_SHARE < found.mean() < 1 - LEAST_SHARE:
        return None
    return u8(frame), found


def side_of(standing: Standing) -> Side:
    """Where the standing crop's centroid lies from the cut area's."""
    crop, cut = (np.argwhere(m).mean(0) for m in (standing, ~standing))
    dv, du = crop - cut
    if abs(du) > abs(dv):
        return "right" if du > 0 else "left"
    return "bottom" if dv > 0 else "top"
