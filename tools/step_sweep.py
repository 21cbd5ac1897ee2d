"""The steering's 30 degree step over every extreme actuator, with the firmware's default gains.

Prints the worst of each motor speed, with the actuator it
was: time to settle within 2 %, overshoot, error and duty at rest. Exits 1 where an actuator of
60 deg/s takes more than 0.8 s, or any overshoots by more than 5 %, rests more than 0.5 deg off, or
chatters.
"""

from __future__ import annotations

import argparse
import itertools
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from hil.firmware.targets import Target
from host.core.errors import UserError
from tests.firmware.conftest import maker_of
from tests.firmware.test_step import respond, settled_after
from tests.helpers.actuator import ActuatorSpec
from tests.helpers.firmware_bench import Bench

STEP_DEG = 30.0
SLEWS = (20.0, 45.0, 60.0)
LAGS = (0.05, 0.1)
BACKLASHES = (0.5, 2.0)
STICTIONS = (25.0, 45.0, 90.0)
REST_MS = 800
SETTLE_LIMIT_S = 0.8
"""For the fastest motors: 30 degrees take a slower one longer at full duty."""
OVERSHOOT_LIMIT = 5.0
ERROR_LIMIT_DEG = 0.5


@dataclass(frozen=True)
class Result:
    """One step."""

    slew_degps: float
    what: str
    settled_s: float
    overshoot: float
    """Percent of the step."""
    error_deg: float
    """Largest at rest."""
    chatter_ms: int
    """How long the motor was driven at rest."""

    @property
    def good(self) -> bool:
        """Within all limits."""
        fast = self.slew_degps < max(SLEWS) or self.settled_s <= SETTLE_LIMIT_S
        calm = self.error_deg <= ERROR_LIMIT_DEG and self.chatter_ms == 0
        return fast and calm and self.overshoot <= OVERSHOOT_LIMIT


def step(target: Target, spec: ActuatorSpec, direction: int) -> Result:
    """One actuator's response."""
    aim = direction * STEP_DEG
    response = respond(Bench(target, spec), aim, 2000 if spec.slew_degps == max(SLEWS) else 4500)
    rest = response[-REST_MS:]
    return Result(
        spec.slew_degps,
        f"lag {spec.lag_s * 1000:.0f} ms, stiction {spec.stiction_duty:.0f}, backlash "
        f"{spec.backlash_deg:g} deg, to the {'left' if direction > 0 else 'right'}",
        settled_after(response, aim),
        max(0.0, *((angle - aim) * direction for angle, _ in response)) / STEP_DEG * 100,
        max(abs(angle - aim) for angle, _ in rest),
        sum(duty != 0 for _, duty in rest),
    )


def sweep(make: Callable[[], Target]) -> list[Result]:
    """All actuators, both ways."""
    out = []
    for slew, lag, backlash, stiction, direction in itertools.product(
        SLEWS, LAGS, BACKLASHES, STICTIONS, (1, -1)
    ):
        with make() as target:
            out.append(step(target, ActuatorSpec(slew, lag, stiction, backlash), direction))
    return out


def table(results: list[Result]) -> None:
    """Prints the worst of each kind."""
    for slew in SLEWS:
        those = [each for each in results if each.slew_degps == slew]
        bad = sum(not each.good for each in those)
        print(f"  {slew:.0f} deg/s, {len(those)} actuators, {bad} out of limits")
        for name, unit, key in (
            ("settles in", "s", lambda r: r.settled_s),
            ("overshoots by", "%", lambda r: r.overshoot),
            ("rests off by", "deg", lambda r: r.error_deg),
            ("driven at rest", "ms", lambda r: float(r.chatter_ms)),
        ):
            worst = max(those, key=key)
            print(f"    {name:<16}{key(worst):>7.3f} {unit:<4} ({worst.what})")


def main() -> int:
    """Runs the sweeps."""
    makers = {"desk": maker_of("desk"), "avr": maker_of("avr")}
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("target", nargs="?", choices=makers, help="both where none is given")
    only = parser.parse_args().target
    bad = 0
    for name in [only] if only else makers:
        try:
            results = sweep(makers[name])
        except UserError as error:
            print(f"step_sweep: {error}", file=sys.stderr)
            return 2
        print(name)
        table(results)
        bad += sum(not each.good for each in results)
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
