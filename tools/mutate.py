"""Mutation testing of the firmware core: one binary holds all mutants behind an id.

Every operator, literal, condition and statement of the sources below is replaced by a call that
knows its alternatives (tools/mutate.h); the environment variable MUTANT chooses one of them at run
time. The unit tests then run once per mutant. A mutant that no test notices survives; those listed
in firmware/test/mutants.toml with the reason why they are equivalent are expected to. Any other
survivor makes this fail, as does a listed one that no longer exists or is killed.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tomllib
from collections import Counter, defaultdict
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from clang import cindex
from clang.cindex import CursorKind as Kind

ROOT = Path(__file__).resolve().parent.parent
SOURCE = ROOT / "firmware" / "src"
TESTS = ROOT / "firmware" / "test" / "test_core"
EQUIVALENT = ROOT / "firmware" / "test" / "mutants.toml"
OUT = ROOT / "build" / "mutate"
FILES = (
    "bridge.cpp",
    "controller.cpp",
    "drive.cpp",
    "fixed.h",
    "frame.cpp",
    "params.cpp",
    "pid.cpp",
    "steering.cpp",
    "supervisor.cpp",
    "supervisor.h",
)
TIMEOUT_S = 20
"""A mutant that loops for ever counts as killed."""

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
    "&&": ("land", ("||", "left side only")),
    "||": ("lor", ("&&", "left side only")),
    "+=": ("add_to", ("-=",)),
    "-=": ("sub_from", ("+=",)),
    "|=": ("or_to", ("&=",)),
    "&=": ("and_to", ("|=",)),
}


@dataclass
class Mutant:
    """One change; `key` names it independently of line numbers."""

    id: int
    file: str
    line: int
    text: str
    change: str

    @property
    def key(self) -> str:
        return f"{self.file} | {self.text} | {self.change}"


@dataclass
class Rewriter:
    """Collects the edits of one file."""

    name: str
    source: bytes
    mutants: list[Mutant]
    openings: dict[int, list[str]] = field(default_factory=lambda: defaultdict(list))
    closings: dict[int, list[str]] = field(default_factory=lambda: defaultdict(list))
    replaced: dict[int, tuple[int, str]] = field(default_factory=dict)

    def add(self, node: Any, *changes: str) -> int:
        """Registers the changes at a node and returns the first one's id."""
        first = len(self.mutants)
        line = node.extent.start.line
        text = self.source.decode().splitlines()[line - 1].strip()
        what = self.source[node.extent.start.offset : node.extent.end.offset].decode()
        what = " ".join(what.split())
        for change in changes:
            self.mutants.append(
                Mutant(len(self.mutants), self.name, line, text, f"{what}: {change}")
            )
        return first

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


def visit(node: Any, parent: Any, out: Rewriter, literals: bool) -> None:
    """Registers what can change at this node, then goes on inside it."""
    children = list(node.get_children())
    if is_constant(node):
        return
    if node.kind == Kind.CASE_STMT:
        for child in children[1:]:
            visit(child, node, out, literals)
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
    if statement and parent.kind == Kind.COMPOUND_STMT:
        number = out.add(node, "deleted")
        out.wrap(node, f"if (!mut::is({number})) ", "")
    if node.kind in (Kind.BINARY_OPERATOR, Kind.COMPOUND_ASSIGNMENT_OPERATOR):
        left, right = children
        token = operator_token(node, left, right)
        if token is not None and token.spelling in BINARY:
            name, changes = BINARY[token.spelling]
            number = out.add(node, *changes)
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
            number = out.add(node, f"without {first}")
            out.wrap(node, f"mut::{'lnot' if first == '!' else 'neg'}({number}, ", ")")
            out.replaced[node.extent.start.offset] = (1, " ")
    elif node.kind == Kind.INTEGER_LITERAL and literals:
        number = out.add(node, "+ 1")
        out.wrap(node, f"mut::lit({number}, ", ")")
    elif node.kind == Kind.CXX_BOOL_LITERAL_EXPR:
        number = out.add(node, "flipped")
        out.wrap(node, f"mut::cond({number}, ", ")")
    if node.kind in (Kind.IF_STMT, Kind.CONDITIONAL_OPERATOR, Kind.WHILE_STMT) and children:
        condition = children[0]
        while condition.kind == Kind.UNEXPOSED_EXPR:
            inner = list(condition.get_children())
            if len(inner) != 1:
                break
            condition = inner[0]
        if condition.kind not in (Kind.BINARY_OPERATOR, Kind.UNARY_OPERATOR):
            number = out.add(condition, "negated")
            out.wrap(condition, f"mut::cond({number}, bool(", "))")
    inner_literals = literals and node.kind != Kind.INIT_LIST_EXPR
    for child in children:
        visit(child, node, out, inner_literals)


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
                visit(child, node, out, True)

    descend(unit.cursor)
    return out.text()


