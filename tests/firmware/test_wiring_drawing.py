"""The wiring drawing (docs/build/wiring.yaml), its picture and the builder's pin table are the pin
headers'."""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path
from typing import Any, Final
from xml.etree import ElementTree

import yaml
from matplotlib.font_manager import FontProperties
from matplotlib.textpath import TextPath

ROOT: Final = Path(__file__).parents[2]
BUILD: Final = ROOT / "docs" / "build"
README: Final = (BUILD / "README.md").read_text(encoding="utf-8")
A0: Final = {"uno": 14, "mega2560": 54}
"""The digital number of a board's first analog pin."""


def header(board: str) -> dict[str, str]:
    """What is printed beside the pin that each constant of a board's header names."""
    text = (ROOT / "firmware" / "src" / "boards" / board / "pins.h").read_text(encoding="utf-8")
    found = re.findall(r"constexpr uint8_t (k\w+) = (\d+);", text)
    first = A0[board]
    return {
        name: f"A{number}"
        if name.endswith("Channel")
        else (f"A{int(number) - first}" if int(number) >= first else f"D{number}")
        for name, number in found
    }


def drawn() -> tuple[dict[str, Any], dict[str, list[tuple[str, str]]]]:
    """The drawing, and by constant the (pin of the board, cable) of each wire that is named so."""
    drawing = yaml.safe_load((BUILD / "wiring.yaml").read_text(encoding="utf-8"))
    wires: dict[str, list[tuple[str, str]]] = {}
    for chain in drawing["connections"]:
        (cable,) = [name for link in chain for name in link if name in drawing["cables"]]
        (numbers,) = [link[cable] for link in chain if cable in link]
        (pins,) = [link["Uno"] for link in chain if "Uno" in link]
        labels = drawing["cables"][cable]["wirelabels"]
        assert len(numbers) == len(pins) == len(labels)
        for number, pin in zip(numbers, pins, strict=True):
            for label in labels[number - 1].split():
                wires.setdefault(label, []).append((pin, cable))
    return drawing, wires


def test_every_pin_of_the_header_is_drawn_where_it_is_and_no_other() -> None:
    drawing, wires = drawn()
    supply = {"5V", "GND", "8V"}
    named = {name: {pin for pin, _ in ends} for name, ends in wires.items() if name not in supply}
    lamp = re.findall(r"\bD\d+ is the lamp", drawing["connectors"]["Uno"]["notes"])
    named["kLamp"] = {words.split()[0] for words in lamp}
    assert named == {name: {pin} for name, pin in header("uno").items()}
    used = {pin for ends in wires.values() for pin, _ in ends}
    assert used == set(drawing["connectors"]["Uno"]["pins"])


def test_every_output_is_drawn_with_a_pull_down() -> None:
    drawing, wires = drawn()
    (ends,) = [c[-1]["PullDowns"] for c in drawing["connections"] if "PullDowns" in c[-1]]
    assert ends == drawing["connectors"]["PullDowns"]["pins"]
    outputs = {name for name in header("uno") if re.match(r"k(Steer|Drive)(L?[Pp]wm|In\d)", name)}
    pulled = {name for name, ends in wires.items() if any(at == "pull_downs" for _, at in ends)}
    assert pulled == outputs | {"kBlade", "GND"}
    assert len(outputs) == 8


def test_every_wire_of_a_device_is_joined_to_its_pin() -> None:
    drawing, _ = drawn()
    for chain in drawing["connections"]:
        for link in chain:
            ((name, pins),) = link.items()
            known = drawing["connectors"].get(name)
            if known is not None:
                assert set(pins) <= set(known["pins"]), name
                assert name == "Uno" or set(pins) == set(known["pins"]), name


def test_the_builder_s_pin_table_is_the_headers() -> None:
    rows = re.findall(r"^\| `(k\w+)` \| (\w+) \| (\w+) \|", README, re.MULTILINE)
    assert {name: pin for name, pin, _ in rows} == header("uno")
    assert {name: pin for name, _, pin in rows} == header("mega2560")


