"""The machine: battery, bridges, motors, steering, wheels on ground, blade and sensors.

One function, `step`, advances one structured record by a fixed time; a numba loop may call it. The
bridges' signed duties come in, the voltages that the controller's pins see go out. PWM is averaged
over its period; the electrical R-L is integrated exactly over a step, friction sticks and slips.

Vehicle frame: x forward from the rear axle, y left; steering angle and yaw positive to the left.
Sources: DC motor and friction as in Karnopp 1985; tricycle with side slip as in Lenain et al. 2006
("High accuracy path tracking for vehicles in presence of sliding").
"""

from __future__ import annotations

import math
from typing import Annotated, Any, Final

import numpy as np
from numba import njit
from numpy.typing import NDArray
from pydantic import Field as Limits

from sim_plant import noise
from sim_plant.strict import NotNegative, Positive, Strict

STEP_S: Final = 0.001
"""The step that the constants' accuracy was checked with; `step` takes any up to some 2 ms."""
GRAVITY: Final = 9.81
"""m/s²."""


STEER_PWM_HZ: Final = 20_000.0
"""Of the bridges' PWM where a machine's parameters say nothing else."""
DRIVE_PWM_HZ: Final = 3_922.0
"""The frequencies that the firmware's defaults give."""


class BridgeSpec(Strict):
    """An H-bridge: output voltage = duty * (battery - drop_v) - r_ohm * current; of every period of
    the PWM it loses its dead time."""

    drop_v: NotNegative = 1.8
    """At no current, with wires and plugs: 1.8 V for an L298N, near 0 for a new BTS7960."""
    r_ohm: NotNegative = 0.3
    dead_time_s: NotNegative = 2e-6


class SteeringSpec(Strict):
    """Steering motor with its gear, referred to the motor's shaft, and the pot on the rod.

    The defaults give 45 deg/s at full duty, a lag of 70 ms and stiction of 45 counts of 255 at 12 V
    behind a drop of 1.8 V; `from_response` gives others.
    """

    bridge: BridgeSpec = BridgeSpec()
    r_ohm: Positive = 0.8
    l_h: Positive = 1.0e-3
    k_vs: Positive = 0.07426
    """Back-EMF in V s/rad and torque in N m/A."""
    inertia_kgm2: Positive = 3.509e-4
    viscous_nms: NotNegative = 1e-6
    coulomb_nm: NotNegative = 0.0705
    static_nm: NotNegative = 0.0940
    gear: Positive = 150.0
    backlash_deg: NotNegative = 1.0
    stop_deg: Annotated[float, Limits(gt=0, lt=85)] = 54.0
    pot_centre_counts: float = 512.0
    pot_counts_per_deg: float = 4.5
    pot_bend_counts: NotNegative = 2.0
    """Amplitude of the pot's non-linearity, one sine over ±50 degrees."""
    pot_noise_counts: NotNegative = 2.0
    """Bound of the noise; its standard deviation is 0.29 of it."""
    sense_zero_mv: NotNegative = 2500.0
    sense_mv_per_a: Annotated[float, Limits(ge=-1000, le=1000)] = 100.0
    """The current sensor in the motor's wire: an ACS712-20A. Its sign follows the current's."""

    @classmethod
    def from_response(
        cls,
        *,
        slew_degps: float = 45.0,
        lag_s: float = 0.07,
        stiction_counts: float = 45.0,
        backlash_deg: float = 1.0,
        battery_v: float = 12.0,
        bridge: BridgeSpec | None = None,
        pwm_hz: float = STEER_PWM_HZ,
        stop_deg: float = 54.0,
    ) -> SteeringSpec:
        """The motor that shows these figures at `battery_v` and `pwm_hz`: slew at full duty, time
        constant of the speed, and the duty (of 255) that just breaks it loose; Coulomb is 75 % of
        static."""
        base = cls.model_fields
        bridge = bridge or BridgeSpec()
        gear = float(base["gear"].default)
        loop_ohm = float(base["r_ohm"].default) + bridge.r_ohm
        dead = bridge.dead_time_s * pwm_hz
        full_v = (battery_v - bridge.drop_v) * (1 - dead)
        start = max(0.0, stiction_counts / 255 - dead)
        start_v = start * (battery_v - bridge.drop_v)
        k = (full_v - 0.75 * start_v) / (math.radians(slew_degps) * gear)
        return cls(
            bridge=bridge,
            k_vs=k,
            inertia_kgm2=lag_s * k**2 / loop_ohm,
            static_nm=k * start_v / loop_ohm,
            coulomb_nm=0.75 * k * start_v / loop_ohm,
            backlash_deg=backlash_deg,
            stop_deg=stop_deg,
        )