def build(mutants: list[Mutant]) -> Path:
    """Writes the mutated sources and compiles them with the unit tests."""
    sources = OUT / "src"
    sources.mkdir(parents=True, exist_ok=True)
    for path in SOURCE.glob("*.[ch]*"):
        if path.name not in FILES:
            (sources / path.name).write_bytes(path.read_bytes())
    (sources / "mutate.h").write_bytes((ROOT / "tools" / "mutate.h").read_bytes())
    for name in FILES:
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
        flags = ["-std=c++17", "-O0", "-w", f"-I{sources}", "-I/usr/include/doctest"]
        commands.append(["g++", *flags, "-c", str(path), "-o", str(target)])
    with ThreadPoolExecutor(2) as pool:
        for done in pool.map(
            lambda c: subprocess.run(c, capture_output=True, text=True, check=False), commands
        ):
            if done.returncode != 0:
                raise SystemExit(done.stderr[:4000])
    subprocess.run(["g++", "-o", str(binary), *objects], check=True)
    return binary


def survives(binary: Path, mutant: int) -> bool:
    """Whether the whole suite passes with this mutant."""
    environment = {**os.environ, "MUTANT": str(mutant)}
    command = [str(binary), "-s=false", "-aa=1", "--no-version", "--no-exitcode=false"]
    try:
        done = subprocess.run(
            command, env=environment, capture_output=True, timeout=TIMEOUT_S, check=False
        )
    except subprocess.TimeoutExpired:
        return False
    return done.returncode == 0


def main() -> int:
    """Builds, runs every mutant, prints the table and the survivors."""
    mutants: list[Mutant] = []
    binary = build(mutants)
    if not survives(binary, -1):
        print("the unit tests fail without any mutant: mend them first", file=sys.stderr)
        return 1
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        results = list(pool.map(lambda m: survives(binary, m.id), mutants))
    alive = [mutant for mutant, survived in zip(mutants, results, strict=True) if survived]
    listed: dict[str, str] = {}
    if EQUIVALENT.exists():
        listed = tomllib.loads(EQUIVALENT.read_text())["equivalent"]
    total, left = Counter(m.file for m in mutants), Counter(m.file for m in alive)
    print(f"{'file':<18}{'mutants':>8}{'killed':>8}{'survive':>9}")
    for name in FILES:
        print(f"{name:<18}{total[name]:>8}{total[name] - left[name]:>8}{left[name]:>9}")
    print(f"{'total':<18}{len(mutants):>8}{len(mutants) - len(alive):>8}{len(alive):>9}")
    unlisted = [mutant for mutant in alive if mutant.key not in listed]
    stale = set(listed) - {mutant.key for mutant in alive}
    for mutant in unlisted:
        print(f"SURVIVES {mutant.file}:{mutant.line}: {mutant.key}")
    for key in sorted(stale):
        print(f"LISTED BUT KILLED OR GONE {key}")
    print(f"{len(alive) - len(unlisted)} survivors are listed as equivalent in {EQUIVALENT.name}")
    return 1 if unlisted or stale else 0


if __name__ == "__main__":
    sys.exit(main())
