"""Words of the cockpit's command line that cannot work are told before anything starts."""

from __future__ import annotations

from pathlib import Path

import pytest

from bicycle_cockpit.options import parse


@pytest.mark.parametrize("option", ["--bags", "--models"])
def test_a_file_is_no_folder(
    option: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "ride.mcap"
    file.touch()
    with pytest.raises(SystemExit) as caught:
        parse([option, str(file)], Path("/ws"))
    assert caught.value.code == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert f"{option} {file} is no folder" in line


@pytest.mark.parametrize("option", ["--bags", "--models"])
def test_a_folder_need_not_exist_yet(option: str, tmp_path: Path) -> None:
    parse([option, str(tmp_path / "later")], Path("/ws"))
    parse([option, str(tmp_path)], Path("/ws"))
