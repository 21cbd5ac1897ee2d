"""Small files of settings, in YAML."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from host.core.errors import UserError

MAX_BYTES = 1_000_000
"""Of a machine's or a scenario's file: more is another file."""


def load_yaml(path: Path, what: str) -> Any:
    """What a YAML file says. UserError that begins with `what` (the kind of file) and names it
    where it cannot be read."""
    try:
        if path.stat().st_size > MAX_BYTES:
            raise UserError(f"{what} {path}: it has {path.stat().st_size / 1e6:.0f} MB")
        return yaml.safe_load(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise UserError(f"cannot read the {what} {path}: {error}") from error
    except (yaml.YAMLError, RecursionError, ValueError) as error:
        raise UserError(f"{what} {path} is not YAML: {error}".replace("\n", " ")) from error
