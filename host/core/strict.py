"""The base of every typed file: what is not known is an error, what was read does not change."""

from __future__ import annotations

from typing import Any, get_args

from pydantic import BaseModel, ConfigDict, ValidationInfo, field_validator


class Strict(BaseModel):
    """Unknown keys are errors, values are immutable, numbers are finite."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    @field_validator("*", mode="before")
    @classmethod
    def _no_yes_for_a_number(cls, value: Any, info: ValidationInfo) -> Any:
        """pydantic takes yes and no, which YAML reads as true and false, for 1 and 0."""
        if isinstance(value, bool):
            kinds = _kinds(cls.model_fields[str(info.field_name)].annotation)
            if bool not in kinds and (int in kinds or float in kinds):
                raise ValueError("give a number, not yes or no")
        return value


def _kinds(annotation: Any) -> list[Any]:
    """A field's type, and those that it is made of: of Positive | None that is float, too."""
    return [annotation, *(kind for part in get_args(annotation) for kind in _kinds(part))]
