"""Mutation testing of the firmware core: one binary holds all mutants behind an id.

Every operator, literal, condition and statement of the sources below is replaced by a call that
knows its alternatives (tools/mutate.h); the environment variable MUTANT chooses one of them at run
time. The unit tests then run once per mutant. A mutant that no test notices survives; those listed
in firmware/test/mutants.toml with the reason why they are equivalent are expected to. Any other
survivor makes this fail, as does a listed one that no longer exists or is killed.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tomllib
from collections import Counter, defaultdict
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from clang import cindex
from clang.cindex import CursorKind as Kind

ROOT = Path(__file__).resolve().parent.parent
SOURCE = ROOT / "firmware" / "src" / "core"
TESTS = ROOT / "firmware" / "test" / "test_core"
EQUIVALENT = ROOT / "firmware" / "test" / "mutants.toml"
OUT = ROOT / "build" / "mutate"
FILES = (
    "blade.cpp",
    "blade.h",
    "bridge.cpp",
    "controller.cpp",
    "current.cpp",
    "drive.cpp",
    "drive.h",
    "fault_log.cpp",
    "fault_log.h",
    "fixed.h",
    "frame.cpp",
    "params.cpp",
    "params.h",
    "pid.cpp",
    "pulse_filter.h",
    "steering.cpp",
    "supervisor.cpp",
    "supervisor.h",
)
TIMEOUT_S = 20
"""Of processor time: a mutant that loops for ever counts as killed, whatever else runs here."""
SANITIZE = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all")
"""A mutant that writes where it must not is killed by that."""

BINARY = {
    "<": ("lt", ("<=", ">=")),
    ">": ("gt", (">=", "<=")),
    "<=": ("le", ("<", ">")),
    ">=": ("ge", (">", "<")),
    "==": ("eq", ("!=",)),
    "!=": ("ne", ("==",)),
    "+": ("add", ("-",)),
    "-": ("sub", ("+",)),
    "*": ("mul", ("+",)),
    "/": ("div", ("*",)),
    "%": ("mod", ("+",)),
    "<<": ("shl", (">>",)),
    ">>": ("shr", ("<<",)),
    "&": ("band", ("|",)),
    "|": ("bor", ("&",)),
    "^": ("bxor", ("|",)),
    "&&": ("land", ("||", "")),
    "||": ("lor", ("&&", "")),
    "+=": ("add_to", ("-=",)),
    "-=": ("sub_from", ("+=",)),
    "|=": ("or_to", ("&=",)),
    "&=": ("and_to", ("|=",)),
}


class Name(NamedTuple):
    """What a mutant is called; nothing in it changes when lines move."""

    file: str
    function: str
    original: str
    mutated: str

    def __str__(self) -> str:
        return f"{self.file} {self.function}: {self.original}  ->  {self.mutated}"


@dataclass
class Mutant:
    """One change."""

    id: int
    line: int
    name: Name


@dataclass
class Rewriter:
    """Collects the edits of one file."""

    name: str
    source: bytes
    mutants: list[Mutant]
    function: str = ""
    """Where `visit` is."""
    names: Counter[Name] = field(default_factory=Counter)
    """How many mutants would have had this name; from the second on it carries a number."""
    openings: dict[int, list[str]] = field(default_factory=lambda: defaultdict(list))
    closings: dict[int, list[str]] = field(default_factory=lambda: defaultdict(list))
    replaced: dict[int, tuple[int, str]] = field(default_factory=dict)

    def add(self, node: Any, *changes: str, within: Any = None) -> int:
        """Registers what may stand in the node's place and returns the first one's id. `within`: a
        node around it, whose text then names the mutants."""
        first = len(self.mutants)
        around = within or node
        start, end = node.extent.start.offset, node.extent.end.offset
        original = self._plain(around.extent.start.offset, around.extent.end.offset)
        for change in changes:
            before = self.source[around.extent.start.offset : start].decode()
            after = self.source[end : around.extent.end.offset].decode()
            mutated = " ".join(f"{before}{change}{after}".split())
            name = Name(self.name, self.function, original, mutated)
            self.names[name] += 1
            if self.names[name] > 1:
                name = name._replace(mutated=f"{mutated} [{self.names[name]}]")
            self.mutants.append(Mutant(len(self.mutants), node.extent.start.line, name))
        return first

    def _plain(self, start: int, end: int) -> str:
        return " ".join(self.source[start:end].decode().split())

    def text_of(self, node: Any) -> str:
        """The node's source in one line."""
        return self._plain(node.extent.start.offset, node.extent.end.offset)

    def wrap(self, node: Any, before: str, after: str) -> None:
        """Puts text round a node; outer nodes must be wrapped before inner ones."""
        self.openings[node.extent.start.offset].append(before)
        self.closings[node.extent.end.offset].insert(0, after)

    def text(self) -> str:
        """The mutated source."""
        out = ['#include "mutate.h"\n'] if self.name.endswith(".cpp") else []
        at = 0
        source = self.source
        points = sorted({*self.openings, *self.closings, *self.replaced, len(source)})
        for point in points:
            out.append(source[at:point].decode())
            at = point
            out += self.closings.get(point, [])
            out += self.openings.get(point, [])
            if point in self.replaced:
                length, text = self.replaced[point]
                out.append(text)
                at += length
        return "".join(out)