def test_the_parts_list_has_the_resistors_and_capacitors_of_drawing_and_page() -> None:
    parts = drawn()[0]["connectors"]
    value = r"[\d.]+ (?:k?Ω|[nµ]F)"
    bought = re.search(r"^\| resistors, capacitors \| ([^|]+) \|", README, re.MULTILINE)
    assert bought is not None
    listed: Counter[str] = Counter()
    for item in re.sub(r" \([^)]*\)", "", bought[1]).split(", "):
        one = re.fullmatch(rf"(?:(\d+) × )?({value})(?: × (\d+))?", item)
        assert one is not None, item
        listed[one[2]] += int(one[1] or one[3] or 1)
    told = [part.get("notes", "") for part in parts.values()] + [parts["Relay"]["subtype"]]
    counted = Counter(re.findall(value, " ".join(told)))
    each = re.match(value, parts["PullDowns"]["type"])
    assert each is not None
    counted[each[0]] += len(parts["PullDowns"]["pins"]) - 1  # and GND
    in_series = re.search(rf"({value}) between each such wire and its pin: ([^.]+)\.", README)
    beside = re.search(rf"over 1 kΩ, with ({value}) beside", README)
    assert in_series is not None
    assert beside is not None
    counted[in_series[1]] += len(in_series[2].split(", "))
    counted.update((beside[1], "1 kΩ"))
    assert listed == counted


def texts_and_boxes() -> tuple[list[tuple[str, float, float]], list[tuple[float, ...]]]:
    """(text, left, baseline) of every text of the picture, and (left, top, right, bottom) of every
    box; in the picture's points."""
    picture = ElementTree.parse(BUILD / "wiring.svg").getroot()
    svg = "{http://www.w3.org/2000/svg}"
    texts = [
        ("".join(t.itertext()).strip(), float(t.get("x", "")), float(t.get("y", "")))
        for t in picture.iter(f"{svg}text")
    ]
    boxes = []
    for polygon in picture.iter(f"{svg}polygon"):
        corners = [[float(v) for v in c.split(",")] for c in polygon.get("points", "").split()]
        across, down = zip(*corners, strict=True)
        boxes.append((min(across), min(down), max(across), max(down)))
    return [text for text in texts if text[0]], boxes


def test_every_text_of_the_picture_fits_its_box_and_meets_no_other() -> None:
    """In the font that it is drawn for, wider than those that browsers put in its place."""
    font = FontProperties(family="DejaVu Sans")
    texts, boxes = texts_and_boxes()
    for text, left, line in texts:
        right = left + TextPath((0, 0), text, size=14, prop=font).get_extents().x1
        around = [b for b in boxes if b[0] <= left <= b[2] and b[1] <= line <= b[3]]
        box = min(around, key=lambda b: b[2] - b[0])
        assert right <= box[2], text
        assert not [other for other, x, y in texts if y == line and left < x < right], text


def test_the_picture_says_what_the_drawing_says() -> None:
    drawing, _ = drawn()
    said = {text for text, _, _ in texts_and_boxes()[0]}
    for name, part in drawing["connectors"].items():
        told = [part["type"], part.get("subtype"), part.get("notes"), name, *part["pins"]]
        assert {text for text in told if text} <= said, name
    pairs: set[str] = set()
    for chain in drawing["connections"]:
        ends = [(name, pins) for link in chain for name, pins in link.items()]
        ((near, nears), (cable, wires), (far, fars)) = ends
        looks = drawing["cables"][cable]
        for wire, one, other in zip(wires, nears, fars, strict=True):
            colour, label = looks["colors"][wire - 1], looks["wirelabels"][wire - 1]
            pairs |= {f"{near}:{one}", f"{wire}:{colour}:{label}", f"{far}:{other}"}
    assert pairs <= said
