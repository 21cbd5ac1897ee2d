"""Seeds as an option's type."""

from __future__ import annotations

from typing import Any

import click

from hil.studies.campaign import seeds_of
from host.core.errors import UserError


class Seeds(click.ParamType[list[int]]):
    """`1-30`, `1,4,9` and mixtures: a list of numbers."""

    name = "1-30|1,4,9"

    def __init__(self, none: bool = False) -> None:
        """`none`: an empty text is no seed at all."""
        self._none = none

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> list[int]:
        """UserError for anything else."""
        del ctx
        if not isinstance(value, str):
            return list(value)
        try:
            return [] if self._none and not value else seeds_of(value)
        except ValueError as error:
            option = param.opts[0] if param is not None else "seeds"
            raise UserError(f"{option} {value}: say 1-30, or 1,4,9 ({error})") from error


SEEDS = Seeds()
SEEDS_OR_NONE = Seeds(none=True)
