"""The constants on the way from picture to steering: how many there are, and what each of them
changes when it is a third larger or smaller."""

from __future__ import annotations

import ast
import contextlib
import importlib
import re
import sys
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from hil.bench.harvest import Harvest
from hil.scenario.scenario import Scenario

ROOT: Final = Path(__file__).resolve().parents[2]
ROOMS: Final = ("host/vision", "host/estimate", "host/pilot")
SHARE: Final = 0.3
"""By which each constant is varied, to either side."""
UNIT: Final = re.compile(r"_(?:M|S|RAD|DEG|MPS|1PM|PX|MPS2|PER_M|PER_RAD|M2|HZ)$|SIGMA|SHARE|GAIN")
"""Of a name that says its unit, or that it has none."""
KNIFE_COVERAGE, KNIFE_LATERAL_M = 0.01, 0.02
"""A constant is on a knife's edge where a change of SHARE costs more than that, an outcome, or does
harm."""


@dataclass(frozen=True, slots=True)
class Constant:
    """One name of a module's top level. `about` is the text below it."""

    path: str
    name: str
    about: str

    @property
    def module(self) -> str:
        """As it is imported."""
        return self.path.removesuffix(".py").replace("/", ".")


def _numeric(node: ast.expr) -> bool:
    """Whether an expression is made of numbers alone."""
    leaves = [n for n in ast.walk(node) if isinstance(n, ast.Constant)]
    numbers = [n for n in leaves if isinstance(n.value, (int, float)) and n.value is not True]
    calls = [ast.unparse(n.func) for n in ast.walk(node) if isinstance(n, ast.Call)]
    plain = all(call in ("math.radians", "np.array", "range", "slice") for call in calls)
    return bool(numbers) and len(numbers) == len(leaves) and plain and "range" not in calls


def found(root: Path = ROOT, rooms: tuple[str, ...] = ROOMS) -> list[Constant]:
    """Of a checkout, by its text."""
    out = []
    for room in rooms:
        for path in sorted((root / room).rglob("*.py")):
            body = ast.parse(path.read_text(encoding="utf-8")).body
            about = ""
            for node, after in zip(reversed(body), [None, *reversed(body)], strict=False):
                is_text = isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant)
                about = str(after.value.value) if is_text else about  # type: ignore[union-attr]
                if isinstance(node, ast.Assign) and _numeric(node.value):
                    targets = [n for t in node.targets for n in ast.walk(t)]
                elif isinstance(node, ast.AnnAssign) and node.value and _numeric(node.value):
                    targets = [node.target]
                else:
                    about = "" if not isinstance(node, ast.Expr) else about
                    continue
                for target in targets:
                    if isinstance(target, ast.Name) and target.id.lstrip("_").isupper():
                        where = path.relative_to(root).as_posix()
                        out.append(Constant(where, target.id, " ".join(about.split())))
    return sorted(out, key=lambda c: (c.path, c.name))


@contextlib.contextmanager
def varied(constant: Constant, factor: float) -> Iterator[None]:
    """The constant so many times as large, in every module that has taken it."""
    importlib.import_module(constant.module)
    was = getattr(sys.modules[constant.module], constant.name)
    if isinstance(was, tuple):
        now: Any = tuple(type(v)(v * factor) for v in was)
    else:
        now = was * factor if not isinstance(was, int) else round(was * factor)
    holders = [
        module
        for name, module in list(sys.modules.items())
        if name.startswith("host.") and getattr(module, constant.name, None) is was
    ]
    for module in holders:
        setattr(module, constant.name, now)
    try:
        yield
    finally:
        for module in holders:
            setattr(module, constant.name, was)


@dataclass(frozen=True, slots=True)
class Figures:
    """Of one harvest."""

    outcome: str
    coverage: float
    lateral_rms_m: float
    harm: bool
    time_s: float

    def knife(self, usual: Figures) -> bool:
        """Whether that is much worse than usual."""
        return (
            (self.outcome not in (usual.outcome, "finished"))
            or self.harm > usual.harm
            or self.coverage < usual.coverage - KNIFE_COVERAGE
            or self.lateral_rms_m > usual.lateral_rms_m + KNIFE_LATERAL_M
        )


def driven(scenario: Scenario) -> Figures:
    """A harvest's."""
    with closing(Harvest(scenario)) as run:
        run.run()
        field = run.bench.field
        lateral = float(np.sqrt(np.mean(np.square(run.truth.lateral or [np.nan]))))
        harm = field.neighbour_cut_m2() > 0 or run.truth.outside_m > 0.1
        outcome = run.pilot.phase.value
        return Figures(outcome, field.coverage(), lateral, harm, run.bench.now)