class DriveSpec(Strict):
    """The two drive motors on one bridge, referred to the wheel's rim: force in N, speed in m/s."""

    bridge: BridgeSpec = BridgeSpec(drop_v=1.0, r_ohm=0.03)
    r_ohm: Positive = 0.17
    l_h: Positive = 0.8e-3
    k_vspm: Positive = 9.5
    """Back-EMF in V s/m and force in N/A."""
    mass_kg: Positive = 120.0
    """Moving mass, the rotating parts' share included."""
    rolling: NotNegative = 0.04
    """Rolling resistance as a share of the weight."""
    cutting_n: NotNegative = 20.0
    """Drag of the blade in crop over its full width."""
    slip_n: Positive = 3000.0
    """Driving force over this gives the share of wheel speed lost to slip."""
    hall_pulses_per_m: NotNegative = 50.0
    """0: no sensor fitted. Where one is, a second is a quarter of a pulse apart."""
    hall_left_m: float = 0.35
    """How far left of the machine's middle the wheel is that carries the sensor's magnets, m; 0:
    they turn with the axle, before a differential. Each rear wheel has a motor of its own
    (docs/build, "Parts"), so in a turn this one goes another way than the middle does (a rigid
    body's: v less the yaw rate times this): with 0.35 m, a wheelbase of 1 m and 50 degrees of
    steering 42 % less or more."""
    sense_zero_mv: NotNegative = 2500.0
    sense_mv_per_a: Annotated[float, Limits(ge=-1000, le=1000)] = 40.0
    """The current sensor: an ACS758-050B."""


class BatterySpec(Strict):
    """Lead battery: a source behind a resistance, falling with the charge taken."""

    full_v: Positive = 12.6
    empty_v: Positive = 11.6
    r_ohm: NotNegative = 0.03
    capacity_ah: Positive = 40.0
    idle_a: NotNegative = 0.5
    """Electronics."""
    blade_a: NotNegative = 8.0
    regulator_drop_v: NotNegative = 1.2
    """The controller's 5 V rail falls once the battery is below 5 V and this."""
    divider: Positive = 4.0
    """What the controller's pin sees is the battery's voltage over this."""


class MachineSpec(Strict):
    """The whole machine."""

    wheelbase_m: Positive = 1.0
    half_width_m: Positive = 0.4
    """Body and wheels, the blade apart."""
    rear_overhang_m: NotNegative = 0.25
    blade_width_m: Positive = 1.0
    blade_ahead_m: float = 0.5
    """The blade's line, ahead of the front axle."""
    blade_height_m: Positive = 0.12
    blade_spin_up_s: Positive = 0.4
    blade_turn_hz: NotNegative = 0.0
    """Pulses a second of the blade's sensor at full speed; 0: none fitted."""
    cornering_front_n: Positive = 3000.0
    """Side force of the front wheel per radian of slip."""
    cornering_rear_n: Positive = 8000.0
    front_load: Annotated[float, Limits(gt=0, lt=1)] = 0.35
    """Share of the weight on the front wheel."""
    steering: SteeringSpec = SteeringSpec()
    drive: DriveSpec = DriveSpec()
    battery: BatterySpec = BatterySpec()

    @property
    def blade_x_m(self) -> float:
        """The blade's line ahead of the rear axle."""
        return self.wheelbase_m + self.blade_ahead_m

    def outline(self, x: float, y: float, yaw: float) -> NDArray[np.float64]:
        """Corners of body and blade in the field frame, (8, 2), for boundary checks."""
        nose, tail, half = self.wheelbase_m + 0.15, -self.rear_overhang_m, self.half_width_m
        blade, wide = self.blade_x_m, self.blade_width_m / 2
        local = np.array(
            [
                (tail, -half),
                (nose, -half),
                (blade - 0.1, -wide),
                (blade, -wide),
                (blade, wide),
                (blade - 0.1, wide),
                (nose, half),
                (tail, half),
            ]
        )
        c, s = math.cos(yaw), math.sin(yaw)
        turn = np.array([[c, s], [-s, c]])
        return np.asarray(local @ turn + np.array([x, y]), np.float64)


