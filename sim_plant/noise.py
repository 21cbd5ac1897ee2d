"""Counter-based randomness: a value depends on its seed and index alone, never on call order.

Everything that the plant draws inside numba comes from here, so that a run is reproducible bit for
bit whatever the number of threads and whoever asks first.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray


@njit(cache=True, nogil=True)
def mix(a: int, b: int, c: int = 0) -> int:
    """32 well-mixed bits of three integers (the finaliser of lowbias32 over a combination)."""
    h = (
        np.uint32(a) * np.uint32(0x9E3779B1)
        ^ np.uint32(b) * np.uint32(0x85EBCA77)
        ^ np.uint32(c) * np.uint32(0xC2B2AE3D)
    )
    h = np.uint32(h ^ (h >> np.uint32(16))) * np.uint32(0x7FEB352D)
    h = np.uint32(h ^ (h >> np.uint32(15))) * np.uint32(0x846CA68B)
    return int(np.uint32(h ^ (h >> np.uint32(16))))


@njit(cache=True, nogil=True)
def uniform(a: int, b: int, c: int = 0) -> float:
    """Uniform in [0, 1)."""
    return mix(a, b, c) * (1.0 / 4294967296.0)


@njit(cache=True, nogil=True)
def normal(a: int, b: int, c: int = 0) -> float:
    """Near-normal, mean 0, sd 1, bounded by ±3.46: the sum of four uniforms (Irwin-Hall)."""
    h = mix(a, b, c)
    g = mix(h, b, c + 1)
    total = (h & 0xFFFF) + (h >> 16) + (g & 0xFFFF) + (g >> 16)
    return (total / 65536.0 - 2.0) * 1.7320508075688772


@njit(cache=True, nogil=True)
def smooth(seed: int, x: float, y: float) -> float:
    """Value noise on a unit lattice: continuous, in [0, 1), mean 0.5."""
    i = math.floor(x)
    j = math.floor(y)
    fx = x - i
    fy = y - j
    fx = fx * fx * (3.0 - 2.0 * fx)
    fy = fy * fy * (3.0 - 2.0 * fy)
    ii = int(i)
    jj = int(j)
    a = uniform(seed, ii, jj)
    b = uniform(seed, ii + 1, jj)
    c = uniform(seed, ii, jj + 1)
    d = uniform(seed, ii + 1, jj + 1)
    return (a + (b - a) * fx) * (1.0 - fy) + (c + (d - c) * fx) * fy


@njit(cache=True, nogil=True)
def smooth_grid(
    seed: int, rows: int, columns: int, cell_m: float, wavelength_m: float
) -> NDArray[np.float32]:
    """Two octaves of `smooth` sampled at cell centres: (rows, columns) float32 in [0, 1)."""
    out = np.empty((rows, columns), np.float32)
    once, twice = np.empty(columns), np.empty(columns)
    k = cell_m / wavelength_m
    for j in range(rows):
        y = (j + 0.5) * k
        _smooth_row(seed, k, y, 1.0, once)
        _smooth_row(seed + 1, k, 2.1 * y, 2.1, twice)
        for i in range(columns):
            out[j, i] = (2.0 * once[i] + twice[i]) / 3.0
    return out


@njit(cache=True, nogil=True)
def _smooth_row(seed: int, k: float, y: float, finer: float, out: NDArray[np.float64]) -> None:
    """`smooth` at (finer * (i + 0.5) * k, y) for every i: the lattice's four corners are drawn anew
    only where x comes to the next."""
    j = math.floor(y)
    fy = y - j
    fy = fy * fy * (3.0 - 2.0 * fy)
    jj = int(j)
    before = 0
    a = b = c = d = 0.0
    for n in range(out.size):
        x = finer * ((n + 0.5) * k)
        i = math.floor(x)
        ii = int(i)
        if n == 0 or ii != before:
            before = ii
            a = uniform(seed, ii, jj)
            b = uniform(seed, ii + 1, jj)
            c = uniform(seed, ii, jj + 1)
            d = uniform(seed, ii + 1, jj + 1)
        fx = x - i
        fx = fx * fx * (3.0 - 2.0 * fx)
        out[n] = (a + (b - a) * fx) * (1.0 - fy) + (c + (d - c) * fx) * fy
