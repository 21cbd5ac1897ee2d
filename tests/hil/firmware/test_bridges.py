"""The bench's bridges against their data sheets, switch by switch.

The plant averages a bridge over a period of its PWM. Here each period is worked out from the truth
tables (VNH5019A-E DocID 15701 Rev 7: table 11 and 2.4, "PWM pin usage"; BTS7960B Rev 1.1: 4.4.1;
L298 Jenuary 2000: figure 6), with a diode beside each switch; no switch and no diode drops any
voltage, on either side. Nothing is taken from the plant.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numba import njit

from hil.firmware import coupling, wiring
from hil.firmware.wiring import Driver, Wiring
from sim_plant import machine
from sim_plant.machine import BatterySpec, BridgeSpec, DriveSpec, MachineSpec

VOLT = 12.0
OHM, HENRY, K_VSPM = 0.2, 0.8e-3, 9.5
PWM_HZ = 3922.0
STEP_S = 0.5e-6
PERIODS = 160
"""Ten of the motor's time constants of 4 ms."""

PWM, LPWM, IN1, IN2 = range(4)
Wires = tuple[float, float, float, float]
"""Share of the time for which each of the firmware's four wires is high."""


def switches(driver: Driver, wires: Wires, phase: float) -> tuple[int, int]:
    """What the halves A and B do at a phase 0..1 of the period: 1 high side closed, 0 low side,
    -1 none."""
    high = [phase < share for share in wires]
    if driver != "vnh5019":  # R_EN and L_EN, EnA and EnB high
        return int(high[PWM]), int(high[LPWM])
    low = 0 if high[PWM] else -1  # a 0 on PWM turns off both low sides
    return (1 if high[IN1] else low), (1 if high[IN2] else low)


@njit
def _mean_current(halves: Any, emf: float) -> float:
    """The motor's mean current (A) from A to B over the last quarter of the periods."""
    current, total = 0.0, 0.0
    n = len(halves)
    for k in range(n * PERIODS):
        a, b = halves[k % n]
        # Where a half is open, its current flows through a diode, in one direction each.
        forward_a = VOLT if a == 1 else 0.0
        forward_b = VOLT if b == 1 else 0.0 if b == 0 else VOLT
        backward_a = VOLT if a == 1 else 0.0 if a == 0 else VOLT
        backward_b = VOLT if b == 1 else 0.0
        forward, backward = forward_a - forward_b - emf, backward_a - backward_b - emf
        if current > 0.0 or (current == 0.0 and forward > 0.0):
            now = current + (forward - OHM * current) * STEP_S / HENRY
        elif current < 0.0 or backward < 0.0:
            now = current + (backward - OHM * current) * STEP_S / HENRY
        else:
            now = 0.0
        current = 0.0 if now * current < 0.0 else now
        if k >= n * PERIODS * 3 // 4:
            total += current
    return total / (n * PERIODS // 4)


def by_data_sheet(driver: Driver, wires: Wires, speed: float) -> float:
    """The drive motors' mean current (A) at a speed (m/s) that is held."""
    n = round(1.0 / (PWM_HZ * STEP_S))
    halves = np.array([switches(driver, wires, (k + 0.5) / n) for k in range(n)])
    return float(_mean_current(halves, K_VSPM * speed))


@njit
def _pin(levels: Any, pin: int) -> int:
    return int(levels[pin])


def by_plant(driver: Driver, wires: Wires, speed: float) -> float:
    """The same from the bench: pins, coupling, machine."""
    spec = MachineSpec(
        drive=DriveSpec(
            bridge=BridgeSpec(drop_v=0.0, r_ohm=0.0, dead_time_s=0.0),
            r_ohm=OHM, l_h=HENRY, k_vspm=K_VSPM, mass_kg=1e9, rolling=0.0, cutting_n=0.0,
        ),
        battery=BatterySpec(full_v=VOLT, empty_v=VOLT, r_ohm=0.0),
    )  # fmt: skip
    state, given, params = machine.initial(spec), machine.inputs(), machine.parameters(spec)
    levels = np.rint(255.0 * np.array(wires)).astype(np.int64)
    duty, brake, one_way = coupling._bridge(
        _pin, levels, 0.0, int(wiring.layout(Wiring(drive=driver))["drive_two_pwm"][0]), 0, 1, 2, 3
    )
    given["drive_duty"], given["drive_brake"], given["drive_one_way"] = duty, brake, one_way
    state["wheel_v"] = speed
    for _ in range(100):
        machine.step(state, params, given, 1e-3)
    return float(state["drive_a"][0])


FORWARD: Wires = (0.5, 0.0, 1.0, 0.0)
BACKWARD: Wires = (0.5, 0.0, 0.0, 1.0)


@pytest.mark.parametrize("speed", [-0.5, 0.0, 0.2, 0.5, 0.8, 1.1])
@pytest.mark.parametrize(
    ("driver", "wires"),
    [
        ("vnh5019", FORWARD),
        ("vnh5019", BACKWARD),
        ("vnh5019", (1.0, 0.0, 0.0, 0.0)),
        ("vnh5019", (0.8, 0.0, 0.0, 0.0)),
        ("vnh5019", (0.4, 0.0, 0.0, 0.0)),
        ("vnh5019", (0.0, 0.0, 0.0, 0.0)),
        ("bts7960", (0.5, 0.0, 0.0, 0.0)),
        ("bts7960", (0.0, 0.5, 0.0, 0.0)),
        ("bts7960", (0.0, 0.0, 0.0, 0.0)),
        ("l298n", (0.5, 0.0, 0.0, 0.0)),
        ("l298n", (0.0, 0.5, 0.0, 0.0)),
    ],
)
def test_the_bench_s_bridge_gives_the_current_that_its_data_sheet_s_switches_give(
    driver: Driver, wires: Wires, speed: float
) -> None:
    """To 0.6 A of a motor that draws 60 A when it is blocked: what flows in the part of a period in
    which the current does not last, which the plant leaves out."""
    assert by_plant(driver, wires, speed) == pytest.approx(
        by_data_sheet(driver, wires, speed), rel=0.02, abs=0.6
    )


def test_a_vnh5019_that_drives_does_not_slow_a_motor_and_one_that_brakes_does() -> None:
    """Downhill, at a quarter more than the speed of its duty. A BTS7960 brakes by itself."""
    speed = 1.25 * 0.5 * VOLT / K_VSPM
    assert by_data_sheet("vnh5019", FORWARD, speed) == pytest.approx(0.0, abs=0.5)
    assert by_data_sheet("vnh5019", (0.5, 0.0, 0.0, 0.0), speed) < -3.0
    assert by_data_sheet("bts7960", (0.5, 0.0, 0.0, 0.0), speed) < -6.0


def test_an_l298n_whose_enable_is_pulsed_hardly_drives_a_motor_below_half_of_the_duty() -> None:
    """Why it gets its pulses at its inputs: an enable that is low opens all of it, and the current
    flows back against the battery. A blocked motor at half of the duty, pulsed either way."""
    n = round(1.0 / (PWM_HZ * STEP_S))
    at_enable = np.array([(1, 0) if k < n // 2 else (-1, -1) for k in range(n)])
    assert float(_mean_current(at_enable, 0.0)) < 1.0
    assert by_data_sheet("l298n", (0.5, 0.0, 0.0, 0.0), 0.0) > 25.0
