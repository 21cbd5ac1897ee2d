"""Counter-based noise has the moments it promises and no memory."""

from __future__ import annotations

import numpy as np
import pytest

from sim_plant import noise, render


def test_uniform_is_uniform_and_neighbours_are_independent() -> None:
    u = np.array([noise.uniform(7, k, 3) for k in range(50_000)])
    assert u.mean() == pytest.approx(0.5, abs=0.005)
    assert u.var() == pytest.approx(1 / 12, abs=0.001)
    assert abs(np.corrcoef(u[1:], u[:-1])[0, 1]) < 0.015
    other = np.array([noise.uniform(8, k, 3) for k in range(50_000)])
    assert abs(np.corrcoef(u, other)[0, 1]) < 0.015


def test_normal_has_unit_variance_and_a_bound() -> None:
    g = np.array([noise.normal(1, k, 1) for k in range(50_000)])
    assert (g.mean(), g.std()) == (pytest.approx(0, abs=0.02), pytest.approx(1, abs=0.02))
    assert np.abs(g).max() <= 3.4642
    assert abs(np.corrcoef(g[1:], g[:-1])[0, 1]) < 0.015


def test_smooth_noise_is_continuous_also_across_lattice_and_zero() -> None:
    x = np.arange(-2, 2, 1e-3)
    values = np.array([noise.smooth(3, float(v), -0.3) for v in x])
    assert np.abs(np.diff(values)).max() < 2e-3
    assert values.min() >= 0 and values.max() < 1


def test_known_values_do_not_change() -> None:
    """Records of old runs stay reproducible."""
    assert [noise.mix(1, 2, 3), noise.mix(0, 0, 0), noise.mix(-1, 5)] == [
        2634536894,
        0,
        4147939333,
    ]


def test_the_pictures_kernels_draw_the_same_noise() -> None:
    rng = np.random.default_rng(3)
    for seed, x, y in zip(
        rng.integers(0, 1 << 20, 200).tolist(),
        rng.uniform(-500, 500, 200).tolist(),
        rng.uniform(-500, 500, 200).tolist(),
        strict=True,
    ):
        assert render.smooth(seed, x, y) == noise.smooth(seed, x, y)


@pytest.mark.parametrize(
    ("seed", "cell_m", "wave_m"), [(3, 0.05, 0.8), (-7, 0.05, 0.06), (9, 1, 10)]
)
def test_a_grid_of_noise_is_two_octaves_at_the_middles_of_its_cells(
    seed: int, cell_m: float, wave_m: float
) -> None:
    grid = noise.smooth_grid(seed, 31, 47, cell_m, wave_m)
    k = cell_m / wave_m
    for j in range(31):
        for i in range(47):
            x, y = (i + 0.5) * k, (j + 0.5) * k
            octaves = 2 * noise.smooth(seed, x, y) + noise.smooth(seed + 1, 2.1 * x, 2.1 * y)
            assert grid[j, i] == np.float32(octaves / 3)
