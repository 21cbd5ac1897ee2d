"""Ranges of numbers as an option's type."""

from __future__ import annotations

import math
from typing import Any

import click


class NumberRange(click.FloatRange):
    """As click's; what is no number, or infinite, lies in no range."""

    name = "number"
    """For messages and help: click's own is "float range"."""

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        """UsageError outside."""
        found = float(super().convert(value, param, ctx))
        if math.isnan(found):
            self.fail(f"{value} is no number", param, ctx)
        if math.isinf(found):
            self.fail(f"{value} is infinite; give a number", param, ctx)
        return found
