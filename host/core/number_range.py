"""Ranges of numbers as an option's type, in plain words."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from typing import Any, TypeVar

import click

Number = TypeVar("Number", int, float)


class _Worded:
    """Help and messages of a range of click's: "0 to 60", where click says "0<=x<=60"."""

    min: Any
    max: Any
    min_open: bool
    max_open: bool

    def get_metavar(self, *_: Any, **__: Any) -> str:
        """What stands for the value in help: click makes it of the type's name, "INTEGER RANGE"."""
        return "NUMBER"

    def _describe_range(self) -> str:
        low = None if self.min is None else f"{'above ' if self.min_open else ''}{self.min:.15g}"
        high = None if self.max is None else f"{'below ' if self.max_open else ''}{self.max:.15g}"
        if high is None:
            return str(low) if self.min_open else f"{low} and above"
        if low is None:
            return high if self.max_open else f"{high} and below"
        return f"{low} to {high}"


class NumberRange(_Worded, click.FloatRange):
    """As click's; what is no number, or infinite, lies in no range."""

    name = "number"
    """For messages: click's own is "float range"."""

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


class WholeRange(_Worded, click.IntRange):
    """As click's."""

    name = "whole number"
    """For messages: click's own is "integer range"."""


def argument(kind: click.ParamType[Number]) -> Callable[[str], Number]:
    """The same range as an argument's type of `argparse`, for the tools."""

    def convert(text: str) -> Number:
        try:
            return kind.convert(text, None, None)
        except click.BadParameter as error:
            raise argparse.ArgumentTypeError(error.message) from error

    return convert