def is_constant(node: Any) -> bool:
    """Whether the language wants a constant expression here."""
    return node.kind in (Kind.STATIC_ASSERT, Kind.TEMPLATE_REF, Kind.TYPE_REF, Kind.ENUM_DECL)


def operator_token(node: Any, left: Any, right: Any) -> Any:
    """The token between a binary operator's operands."""
    for token in node.get_tokens():
        offset = token.extent.start.offset
        if left.extent.end.offset <= offset < right.extent.start.offset and token.spelling != ")":
            return token
    return None


def around(node: Any, parents: Sequence[Any]) -> Any:
    """The nearest node that has more text than this one, or the statement of a bare value."""
    extent = node.extent
    for parent in reversed(parents):
        wider = parent.extent.end.offset - parent.extent.start.offset
        if wider > extent.end.offset - extent.start.offset:
            return parent
    return node


def visit(node: Any, parents: Sequence[Any], out: Rewriter, literals: bool) -> None:
    """Registers what can change at this node, then goes on inside it. parents: outermost first."""
    children = list(node.get_children())
    inside = (*parents, node)
    if is_constant(node):
        return
    if node.kind == Kind.CASE_STMT:
        for child in children[1:]:
            visit(child, inside, out, literals)
        return
    if node.kind in (Kind.VAR_DECL, Kind.FUNCTION_DECL, Kind.FIELD_DECL):
        for token in node.get_tokens():
            if token.spelling == "constexpr":
                inline = "inline" if node.kind == Kind.FUNCTION_DECL else "const"
                if any(child.kind == Kind.INIT_LIST_EXPR for child in children):
                    return
                out.replaced[token.extent.start.offset] = (len("constexpr"), inline)
                break
            if token.spelling in ("{", "="):
                break
    statement = node.kind in (
        Kind.CALL_EXPR,
        Kind.COMPOUND_ASSIGNMENT_OPERATOR,
        Kind.UNARY_OPERATOR,
        Kind.BINARY_OPERATOR,
    )
    if statement and parents[-1].kind == Kind.COMPOUND_STMT:
        number = out.add(node, "")
        out.wrap(node, f"if (!mut::is({number})) ", "")
    if node.kind in (Kind.BINARY_OPERATOR, Kind.COMPOUND_ASSIGNMENT_OPERATOR):
        left, right = children
        token = operator_token(node, left, right)
        if token is not None and token.spelling in BINARY:
            name, changes = BINARY[token.spelling]
            before = out.text_of(left)
            after = out.text_of(right)
            changed = [f"{before} {c} {after}" if c else before for c in changes]
            number = out.add(node, *changed)
            lazy = name in ("land", "lor")
            before, between, after = (
                (f"mut::{name}({number}, [&] {{ return bool(", "); }, [&] { return bool(", "); })")
                if lazy
                else (f"mut::{name}({number}, ", ", ", ")")
            )
            out.wrap(node, before, after)
            spelling = token.spelling
            out.replaced[token.extent.start.offset] = (len(spelling), between)
    elif node.kind == Kind.UNARY_OPERATOR:
        first = next((token.spelling for token in node.get_tokens()), "")
        if first in ("!", "-") and children:
            number = out.add(node, out.text_of(children[0]), within=around(node, parents))
            out.wrap(node, f"mut::{'lnot' if first == '!' else 'neg'}({number}, ", ")")
            out.replaced[node.extent.start.offset] = (1, " ")
    elif node.kind == Kind.INTEGER_LITERAL and literals:
        number = out.add(node, f"({out.text_of(node)} + 1)", within=around(node, parents))
        out.wrap(node, f"mut::lit({number}, ", ")")
    elif node.kind == Kind.CXX_BOOL_LITERAL_EXPR:
        flipped = "false" if out.text_of(node) == "true" else "true"
        number = out.add(node, flipped, within=around(node, parents))
        out.wrap(node, f"mut::cond({number}, ", ")")
    if node.kind in (Kind.IF_STMT, Kind.CONDITIONAL_OPERATOR, Kind.WHILE_STMT) and children:
        condition = children[0]
        while condition.kind == Kind.UNEXPOSED_EXPR:
            inner = list(condition.get_children())
            if len(inner) != 1:
                break
            condition = inner[0]
        if condition.kind not in (Kind.BINARY_OPERATOR, Kind.UNARY_OPERATOR):
            number = out.add(condition, f"!({out.text_of(condition)})")
            out.wrap(condition, f"mut::cond({number}, bool(", "))")
    inner_literals = literals and node.kind != Kind.INIT_LIST_EXPR
    for child in children:
        visit(child, inside, out, inner_literals)


