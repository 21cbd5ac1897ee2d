"""What a harvest that was not finished says of it."""

from __future__ import annotations

from pathlib import Path

import pytest

from hil.commands.cli import cli
from hil.firmware import targets
from host.core.errors import EXIT_UNFINISHED, run

pytestmark = pytest.mark.skipif(
    not targets.DESK_LIBRARY.exists(), reason="the desk firmware is not built: make build"
)


@pytest.mark.parametrize("files", ["all", "figures"])
def test_it_names_a_map_only_where_one_was_drawn(
    files: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """It had sent its user to a map.png that a campaign's scenario does not draw."""
    settings = f"--set limits.time_s=1 --set belief=exact --set record.files={files}"
    command = f"harvest --eyes model --no-film {settings} --out {tmp_path}"
    with pytest.raises(SystemExit) as exit_:
        run(cli, "daranti-hil", command.split())
    assert exit_.value.code == EXIT_UNFINISHED
    error = capsys.readouterr().err
    assert "was not finished" in error
    assert (tmp_path / "map.png").exists() is (str(tmp_path / "map.png") in error)
    assert ("record.files=all" in error) is (files == "figures")
