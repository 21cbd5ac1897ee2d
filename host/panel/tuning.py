"""The steering loop tuned from the panel: measured, chosen, written, verified by a step.

The same experiments as `daranti tune pid`; between their messages the panel is served, so that STOP
ends them at once.
"""

from __future__ import annotations

from typing import Final

from host.core.errors import UserError
from host.core.messages import Telemetry
from host.link import params, protocol
from host.link.session import Session
from host.panel.machine import Machine
from host.panel.snapshot import Json, number
from host.tune import closed_loop
from host.tune.actuator_model import fit
from host.tune.experiments import armed
from host.tune.on_machine import TELEMETRY_S, VERIFY_S, verify
from host.tune.pid_rules import gains
from host.tune.step_response import Step, deadline_s, meets

POLL_S: Final = 0.004
"""Longest wait for telemetry: under the firmware's tick."""
SIZE_DEG: Final = 30.0
"""Of the step by which new gains are tried."""
RULE: Final = "optimise"
EVERY: Final = 2
"""Of the plot's points."""


class MachineWire:
    """The machine's process as the experiments' wire."""

    def __init__(self, machine: Machine) -> None:
        self._machine = machine

    @property
    def session(self) -> Session:
        """The link's. UserError where it is gone."""
        if self._machine.link is None:
            raise UserError("the board is gone")
        return self._machine.link.session

    @property
    def now(self) -> float:
        """Seconds."""
        return self._machine.clock()

    def request(self, message: protocol.Message) -> None:
        """Sends a message."""
        if self._machine.link is not None:
            self._machine.link.request(message)

    def poll(self) -> list[Telemetry]:
        """What has come; the panel is served meanwhile. UserError where its page is gone: the wheel
        turns to and fro."""
        self._machine.need_driver()
        return self._machine.pump(POLL_S)


def tune(machine: Machine, _wish: Json) -> None:
    """Tunes and tells the pages; the old gains come back where the new ones miss their figures."""
    with machine.doing("pid", dict):
        link = machine.link
        if link is None or not machine.board_ready:
            raise UserError("the board does not answer")
        values = params.read_all(link)
        wire, name = MachineWire(machine), machine.settings.port
        with armed(wire, name, values) as experimenter:
            findings = experimenter.identify()
        machine.settle()
        # A fit takes seconds, for which no armed board waits.
        model = fit(findings)
        before = {key: values[key] for key in closed_loop.TUNED}
        after = gains(RULE, model)
        step = Step(size_deg=SIZE_DEG, start_deg=-SIZE_DEG / 2, duration_s=VERIFY_S)
        params.write_all(link, after)
        kept = False
        try:
            response, trace = verify(wire, name, step)
            kept = meets(response, step, deadline_s(model.slew_degps, model.lag_s.value, step))
        finally:
            machine.settle()
            if not kept and machine.link is not None:
                params.write_all(machine.link, before)
        if kept:
            params.save(link)
        got = [[number(k * TELEMETRY_S, 2), number(a, 2)] for k, a in enumerate(trace[0].tolist())]
        end = number(len(got) * TELEMETRY_S, 2)
        target = step.start_deg + step.size_deg
        machine.post(
            {
                "kind": "pid",
                "problem": "" if kept else "the step misses its figures: the old gains are back",
                "kp": number(after["steer_kp"], 2),
                "ki": number(after["steer_ki"], 2),
                "kd": number(after["steer_kd"], 3),
                "overshoot_deg": number(response.overshoot * step.size_deg, 1),
                "rise_s": number(response.settle_s, 2),
                "asked": [[0, step.start_deg], [0, target], [end, target]],
                "got": got[::EVERY],
            }
        )