STATE: Final = np.dtype(
    [
        ("steps", np.int64),
        ("x", np.float64),  # rear axle's middle, m
        ("y", np.float64),
        ("yaw", np.float64),  # rad, not wrapped
        ("v", np.float64),  # ground speed along the body, m/s
        ("yaw_rate", np.float64),  # rad/s
        ("slip_rear", np.float64),  # side slip angles, rad
        ("slip_front", np.float64),
        ("wheel_v", np.float64),  # rim speed of the drive wheels, m/s
        ("distance", np.float64),  # of the drive wheels, their mean, signed, m
        ("counted", np.float64),  # of the wheel that carries the sensor's magnets, signed, m
        ("steer_angle", np.float64),  # of the front wheel, rad
        ("steer_shaft", np.float64),  # gear's output before the backlash, rad
        ("steer_speed", np.float64),  # of the motor's shaft, rad/s
        ("steer_a", np.float64),  # bridge currents, A
        ("drive_a", np.float64),
        ("blade_share", np.float64),  # of its full speed
        ("blade_spinning", np.int64),  # whether it cuts
        ("charge_as", np.float64),  # taken from the battery, A s
        ("battery_v", np.float64),
        ("rail_v", np.float64),  # the controller's 5 V supply
        ("pot_mv", np.float64),  # what A0..A3 see, 0..5000 mV
        ("battery_sense_mv", np.float64),
        ("steer_sense_mv", np.float64),
        ("drive_sense_mv", np.float64),
        ("hall", np.int64),  # levels of the sensors
        ("hall_b", np.int64),
        ("blade_turn", np.int64),
        ("blade_pulses", np.float64),  # of the blade's sensor
    ],
    align=True,
)

INPUTS: Final = np.dtype(
    [
        ("steer_duty", np.float64),  # -1..1, positive to the left
        ("drive_duty", np.float64),  # -1..1, positive forward
        ("steer_brake", np.float64),  # at zero duty: share of the time that the motor is shorted,
        ("drive_brake", np.float64),  # 0 lets it coast
        ("steer_one_way", np.int64),  # 1: where it drives, the bridge takes no current back
        ("drive_one_way", np.int64),
        ("blade_on", np.int64),
        ("roll", np.float64),  # of the ground, rad: positive when the right side is lower
        ("pitch", np.float64),  # positive nose down
        ("cutting", np.float64),  # share of the blade's width that meets crop
        ("load_n", np.float64),  # extra drag: mud
        ("steer_jam", np.int64),  # 1: the steering cannot move
    ],
    align=True,
)

_PARAMETERS: Final = (
    "wheelbase",
    "front_load",
    "cornering_front",
    "cornering_rear",
    "blade_spin_up",
    "st_drop",
    "st_r",
    "st_l",
    "st_k",
    "st_j",
    "st_b",
    "st_coulomb",
    "st_static",
    "st_gear",
    "st_dead",
    "st_backlash",
    "st_stop",
    "pot_centre",
    "pot_slope",
    "pot_bend",
    "pot_noise",
    "dr_drop",
    "dr_r",
    "dr_l",
    "dr_k",
    "dr_mass",
    "dr_rolling",
    "dr_cutting",
    "dr_slip",
    "dr_dead",
    "hall_ppm",
    "hall_left",
    "bat_full",
    "bat_empty",
    "bat_r",
    "bat_as",
    "bat_idle",
    "bat_blade",
    "regulator_drop",
    "st_sense_zero",
    "st_sense",
    "dr_sense_zero",
    "dr_sense",
    "bat_divider",
    "blade_hz",
)
PARAMS: Final = np.dtype([("seed", np.int64), *((n, np.float64) for n in _PARAMETERS)], align=True)

