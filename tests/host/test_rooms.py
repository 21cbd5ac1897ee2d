"""Facts about what the field's program is made of."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tomllib
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