def mutate_file(name: str, mutants: list[Mutant]) -> str:
    """The file with all its mutants in it."""
    path = SOURCE / name
    system = subprocess.run(
        ["g++", "-print-file-name=include"], capture_output=True, text=True, check=True
    ).stdout.strip()
    arguments = ["-x", "c++", "-std=c++17", f"-I{SOURCE}", f"-I{system}"]
    unit = cindex.Index.create().parse(str(path), args=arguments)
    errors = [d for d in unit.diagnostics if d.severity >= cindex.Diagnostic.Error]
    if errors:
        raise SystemExit(f"{path}: {errors[0].spelling}")
    out = Rewriter(name, path.read_bytes(), mutants)

    def descend(node: Any) -> None:
        for child in node.get_children():
            where = child.location.file
            if where is None or Path(where.name) != path:
                continue
            if child.kind in (Kind.NAMESPACE, Kind.CLASS_DECL, Kind.STRUCT_DECL):
                descend(child)
            elif child.kind in (Kind.FUNCTION_DECL, Kind.CXX_METHOD, Kind.CONSTRUCTOR) or (
                child.kind == Kind.VAR_DECL
                and name.endswith(".cpp")
                and "[" not in child.type.spelling
            ):
                owner = child.semantic_parent
                inside = owner.kind in (Kind.CLASS_DECL, Kind.STRUCT_DECL)
                out.function = f"{owner.spelling}::{child.spelling}" if inside else child.spelling
                visit(child, (node,), out, True)

    descend(unit.cursor)
    return out.text()


