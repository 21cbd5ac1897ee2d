"""The type of the `cli` fixture: arguments in, (exit code, stdout, stderr) out."""

from collections.abc import Callable

Cli = Callable[..., tuple[int, str, str]]
