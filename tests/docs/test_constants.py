"""Every constant that tunes says what it means: a docstring behind it, or behind its group."""

from __future__ import annotations

import ast
from pathlib import Path

ROOT = Path(__file__).parents[2]
GENERATED = ROOT / "host" / "link" / "protocol.py"
MODULES = sorted(
    path
    for room in ("host", "hil", "sim_plant", "numba_cache")
    for path in (ROOT / room).rglob("*.py")
    if path != GENERATED
)
NUMBERS = (ast.Constant, ast.UnaryOp, ast.BinOp, ast.Tuple, ast.operator, ast.unaryop, ast.Load)


def tunes(node: ast.stmt) -> str:
    """The name of a constant that is made of numbers; empty where a statement is none."""
    if isinstance(node, ast.AnnAssign):
        target, value = node.target, node.value
    elif isinstance(node, ast.Assign):
        target, value = node.targets[0], node.value
    else:
        return ""
    first = target.elts[0] if isinstance(target, ast.Tuple) else target
    if not isinstance(first, ast.Name) or not first.id.isupper() or value is None:
        return ""
    parts = list(ast.walk(value))
    plain = [n for n in parts if not isinstance(n, NUMBERS)]
    calls = [n for n in parts if isinstance(n, ast.Call)]
    radians = [call for call in calls if ast.unparse(call.func) == "math.radians"]
    kinds = {type(n.value) for n in parts if isinstance(n, ast.Constant)}
    # Of a call of math.radians: itself, the attribute and the module's name.
    return first.id if kinds <= {int, float} and len(plain) == 3 * len(radians) else ""


def undocumented(text: str) -> list[str]:
    """Constants that no docstring follows, though others of their group may stand between."""
    found: list[str] = []
    waiting: list[str] = []
    for node in ast.parse(text).body:
        if name := tunes(node):
            waiting.append(name)
            continue
        says = isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
        found += [] if says else waiting
        waiting = []
    return found + waiting


def test_each_constant_that_tunes_says_what_it_means() -> None:
    found = {str(p.relative_to(ROOT)): undocumented(p.read_text("utf-8")) for p in MODULES}
    assert {path: names for path, names in found.items() if names} == {}


def test_a_constant_without_a_word_is_found() -> None:
    assert undocumented('A_M = 1.0\nB_M = 2.0\n"""Of both."""\nC_S = 3\n\nD = C_S\n') == ["C_S"]
