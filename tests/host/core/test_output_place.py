"""Facts about results that cannot be written where they are asked for: told before the work."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import pytest

from hil.commands.cli import cli as daranti_hil
from host.commands import plan
from host.commands.cli import daranti
from host.core.errors import EXIT_USER, UserError, run
from host.core.output_place import check_file, check_folder
from host.field.boundary_file import load_field
from tests.helpers.spoiled import command_of, commands


def test_a_folder_that_can_be_made_is_not_made_yet(tmp_path: Path) -> None:
    check_folder(tmp_path / "a" / "b")
    check_folder(tmp_path)
    check_file(tmp_path / "x.png")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("below", ["", "a", "a/b"])
def test_a_file_is_no_folder(tmp_path: Path, below: str) -> None:
    file = tmp_path / "file"
    file.write_text("mine")
    with pytest.raises(UserError, match=f"cannot write into {file / below}: {file} is no folder"):
        check_folder(file / below)
    assert file.read_text() == "mine"


def test_nor_is_a_link_to_nowhere(tmp_path: Path) -> None:
    link = tmp_path / "link"
    link.symlink_to(tmp_path / "gone")
    with pytest.raises(UserError, match="is no folder"):
        check_folder(link)


def test_what_takes_no_file_is_told_though_permissions_allow_it() -> None:
    if os.geteuid() == 0:
        assert os.access("/proc", os.W_OK)
    with pytest.raises(UserError, match=r"cannot write into /proc: .*; write elsewhere"):
        check_folder(Path("/proc"))
    with pytest.raises(UserError, match=r"cannot write into /proc/x/y: .*; write elsewhere"):
        check_folder(Path("/proc/x/y"))


def test_a_name_that_is_too_long_is_told(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="File name too long; write elsewhere"):
        check_folder(tmp_path / ("x" * 300))


def test_a_file_wants_its_folder_and_a_name_of_its_own(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=f"there is no folder {tmp_path / 'a'}"):
        check_file(tmp_path / "a" / "x.png")
    with pytest.raises(UserError, match="there is a folder of that name"):
        check_file(tmp_path)
    with pytest.raises(UserError, match="cannot write into /proc"):
        check_file(Path("/proc/x.png"))
    check_file(Path("/dev/null"))


FIELD = '{"type":"Polygon","coordinates":[[[7,50],[7.0003,50],[7.0003,50.0003],[7,50.0003]]]}'
TOLD = {
    "daranti": {
        "bench vision": "--out /proc/x",
        "calibrate camera": "nothing.jpg --out /proc/x.yaml",
        "identify": "--port /dev/none --out /proc/x",
        "plan": "field.geojson --out /proc/x.png",
        "see": "nothing.jpg --side left --out /proc/x",
        "survey": "tcp://127.0.0.1:1 --out /proc/x.geojson",
        "tune confidence": "--out /proc/x",
        "tune pid": "--port /dev/none --out /proc/x",
        "tune vision": "nothing.jpg --out /proc/x",
    },
    "daranti-hil": {
        "beliefs": "--out /proc/x",
        "campaign": "--out /proc/x",
        "commission": "--out /proc/x",
        "consistency": "--out /proc/x/y.json",
        "eyes compare": "--out /proc/x",
        "eyes fit": "--out /proc/x",
        "eyes judge": "--out /proc/x",
        "faults": "--out /proc/x",
        "harvest": "--out /proc/x",
        "identify": "--out /proc/x",
        "moments": "--out /proc/x/y.json",
        "outlines": "--out /proc/x",
        "plot": "nothing.mcap --out /proc/x",
        "rig": "--out /proc/x",
        "sweep": "--out /proc/x",
        "vision": "--out /proc/x",
        "world": "--out /proc/x",
    },
}
GROUPS = {"daranti": daranti, "daranti-hil": daranti_hil}


@pytest.mark.parametrize("program", TOLD)
def test_every_command_that_writes_results_is_tried_here(program: str) -> None:
    group = GROUPS[program]
    assert {
        " ".join(path)
        for path in commands(group)
        if any(p.name == "out" for p in command_of(group, path).params)
    } == TOLD[program].keys()


@pytest.mark.parametrize(
    ("program", "words"),
    [(program, f"{name} {rest}") for program, told in TOLD.items() for name, rest in told.items()],
)
def test_it_is_told_before_any_work(
    program: str,
    words: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "field.geojson").write_text(FIELD)
    with pytest.raises(SystemExit) as exit_:
        run(GROUPS[program], program, words.split())
    assert exit_.value.code == EXIT_USER
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith(f"{program}: cannot write into /proc")
    assert err.endswith("; write elsewhere\n")
    assert err.count("\n") == 1
    assert [each.name for each in tmp_path.iterdir()] == ["field.geojson"]


def test_a_part_of_a_field_on_a_disk_that_takes_nothing_lies_beside_the_picture(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "field").mkdir()
    (tmp_path / "out").mkdir()
    field = tmp_path / "field" / "my.geojson"
    field.write_text(FIELD)
    planned = plan._previews

    def with_a_part(*given: object) -> dict[str, plan.Preview]:
        part = ((0.0, 0.0), (5.0, 0.0), (5.0, 5.0))
        return {
            turn: replace(shown, plan=replace(shown.plan, parts=(part,)))
            for turn, shown in planned(*given).items()  # type: ignore[arg-type]
        }

    monkeypatch.setattr(plan, "_previews", with_a_part)
    with pytest.raises(SystemExit) as exit_:
        run(daranti, "daranti", ["plan", str(field), "--out", str(tmp_path / "out" / "a.png")])
    assert exit_.value.code == 0, capsys.readouterr().err
    names = sorted(each.name for each in (tmp_path / "out").iterdir())
    assert names == ["a.png", "my.part1.geojson"]
    assert len(load_field(tmp_path / "out" / "my.part1.geojson", "").crop) == 3
    assert [each.name for each in field.parent.iterdir()] == ["my.geojson"]