Record = NDArray[Any]


def parameters(
    spec: MachineSpec,
    seed: int = 0,
    *,
    steer_pwm_hz: float = STEER_PWM_HZ,
    drive_pwm_hz: float = DRIVE_PWM_HZ,
) -> Record:
    """The (1,) PARAMS record of a spec whose bridges are driven at these frequencies; `seed` draws
    the pot's noise."""
    s, d, b = spec.steering, spec.drive, spec.battery
    p = np.zeros(1, PARAMS)
    values = {
        "seed": seed,
        "wheelbase": spec.wheelbase_m,
        "front_load": spec.front_load,
        "cornering_front": spec.cornering_front_n,
        "cornering_rear": spec.cornering_rear_n,
        "blade_spin_up": spec.blade_spin_up_s,
        "st_drop": s.bridge.drop_v,
        "st_r": s.r_ohm + s.bridge.r_ohm,
        "st_l": s.l_h,
        "st_k": s.k_vs,
        "st_j": s.inertia_kgm2,
        "st_b": s.viscous_nms,
        "st_coulomb": s.coulomb_nm,
        "st_static": max(s.static_nm, s.coulomb_nm),
        "st_gear": s.gear,
        "st_dead": s.bridge.dead_time_s * steer_pwm_hz,
        "st_backlash": math.radians(s.backlash_deg),
        "st_stop": math.radians(s.stop_deg),
        "pot_centre": s.pot_centre_counts,
        "pot_slope": math.degrees(s.pot_counts_per_deg),
        "pot_bend": s.pot_bend_counts,
        "pot_noise": s.pot_noise_counts / 3.4641,
        "dr_drop": d.bridge.drop_v,
        "dr_r": d.r_ohm + d.bridge.r_ohm,
        "dr_l": d.l_h,
        "dr_k": d.k_vspm,
        "dr_mass": d.mass_kg,
        "dr_rolling": d.rolling,
        "dr_cutting": d.cutting_n,
        "dr_slip": d.slip_n,
        "dr_dead": d.bridge.dead_time_s * drive_pwm_hz,
        "hall_ppm": d.hall_pulses_per_m,
        "hall_left": d.hall_left_m,
        "bat_full": b.full_v,
        "bat_empty": b.empty_v,
        "bat_r": b.r_ohm,
        "bat_as": b.capacity_ah * 3600,
        "bat_idle": b.idle_a,
        "bat_blade": b.blade_a,
        "regulator_drop": b.regulator_drop_v,
        "st_sense_zero": s.sense_zero_mv,
        "st_sense": s.sense_mv_per_a,
        "dr_sense_zero": d.sense_zero_mv,
        "dr_sense": d.sense_mv_per_a,
        "bat_divider": b.divider,
        "blade_hz": spec.blade_turn_hz,
    }
    for name, value in values.items():
        p[name] = value
    return p


def initial(
    spec: MachineSpec, x: float = 0.0, y: float = 0.0, yaw: float = 0.0, steer: float = 0.0
) -> Record:
    """The (1,) STATE record of a machine at rest; angles in radians."""
    state = np.zeros(1, STATE)
    state["x"], state["y"], state["yaw"] = x, y, yaw
    state["steer_angle"] = state["steer_shaft"] = steer
    state["battery_v"] = spec.battery.full_v
    _sense(state, parameters(spec))
    return state


def inputs() -> Record:
    """A (1,) INPUTS record, everything off on level ground."""
    return np.zeros(1, INPUTS)


