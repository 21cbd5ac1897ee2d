"""Writes firmware/src/core/protocol.h and host/link/protocol.py from firmware/protocol.toml.

`python tools/protogen.py` writes them, `python tools/protogen.py --check` fails when one of them
differs from what the schema says.
"""

from __future__ import annotations

import argparse
import math
import struct
import sys
import tomllib
from pathlib import Path
from typing import Any, Final

ROOT = Path(__file__).resolve().parent.parent
SCHEMA = ROOT / "firmware" / "protocol.toml"
HEADER = ROOT / "firmware" / "src" / "core" / "protocol.h"
MODULE = ROOT / "host" / "link" / "protocol.py"
RUNTIME = Path(__file__).with_name("protocol.py.in")

C_TYPES = {
    "u8": "uint8_t",
    "i8": "int8_t",
    "u16": "uint16_t",
    "i16": "int16_t",
    "u32": "uint32_t",
    "i32": "int32_t",
}
STRUCT_CODES = {"u8": "B", "i8": "b", "u16": "H", "i16": "h", "u32": "I", "i32": "i"}
UNIT_IN_PYTHON = {"deg": "rad"}
BANNER = "Generated from firmware/protocol.toml by tools/protogen.py. Do not edit."

Table = dict[str, Any]


class SchemaError(Exception):
    """The schema breaks one of its own rules; the message says where and how."""


def size_of(message: Table) -> int:
    """Payload length in bytes."""
    return struct.calcsize("<" + "".join(STRUCT_CODES[f["type"]] for f in message["fields"]))


def raw(param: Table, key: str) -> int:
    """A parameter's default, min or max as the integer on the wire."""
    return round(param[key] / param.get("scale", 1))


def load(path: Path) -> Table:
    """Reads the schema and holds it to its rules."""
    with path.open("rb") as file:
        schema = tomllib.load(file)
    ids: set[int] = set()
    for name, message in schema["message"].items():
        if message["id"] in ids:
            raise SchemaError(f"message {name}: id {message['id']} is taken")
        ids.add(message["id"])
        if message["to"] not in ("firmware", "host"):
            raise SchemaError(f"message {name}: `to` must be firmware or host")
        for field in message["fields"]:
            if field["type"] not in C_TYPES:
                raise SchemaError(f"message {name}, field {field['name']}: unknown type")
    for number, (name, param) in enumerate(schema["param"].items()):
        if param["id"] != number:
            raise SchemaError(f"param {name}: id must be {number} (dense, in order)")
        low, default, high = (raw(param, key) for key in ("min", "default", "max"))
        if not -32768 <= low <= default <= high <= 32767:
            raise SchemaError(f"param {name}: needs min <= default <= max within an i16, raw")
    return schema


def comment(doc: str) -> str:
    """A trailing C++ comment, or nothing."""
    return f"  // {doc}" if doc else ""


def describe(entry: Table, unit_map: dict[str, str] | None = None) -> str:
    """Unit, and what the schema says, for a trailing comment or a docstring."""
    unit = entry.get("unit", "")
    words = []
    if unit_map is None:
        scale = f"{entry['scale']:.6f}".rstrip("0") if "scale" in entry else "1"
        words.append(f"{scale} {unit}" if unit else "")
    else:
        words.append(unit_map.get(unit, unit))
    words.append(f"enum {entry['enum']}" if "enum" in entry and unit_map is None else "")
    words.append(f"bits {entry['bits']}" if "bits" in entry and unit_map is None else "")
    words.append(f"{entry['none']} = none" if "none" in entry and unit_map is None else "")
    words.append(entry.get("doc", ""))
    return "; ".join(word for word in words if word)


def header(schema: Table) -> str:
    """The C++ side: raw integers, sizes known at compile time, no allocation."""
    out = [
        f"// {BANNER}",
        "// clang-format off",
        "#pragma once",
        "#include <stddef.h>",
        "#include <stdint.h>",
        "",
        "namespace daranti {",
        "namespace protocol {",
        "",
        f"constexpr uint8_t kVersion = {schema['version']};",
        f"constexpr uint32_t kBaud = {schema['baud']};",
        "",
    ]
    for name, enum in schema["enum"].items():
        out += [f"// {enum['doc']}", f"enum class {name} : uint8_t {{"]
        out += [f"  {key} = {value}," for key, value in enum.items() if key != "doc"]
        out += ["};", ""]
    for name, bits in schema["bits"].items():
        out += [f"// {bits['doc']}", f"enum {name} : uint32_t {{"]
        for key, bit in bits.items():
            if key != "doc":
                out.append(f"  {key} = 1UL << {bit['bit']},{comment(bit['text'])}")
        out += ["};", ""]
    out += LITTLE_ENDIAN
    for name, message in schema["message"].items():
        out += _struct(name, message)
    out += [*_sizes(schema), *_params(schema)]
    out += ["", "}  // namespace protocol", "}  // namespace daranti"]
    return "\n".join(out) + "\n"


