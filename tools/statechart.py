"""Draws the pilot's statechart (Mermaid) from its code: docs/understand/pilot.md.

A handler's transitions are the `self._go(now, Phase.X, reason)` calls in it and in the methods that
it calls. `--check` exits with 1 where the document is not what the code says.
"""

from __future__ import annotations

import ast
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
SOURCE = ROOT / "host" / "pilot" / "pilot.py"
DOCUMENT = ROOT / "docs" / "understand" / "pilot.md"


def _called(method: ast.FunctionDef) -> set[str]:
    """Names of the pilot's own methods that a method calls."""
    return {
        node.func.attr
        for node in ast.walk(method)
        if isinstance(node, ast.Call)
        and isinstance(node.func, ast.Attribute)
        and isinstance(node.func.value, ast.Name)
        and node.func.value.id == "self"
    }


def _words(reason: ast.expr) -> str:
    """A reason as it reads, its variable parts as an ellipsis."""
    if isinstance(reason, ast.JoinedStr):
        parts = [p.value if isinstance(p, ast.Constant) else "…" for p in reason.values]
        return "".join(str(part) for part in parts)
    return str(reason.value) if isinstance(reason, ast.Constant) else "…"


def _transitions(method: ast.FunctionDef) -> list[tuple[str, str]]:
    """(phase, reason) of the _go calls in a method itself."""
    out = []
    for node in ast.walk(method):
        if isinstance(node, ast.Call) and ast.unparse(node.func) == "self._go":
            phase, reason = node.args[1], node.args[2]
            if isinstance(phase, ast.Attribute):
                out.append((phase.attr, _words(reason)))
    return out


def chart() -> str:
    """The document."""
    tree = ast.parse(SOURCE.read_text(encoding="utf-8"))
    pilot = next(n for n in tree.body if isinstance(n, ast.ClassDef) and n.name == "Pilot")
    methods = {n.name: n for n in pilot.body if isinstance(n, ast.FunctionDef)}
    table = next(
        node
        for node in ast.walk(methods["step"])
        if isinstance(node, ast.Dict) and node.keys and ast.unparse(node.keys[0] or tree) != ""
    )
    handlers = {
        key.attr: value.attr
        for key, value in zip(table.keys, table.values, strict=True)
        if isinstance(key, ast.Attribute) and isinstance(value, ast.Attribute)
    }
    lines = ["```mermaid", "stateDiagram-v2", f"    [*] --> {next(iter(handlers))}"]
    rows = []
    for phase, handler in handlers.items():
        seen, queue = set(), [handler]
        while queue:
            name = queue.pop()
            if name in seen or name not in methods or name == "_go":
                continue
            seen.add(name)
            queue += sorted(_called(methods[name]))
            for target, reason in _transitions(methods[name]):
                rows.append((phase, target, reason))
    for name in ("step", "_fenced"):
        rows += [("any", target, reason) for target, reason in _transitions(methods[name])]
    for phase, target, reason in dict.fromkeys(rows):
        if phase not in ("any", target):
            lines.append(f"    {phase} --> {target}: {reason.replace(':', ' -')}")
    lines.append("```")
    anywhere = [f"- to {target}: {reason}" for phase, target, reason in rows if phase == "any"]
    return "\n".join(
        [
            "# The pilot's states",
            "",
            "Drawn from `host/pilot/pilot.py` by `tools/statechart.py`. Every transition",
            "carries its reason, which the operator sees and the record keeps.",
            "",
            *lines,
            "",
            "From any state but CONNECT and FINISHED:",
            "",
            *dict.fromkeys(anywhere),
            "",
        ]
    )


def main() -> int:
    """Writes or checks."""
    text = chart()
    if "--check" in sys.argv:
        if not DOCUMENT.exists() or DOCUMENT.read_text(encoding="utf-8") != text:
            print(f"{DOCUMENT}: not what the code says; run tools/statechart.py", file=sys.stderr)
            return 1
        return 0
    DOCUMENT.write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
