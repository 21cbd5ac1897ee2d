"""The panel's texts: one JSON file a language, the same keys in each. `{name}` is filled in."""

from __future__ import annotations

import json
from functools import cache
from importlib import resources
from typing import Final

LANGUAGES: Final = ("en", "ur")


@cache
def texts(language: str) -> dict[str, str]:
    """All texts of a language by key."""
    file = resources.files("host.panel") / "texts" / f"{language}.json"
    found = json.loads(file.read_text(encoding="utf-8"))
    return {str(key): str(text) for key, text in found.items()}


def text(language: str, key: str, **values: object) -> str:
    """One text, filled in; the key itself where the language lacks it."""
    found = texts(language).get(key, key)
    for name, value in values.items():
        found = found.replace(
            "{" + name + "}", f"{value:g}" if isinstance(value, float) else str(value)
        )
    return found
