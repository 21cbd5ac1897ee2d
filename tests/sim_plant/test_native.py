"""The kernels of the picture, compiled for this machine."""

import ctypes
from pathlib import Path

import pytest

from sim_plant.native import compile_into


def answer(folder: Path, source: Path, text: str) -> int:
    """What the library says that is compiled from this text."""
    source.write_text(text)
    return int(ctypes.CDLL(str(compile_into(folder, source))).answer())


def test_another_source_is_another_library(tmp_path: Path) -> None:
    source = tmp_path / "kernel.cpp"
    assert answer(tmp_path, source, 'extern "C" int answer() { return 1; }') == 1
    assert answer(tmp_path, source, 'extern "C" int answer() { return 2; }') == 2


def test_what_is_compiled_is_not_compiled_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source = tmp_path / "kernel.cpp"
    answer(tmp_path, source, 'extern "C" int answer() { return 1; }')
    monkeypatch.setenv("CXX", "no-such-compiler")
    assert answer(tmp_path, source, 'extern "C" int answer() { return 1; }') == 1


def test_a_source_that_does_not_compile_is_named(tmp_path: Path) -> None:
    source = tmp_path / "kernel.cpp"
    source.write_text("no C++")
    with pytest.raises(RuntimeError, match=r"cannot compile .*kernel\.cpp"):
        compile_into(tmp_path, source)