LITTLE_ENDIAN: Final = [
    "// Little-endian, whatever the compiler's machine is.",
    "template <typename T>",
    "inline T get(const uint8_t *from) {",
    "  uint32_t bits = 0;",
    "  for (size_t i = sizeof(T); i-- > 0;) bits = (bits << 8) | from[i];",
    "  return static_cast<T>(bits);",
    "}",
    "template <typename T>",
    "inline void put(uint8_t *to, T value) {",
    "  uint32_t bits = static_cast<uint32_t>(value);",
    "  for (size_t i = 0; i < sizeof(T); ++i, bits >>= 8) to[i] = static_cast<uint8_t>(bits);",
    "}",
    "",
]


def _struct(name: str, message: Table) -> list[str]:
    """A message of the C++ side, read where it goes to the firmware, written where to the host."""
    out = [f"// To the {message['to']}: {message['doc']}", f"struct {name} {{"]
    out.append(f"  static constexpr uint8_t kId = {message['id']};")
    out.append(f"  static constexpr uint8_t kSize = {size_of(message)};")
    offset = 0
    reads, writes = [], []
    for field in message["fields"]:
        ctype = C_TYPES[field["type"]]
        out.append(f"  {ctype} {field['name']};{comment(describe(field))}")
        at = f" + {offset}" if offset else ""
        reads.append(f"    m.{field['name']} = get<{ctype}>(payload{at});")
        writes.append(f"    put<{ctype}>(payload{at}, {field['name']});")
        offset += struct.calcsize("<" + STRUCT_CODES[field["type"]])
    if message["fields"] and message["to"] == "firmware":
        out += [f"  static {name} read(const uint8_t *payload) {{", f"    {name} m;"]
        out += [*reads, "    return m;", "  }"]
    if message["fields"] and message["to"] == "host":
        out += ["  void write(uint8_t *payload) const {", *writes, "  }"]
    return [*out, "};", ""]


def _sizes(schema: Table) -> list[str]:
    """What the C++ side knows of messages whose id it has not compared yet."""
    commands = {n: m for n, m in schema["message"].items() if m["to"] == "firmware"}
    answers = [m for m in schema["message"].values() if m["to"] == "host"]
    sizes = [size_of(m) for m in commands.values()]
    return [
        "// Payload length of a message to the firmware; -1 for an unknown id.",
        "inline int8_t command_size(uint8_t id) {",
        "  switch (id) {",
        *(f"    case {n}::kId:\n      return {n}::kSize;" for n in commands),
        *("    default:", "      return -1;", "  }", "}", ""),
        f"constexpr uint8_t kMinCommandSize = {min(sizes)};",
        f"constexpr uint8_t kMaxCommandSize = {max(sizes)};",
        f"constexpr uint8_t kMaxAnswerSize = {max(size_of(m) for m in answers)};",
        "",
    ]


def _params(schema: Table) -> list[str]:
    """The parameters of the C++ side: their ids, defaults and limits."""
    params = schema["param"]
    rows = [
        f"  X({n}, {raw(p, 'default')}, {raw(p, 'min')}, {raw(p, 'max')})"
        for n, p in params.items()
    ]
    return [
        *("// Parameters, in the order of their ids.", "enum class Param : uint8_t {"),
        *(f"  {n},{comment(describe(p))}" for n, p in params.items()),
        *("};", f"constexpr uint8_t kParams = {len(params)};", ""),
        *("// X(name, default, min, max), raw", "#define DARANTI_PARAMS(X) \\"),
        " \\\n".join(rows),
    ]


def field_type(field: Table) -> str:
    """The dataclass field's annotation."""
    if "enum" in field or "bits" in field:
        return str(field.get("enum") or field.get("bits"))
    base = "float" if "scale" in field else "int"
    return f"{base} | None" if "none" in field else base


def scale_of(field: Table) -> float:
    """What one on the wire is of the value in Python."""
    return float(field["scale"] * (math.pi / 180 if field.get("unit") == "deg" else 1.0))


def _raws(fields: list[Table]) -> list[str]:
    """A message's integers on the wire, written out."""
    values = []
    for field in fields:
        own = f"self.{field['name']}"
        value = f"round({own} / {scale_of(field)!r})" if "scale" in field else f"int({own})"
        if "none" in field:
            value = f"{field['none']} if {own} is None else {value}"
        values.append(f"            {value},")
    return [
        "    def raws(self) -> tuple[int, ...]:",
        '        """The integers on the wire."""',
        *(("        return (", *values, "        )") if fields else ("        return ()",)),
    ]