@njit(cache=True, nogil=True)
def _effective(duty: float, dead: float) -> float:
    """Duty after the bridge's dead time."""
    d = min(1.0, max(-1.0, duty))
    return math.copysign(max(0.0, abs(d) - dead), d)


@njit(cache=True, nogil=True)
def _current(
    current: float,
    duty: float,
    brake: float,
    one_way: int,
    battery: float,
    drop: float,
    ohm: float,
    henry: float,
    emf: float,
    dt: float,
) -> float:
    """The motor's current (A) after `dt` at constant back-EMF (V), exact for the R-L circuit.

    `one_way`: in the rest of each period the bridge opens its low sides (VNH5019A-E data sheet,
    DocID 15701, 2.4), so that the current goes on through a diode and ends at none: such a bridge
    drives but does not slow a motor that turns faster than its duty. `brake` at no duty: for so
    much of each period the motor is shorted; in the rest all is open, and the diodes return its
    current to the battery.
    What flows in the part of a period in which it does not last is neglected."""
    if duty == 0.0 and brake == 0.0:
        # Open bridge: the diodes return the current to the battery within a fraction of a step.
        return 0.0
    if duty == 0.0:
        mean = min(abs(emf), (1.0 - brake) * (battery + drop))
        final = -math.copysign(abs(emf) - mean, emf) / ohm
        way = -emf if brake < 1.0 else 0.0
    else:
        final = (duty * max(0.0, battery - drop) - emf) / ohm
        way = duty if one_way != 0 else 0.0
    after = final + (current - final) * math.exp(-dt * ohm / henry)
    return 0.0 if after * way < 0.0 else after


@njit(cache=True, nogil=True)
def _slide(
    speed: float,
    force: float,
    coulomb: float,
    static: float,
    viscous: float,
    inertia: float,
    dt: float,
) -> float:
    """Speed after `dt` under a force and friction, which can stop a motion but not reverse it."""
    if speed == 0.0:
        if abs(force) <= static:
            return 0.0
        push = force - math.copysign(coulomb, force)
    else:
        push = force - math.copysign(coulomb, speed)
    new = (speed + dt / inertia * push) / (1.0 + dt * viscous / inertia)
    if speed * new < 0.0:
        return 0.0
    return new


@njit(cache=True, nogil=True)
def _sense(state: Any, params: Any) -> None:
    """What the controller's pins see."""
    s = state[0]
    p = params[0]
    counts = p.pot_centre + p.pot_slope * s.steer_angle
    counts += p.pot_bend * math.sin(s.steer_angle * 3.6)
    counts += p.pot_noise * noise.normal(p.seed, s.steps, 1)
    s.pot_mv = min(5000.0, max(0.0, counts * (5000.0 / 1023.0)))
    s.battery_sense_mv = min(5000.0, max(0.0, s.battery_v * 1000.0 / p.bat_divider))
    s.steer_sense_mv = min(5000.0, max(0.0, p.st_sense_zero + s.steer_a * p.st_sense))
    s.drive_sense_mv = min(5000.0, max(0.0, p.dr_sense_zero + s.drive_a * p.dr_sense))
    s.rail_v = min(5.0, max(0.0, s.battery_v - p.regulator_drop))
    if p.hall_ppm > 0.0:
        phase = s.counted * p.hall_ppm
        s.hall = 1 if phase - math.floor(phase) < 0.5 else 0
        late = phase - 0.25
        s.hall_b = 1 if late - math.floor(late) < 0.5 else 0
    s.blade_turn = 1 if s.blade_pulses - math.floor(s.blade_pulses) < 0.5 else 0


