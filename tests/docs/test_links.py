"""Every link and every file that the documents name is there."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
ROOMS = ("docs", "firmware", "hil", "host", "numba_cache", "sim_plant", "tests", "tools")
SUFFIXES = (".py", ".h", ".cpp", ".toml")
SOURCES = sorted(p for room in ROOMS for p in (ROOT / room).rglob("*") if p.suffix in SUFFIXES)
PAGES = sorted([*ROOT.glob("docs/**/*.md"), ROOT / "README.md", ROOT / "CONTRIBUTING.md"])
CODE = re.compile(r"```.*?```", re.DOTALL)
LINK = re.compile(r"\]\(([^)\s]+)\)")
PAGE = re.compile(r"\bdocs/[\w/-]+\.md")
QUOTED = re.compile(r"`([^`\n]+)`")
NAMED = re.compile(rf"(?:{'|'.join(ROOMS)})/[\w./-]+")


def anchors_of(page: Path) -> set[str]:
    """The headings of a page, as GitHub makes anchors of them."""
    found = set()
    for heading in re.findall(r"^#+ +(.+)$", CODE.sub("", page.read_text("utf-8")), re.MULTILINE):
        words = re.sub(r"[^\w\- ]", "", heading.strip().lower())
        found.add(words.replace(" ", "-"))
    return found


def broken_links(page: Path, text: str) -> list[str]:
    """Relative links of a page to what is not there."""
    broken = []
    for link in LINK.findall(CODE.sub("", text)):
        if re.match(r"[a-z]+:", link):
            continue
        path, _, anchor = link.partition("#")
        goal = (page.parent / path).resolve() if path else page
        lost = anchor and goal.suffix == ".md" and goal.exists() and anchor not in anchors_of(goal)
        if not goal.exists() or lost:
            broken.append(link)
    return broken


def missing_files(text: str) -> list[str]:
    """Paths in a text's code that are not in the repository."""
    quoted = QUOTED.findall(CODE.sub("", text))
    blocks = "\n".join(CODE.findall(text))
    named = [
        p for words in [*quoted, blocks] for p in re.findall(r"(?<![\w./-])" + NAMED.pattern, words)
    ]
    return [path for path in named if not (ROOT / path.rstrip(".")).exists()]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_link_leads_somewhere(page: Path) -> None:
    assert broken_links(page, page.read_text("utf-8")) == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_file_that_is_named_exists(page: Path) -> None:
    assert missing_files(page.read_text("utf-8")) == []


def test_every_page_that_the_code_names_exists() -> None:
    named = {
        (str(p.relative_to(ROOT)), page)
        for p in SOURCES
        for page in re.findall(PAGE, p.read_text("utf-8"))
    }
    assert [(where, page) for where, page in sorted(named) if not (ROOT / page).exists()] == []


def test_a_page_in_the_index_for_each_document() -> None:
    index = (ROOT / "docs" / "README.md").read_text("utf-8")
    linked = {(ROOT / "docs" / link.partition("#")[0]).resolve() for link in LINK.findall(index)}
    assert {page for page in PAGES if page.is_relative_to(ROOT / "docs")} - linked == {
        ROOT / "docs" / "README.md"
    }


def test_what_is_not_there_is_found() -> None:
    page = ROOT / "README.md"
    assert broken_links(page, "[a](nowhere.md) [b](docs/README.md#nothing)") == [
        "nowhere.md",
        "docs/README.md#nothing",
    ]
    assert missing_files("`host/nowhere.py`") == ["host/nowhere.py"]