def _of(name: str, fields: list[Table]) -> list[str]:
    """A message's constructor from the integers on the wire, written out."""
    values = []
    for field in fields:
        value = field["name"]
        kind = field.get("enum") or field.get("bits")
        if kind:
            value = f"_{kind.upper()}({value})"
        elif "scale" in field:
            value = f"{value} * {scale_of(field)!r}"
        if "none" in field:
            value = f"None if {field['name']} == {field['none']} else {value}"
        values.append(f"            {value},")
    names = ", ".join(field["name"] for field in fields)
    return [
        "    @classmethod",
        f"    def of(cls, *raws: int) -> {name}:",
        '        """From the integers on the wire."""',
        f"        ({names},) = raws" if fields else "        () = raws",
        "        return cls(",
        *values,
        "        )",
    ]


def module(schema: Table) -> str:
    """The Python side: the hand-written runtime with the schema's types put in."""
    head, tail = RUNTIME.read_text().split("# ---- generated types go here ----\n")
    out = [f"VERSION = {schema['version']}", f"BAUD = {schema['baud']}", ""]
    for name, enum in schema["enum"].items():
        out += ["", f"class {name}(enum.IntEnum):", f'    """{enum["doc"]}"""', ""]
        out += [f"    {key} = {value}" for key, value in enum.items() if key != "doc"]
        out += ["", "", f"_{name.upper()} = functools.cache({name})", ""]
    for name, bits in schema["bits"].items():
        members = {key: bit for key, bit in bits.items() if key != "doc"}
        out += ["", f"class {name}(enum.IntFlag):", f'    """{bits["doc"]}"""', ""]
        out += [f"    {key} = 1 << {bit['bit']}" for key, bit in members.items()]
        out += ["", "", f"_{name.upper()} = functools.cache({name})", ""]
        out += ["", f"{name.upper()}_TEXTS: dict[{name}, tuple[str, str]] = {{"]
        for key, bit in members.items():
            out += [f"    {name}.{key}: (", f'        "{bit["text"]}",']
            out += [f'        "{bit["remedy"]}",', "    ),"]
        out += ["}", '"""What each bit means, and what to do about it."""', ""]
    for name, message in schema["message"].items():
        out += ["", "@dataclass(frozen=True, slots=True)", f"class {name}(Message):"]
        out += [f'    """To the {message["to"]}: {message["doc"]}"""', ""]
        for field in message["fields"]:
            out.append(f"    {field['name']}: {field_type(field)}")
            if doc := describe(field, UNIT_IN_PYTHON):
                out.append(f'    """{doc}"""')
        out += [""] if message["fields"] else []
        layout = "<" + "".join(STRUCT_CODES[f["type"]] for f in message["fields"])
        out.append(f"    ID: ClassVar[int] = {message['id']}")
        out.append(f'    LAYOUT: ClassVar[struct.Struct] = struct.Struct("{layout}")')
        out += ["", *_raws(message["fields"]), "", *_of(name, message["fields"]), ""]
    out += ["", "MESSAGES: tuple[type[Message], ...] = ("]
    out += [f"    {name}," for name in schema["message"]] + [")", ""]
    out += ["PARAMS: dict[str, ParamSpec] = {"]
    for name, param in schema["param"].items():
        out += [f'    "{name}": ParamSpec(', f'        "{name}",', f"        {param['id']},"]
        out += [f"        {float(param.get('scale', 1))!r},"]
        out += [f"        {raw(param, key)}," for key in ("default", "min", "max")]
        out += [
            f'        "{param.get("unit", "")}",',
            f'        "{param.get("doc", "")}",',
            "    ),",
        ]
    out += ["}", ""]
    return f'"""{BANNER}\n\n' + head.removeprefix('"""') + "\n".join(out) + tail


def main() -> int:
    """Command line: write both files, or compare them with the schema."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--check", action="store_true", help="fail when a generated file differs")
    check = parser.parse_args().check
    try:
        schema = load(SCHEMA)
    except (SchemaError, tomllib.TOMLDecodeError, KeyError) as error:
        print(f"{SCHEMA.relative_to(ROOT)}: {error}", file=sys.stderr)
        return 1
    stale = []
    for path, text in ((HEADER, header(schema)), (MODULE, module(schema))):
        if path.exists() and path.read_text() == text:
            continue
        stale.append(str(path.relative_to(ROOT)))
        if not check:
            path.write_text(text)
    if check and stale:
        print(
            f"{', '.join(stale)}: not what {SCHEMA.relative_to(ROOT)} says; "
            "run python tools/protogen.py",
            file=sys.stderr,
        )
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