@njit(cache=True, nogil=True)
def step(state: Any, params: Any, given: Any, dt: float) -> None:
    """Advances the (1,) STATE record by `dt` seconds under the (1,) INPUTS record `given`."""
    s = state[0]
    p = params[0]
    u = given[0]

    # ---- battery: the currents of the last step pull it down
    steer_duty = _effective(u.steer_duty, p.st_dead)
    drive_duty = _effective(u.drive_duty, p.dr_dead)
    draw = p.bat_idle + abs(steer_duty) * abs(s.steer_a) + drive_duty * s.drive_a
    if u.blade_on != 0:
        # A stopped blade motor draws its stall current until it is up to speed.
        draw += p.bat_blade * (1.0 + 3.0 * (1.0 - s.blade_share))
    s.charge_as += draw * dt
    left = max(0.0, 1.0 - s.charge_as / p.bat_as)
    s.battery_v = max(0.0, p.bat_empty + (p.bat_full - p.bat_empty) * left - p.bat_r * draw)

    # ---- steering
    s.steer_a = _current(
        s.steer_a, steer_duty, u.steer_brake, u.steer_one_way, s.battery_v,
        p.st_drop, p.st_r, p.st_l, p.st_k * s.steer_speed, dt,
    )  # fmt: skip
    if u.steer_jam != 0:
        s.steer_speed = 0.0
    else:
        s.steer_speed = _slide(
            s.steer_speed, p.st_k * s.steer_a, p.st_coulomb, p.st_static, p.st_b, p.st_j, dt
        )
    s.steer_shaft += s.steer_speed / p.st_gear * dt
    limit = p.st_stop + 0.5 * p.st_backlash
    if abs(s.steer_shaft) > limit:
        s.steer_shaft = math.copysign(limit, s.steer_shaft)
        s.steer_speed = 0.0
    slack = 0.5 * p.st_backlash
    s.steer_angle = min(max(s.steer_angle, s.steer_shaft - slack), s.steer_shaft + slack)

    # ---- drive: rim speed under motor, slope, rolling, cutting and mud
    s.drive_a = _current(
        s.drive_a, drive_duty, u.drive_brake, u.drive_one_way, s.battery_v,
        p.dr_drop, p.dr_r, p.dr_l, p.dr_k * s.wheel_v, dt,
    )  # fmt: skip
    weight = p.dr_mass * GRAVITY
    pull = p.dr_k * s.drive_a + weight * math.sin(u.pitch)
    drag = p.dr_rolling * weight * math.cos(u.pitch) + u.load_n + p.dr_cutting * u.cutting
    s.wheel_v = _slide(s.wheel_v, pull, drag, drag, 0.0, p.dr_mass, dt)
    s.distance += s.wheel_v * dt
    lost = p.dr_k * s.drive_a / p.dr_slip
    if s.wheel_v < 0.0:
        lost = -lost
    s.v = s.wheel_v * (1.0 - min(1.0, max(-0.3, lost)))

    # ---- motion: side slip of both axles from gravity across and from the turn
    across = weight * math.sin(u.roll) + p.dr_mass * s.v * s.yaw_rate
    if s.v == 0.0:
        s.slip_front = 0.0
        s.slip_rear = 0.0
    else:
        way = 1.0 if s.v > 0.0 else -1.0
        s.slip_front = -way * across * p.front_load / p.cornering_front
        s.slip_rear = -way * across * (1.0 - p.front_load) / p.cornering_rear
    s.yaw_rate = (
        s.v
        * math.cos(s.slip_rear)
        * (math.tan(s.steer_angle + s.slip_front) - math.tan(s.slip_rear))
        / p.wheelbase
    )
    s.counted += (s.wheel_v - p.hall_left * s.yaw_rate) * dt
    course = s.yaw + 0.5 * dt * s.yaw_rate + s.slip_rear
    s.x += s.v * math.cos(course) * dt
    s.y += s.v * math.sin(course) * dt
    s.yaw += s.yaw_rate * dt

    # ---- blade
    wanted = 1.0 if u.blade_on != 0 else 0.0
    s.blade_share += (wanted - s.blade_share) * (1.0 - math.exp(-3.0 * dt / p.blade_spin_up))
    s.blade_spinning = 1 if s.blade_share > 0.5 else 0
    s.blade_pulses += s.blade_share * p.blade_hz * dt

    s.steps += 1
    _sense(state, params)
