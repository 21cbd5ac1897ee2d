"""Small files of settings, in YAML."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from host.core.errors import UserError
from host.core.input_file import check_input

MAX_BYTES = 1_000_000
"""Of a machine's or a scenario's file: more is another file."""


class OnceLoader(yaml.SafeLoader):
    """YAML's own safe loader takes the last of two values of the same key, without a word."""

    def compose_mapping_node(self, anchor: Any) -> yaml.MappingNode:
        node = super().compose_mapping_node(anchor)
        there: set[str] = set()
        for key, _ in node.value:
            if isinstance(key, yaml.ScalarNode):
                if key.value in there:
                    raise yaml.MarkedYAMLError(
                        problem=f"{key.value} is there twice; keep one", problem_mark=key.start_mark
                    )
                there.add(key.value)
        return node


def load_yaml(path: Path, what: str) -> Any:
    """What a YAML file says. UserError that begins with `what` (the kind of file) and names it
    where it cannot be read."""
    check_input(path, what)
    try:
        if path.stat().st_size > MAX_BYTES:
            raise UserError(f"{what} {path}: it has {path.stat().st_size / 1e6:.0f} MB")
        return yaml.load(path.read_text(encoding="utf-8"), OnceLoader)
    except OSError as error:
        raise UserError(f"cannot read the {what} {path}: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise UserError(f"{what} {path}: its text is not UTF-8; save it as UTF-8") from error
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = f", line {mark.line + 1}" if mark else ""
        raise UserError(f"{what} {path}{line}: not YAML: {error.problem}") from error
    except (yaml.YAMLError, RecursionError, ValueError) as error:
        raise UserError(f"{what} {path} is not YAML: {error}".replace("\n", " ")) from error
