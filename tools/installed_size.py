"""What the field's program takes on a disk, and with the bench, as installed in this environment.

    python tools/installed_size.py

Counts the files of each distribution that `pip install .` and `pip install '.[bench]'` would bring,
by the installed packages' own lists, with the byte code beside them; the interpreter and pip come
on top (about 30 MB).
"""

from __future__ import annotations

import json
import re
import sys
from importlib import metadata
from pathlib import Path

from packaging.requirements import Requirement


def plain(name: str) -> str:
    """A distribution's name as it is compared."""
    return re.sub(r"[-_.]+", "-", name).lower()


def needed(name: str, extra: str = "") -> set[str]:
    """The distributions that one with an extra brings, itself apart."""
    found: set[str] = set()
    todo = [(name, extra)]
    seen: set[tuple[str, str]] = set()
    while todo:
        one = todo.pop()
        if one in seen:
            continue
        seen.add(one)
        for text in metadata.requires(one[0]) or ():
            wanted = Requirement(text)
            if wanted.marker and not any(
                wanted.marker.evaluate({"extra": each}) for each in {"", one[1]}
            ):
                continue
            found.add(plain(wanted.name))
            todo += [(wanted.name, each) for each in ("", *wanted.extras)]
    return found - {plain(name)}


def size_mb(name: str) -> float:
    """Of a distribution's files."""
    files = metadata.files(name) or ()
    paths = [Path(str(file.locate())) for file in files]
    return sum(path.stat().st_size for path in paths if path.is_file()) / 1e6


def main() -> int:
    """The command."""
    field = needed("daranti")
    bench = needed("daranti", "bench") | field
    sizes = {name: size_mb(name) for name in bench}
    found = {
        "field_MB": round(sum(sizes[name] for name in field)),
        "field_packages": len(field),
        "with_bench_MB": round(sum(sizes.values())),
        "with_bench_packages": len(bench),
    }
    for name in sorted(bench, key=lambda one: -sizes[one])[:12]:
        print(f"{sizes[name]:7.1f} MB  {name}{'' if name in field else '  (bench)'}")
    print(json.dumps(found))
    return 0


if __name__ == "__main__":
    sys.exit(main())
