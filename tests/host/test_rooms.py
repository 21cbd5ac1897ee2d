"""Facts about what the field's program is made of."""

from __future__ import annotations

import ast
import json
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from importlib.metadata import packages_distributions
from pathlib import Path

ROOT = Path(__file__).parents[2]
IMPORT_ALL = """
import importlib, json, pkgutil, sys
for name in json.load(sys.stdin):
    sys.modules[name] = None  # importing it fails, as where it is not installed
import host
for module in pkgutil.walk_packages(host.__path__, "host."):
    importlib.import_module(module.name)
print(sum(name.startswith("host.") for name in sys.modules))
"""
OWN = {"daranti"}


def _name(requirement: str) -> str:
    found = re.match(r"[\w.-]+", requirement)
    assert found
    return re.sub(r"[-_.]+", "-", found[0]).lower()


def test_the_fields_program_runs_without_what_only_the_bench_needs() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    needed = {_name(each) for each in project["dependencies"]}
    extras = project["optional-dependencies"].values()
    others = {_name(each) for extra in extras for each in extra} - needed - OWN
    owners = {
        module: {_name(name) for name in names}
        for module, names in packages_distributions().items()
    }
    absent = [module for module, names in owners.items() if names <= others]
    assert {"optuna", "pandas", "distributed", "av"} <= set(absent)
    done = subprocess.run(
        [sys.executable, "-c", IMPORT_ALL],
        input=json.dumps([*absent, "hil", "sim_plant"]),
        capture_output=True,
        text=True,
        cwd=ROOT,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) > 80


WHILE_DRIVING = ("estimate", "field", "pilot", "route", "vision", "runs")
ON_PHOTOGRAPHS = {f"host.vision.photo.{name}" for name in ("fisher", "split", "curve")}


def _decorators(function: ast.AST) -> set[str]:
    decorators = function.decorator_list if isinstance(function, ast.FunctionDef) else ()
    return {ast.unparse(each).partition("(")[0].rpartition(".")[2] for each in decorators}


def _functions(tree: ast.Module) -> Iterator[ast.FunctionDef]:
    return (node for node in tree.body if isinstance(node, ast.FunctionDef))


def _known(module: str, tree: ast.Module) -> dict[str, str]:
    """What a module's names stand for."""
    own = {function.name: f"{module}.{function.name}" for function in _functions(tree)}
    imports = [node for node in tree.body if isinstance(node, ast.ImportFrom)]
    return own | {
        one.asname or one.name: f"{each.module}.{one.name}"
        for each in imports
        for one in each.names
    }


def _named_by_python(node: ast.AST, known: dict[str, str]) -> set[str]:
    """What is named outside of compiled functions."""
    if _decorators(node) & {"njit", "compiled"}:
        return set()
    found = set()
    if isinstance(node, ast.Name):
        found = {known.get(node.id, "")}
    elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
        found = {f"{known.get(node.value.id)}.{node.attr}"}
    return found.union(*(_named_by_python(each, known) for each in ast.iter_child_nodes(node)))


def test_what_python_calls_while_driving_says_its_types() -> None:
    """Else it is compiled in the middle of a drive: `host.core.compiled`."""
    trees = {
        ".".join(file.relative_to(ROOT).with_suffix("").parts): ast.parse(file.read_text())
        for room in WHILE_DRIVING
        for file in (ROOT / "host" / room).rglob("*.py")
    }
    named = set().union(*(_named_by_python(tree, _known(at, tree)) for at, tree in trees.items()))
    silent = {
        f"{at}.{function.name}"
        for at, tree in trees.items()
        if at not in ON_PHOTOGRAPHS
        for function in _functions(tree)
        if "njit" in _decorators(function)
    }
    assert len(silent) > 20
    assert silent & named == set()