def build(mutants: list[Mutant], files: Sequence[str]) -> Path:
    """Writes the mutated sources and compiles them with the unit tests."""
    sources = OUT / "src"
    sources.mkdir(parents=True, exist_ok=True)
    for path in SOURCE.glob("*.[ch]*"):
        if path.name not in files:
            (sources / path.name).write_bytes(path.read_bytes())
    (sources / "mutate.h").write_bytes((ROOT / "tools" / "mutate.h").read_bytes())
    for name in files:
        text = mutate_file(name, mutants)
        if name.endswith(".h"):
            text = text.replace("#pragma once", '#pragma once\n#include "mutate.h"', 1)
        (sources / name).write_text(text)
    binary = OUT / "suite"
    objects = []
    commands = []
    for path in [*sources.glob("*.cpp"), *TESTS.glob("*.cpp")]:
        target = OUT / f"{path.parent.name}_{path.stem}.o"
        objects.append(str(target))
        flags = ["-std=c++17", "-O1", "-w", *SANITIZE, f"-I{sources}", "-I/usr/include/doctest"]
        commands.append(["g++", *flags, "-c", str(path), "-o", str(target)])
    with ThreadPoolExecutor(2) as pool:
        for done in pool.map(
            lambda c: subprocess.run(c, capture_output=True, text=True, check=False), commands
        ):
            if done.returncode != 0:
                raise SystemExit(done.stderr[:4000])
    subprocess.run(["g++", *SANITIZE, "-o", str(binary), *objects], check=True)
    return binary


def survives(binary: Path, mutant: int) -> bool:
    """Whether the whole suite passes with this mutant."""
    environment = {**os.environ, "MUTANT": str(mutant)}
    command = [str(binary), "-s=false", "-aa=1", "--no-version", "--no-exitcode=false"]
    done = subprocess.run(
        ["prlimit", f"--cpu={TIMEOUT_S}", *command],
        env=environment,
        capture_output=True,
        check=False,
    )
    return done.returncode == 0


def read_list() -> set[Name]:
    """The mutants that are known to be equivalent."""
    if not EQUIVALENT.exists():
        return set()
    try:
        entries = tomllib.loads(EQUIVALENT.read_text())["equivalent"]
        names = [Name(*(entry[key] for key in Name._fields)) for entry in entries]
        bare = [name for name, entry in zip(names, entries, strict=True) if not entry["reason"]]
    except (tomllib.TOMLDecodeError, KeyError) as error:
        raise SystemExit(f"{EQUIVALENT}: not a list of [[equivalent]]: {error}") from error
    if bare:
        raise SystemExit(f"{EQUIVALENT}: no reason is given for {bare[0]}")
    return set(names)


def main() -> int:
    """Builds, runs every mutant, prints the table and the survivors."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "files", nargs="*", choices=[*FILES, []], metavar="FILE", help="default: all"
    )
    files = parser.parse_args().files or FILES
    mutants: list[Mutant] = []
    binary = build(mutants, files)
    if not survives(binary, -1):
        print("the unit tests fail without any mutant: mend them first", file=sys.stderr)
        return 1
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        results = list(pool.map(lambda m: survives(binary, m.id), mutants))
    alive = [mutant for mutant, survived in zip(mutants, results, strict=True) if survived]
    listed = {name for name in read_list() if name.file in files}
    total = Counter(mutant.name.file for mutant in mutants)
    left = Counter(mutant.name.file for mutant in alive)
    print(f"{'file':<18}{'mutants':>8}{'killed':>8}{'survive':>9}")
    for name in files:
        print(f"{name:<18}{total[name]:>8}{total[name] - left[name]:>8}{left[name]:>9}")
    print(f"{'total':<18}{len(mutants):>8}{len(mutants) - len(alive):>8}{len(alive):>9}")
    unlisted = [mutant for mutant in alive if mutant.name not in listed]
    for mutant in unlisted:
        print(f"SURVIVES {mutant.line} {mutant.name}")
    stale = listed - {mutant.name for mutant in alive}
    for stale_name in sorted(stale):
        print(f"LISTED BUT KILLED OR GONE {stale_name}")
    if not unlisted:
        count = len(alive)
        print(f"no unlisted survivor; {count} are listed as equivalent in {EQUIVALENT.name}")
    return 1 if unlisted or stale else 0


if __name__ == "__main__":
    sys.exit(main())
