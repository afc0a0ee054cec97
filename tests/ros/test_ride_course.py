"""`ride.sh --course`: a course followed from the first process to the summary."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from node_process import NodeProcess

from bicycle_bringup.ride_options import parse
from bicycle_tools.report_page.loading import load
from bicycle_tools.report_page.page import html
from bicycle_tools.ride_log import read_ride

pytestmark = [pytest.mark.ros, pytest.mark.usefixtures("no_new_shared_memory")]


def test_a_course_of_ones_own_is_ridden_recorded_and_drawn(
    start_node: Callable[..., NodeProcess], tmp_path: Path
) -> None:
    course, folder = tmp_path / "bend.yaml", tmp_path / "run"
    course.write_text("speed: 3.0\nsegments: [{straight: 15}, {arc: {radius: 12, turn: 60}}]\n")
    ride = start_node(
        "bicycle_bringup.nodes.ride",
        ["--course", course, "--output", folder, "simulator.pace:=lockstep"],
    )
    assert ride.wait() == 0, ride.output
    (path,) = json.loads((folder / "summary.json").read_text())["paths"]
    assert path["status"] == "finished"
    assert path["name"] == "bend"
    assert path["rms"] < 0.3
    log = read_ride(folder / "bag")
    assert len(log.paths) == 1
    assert log.paths[0][0] == pytest.approx([0.0, 0.0], abs=0.01)
    assert (folder / "ride.png").is_file()
    page = load(folder, "ride")
    assert not page.notes, "a course has no goals, so none is missing"
    assert f"bend finished, {path['rms']:.2f} m off (RMS)" in html([page])


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--course", "slalon"], "did you mean 'slalom'"),
        (["--course", "no.gpx"], "no course file"),
        (["--laps", "2"], "belong to --course"),
        (["--course", "slalom", "--minutes", "2"], "does not go with --course"),
        (["--course", "slalom", "--speed", "90"], "choose 1 to 8 m/s"),
    ],
)
def test_bad_options_are_told_in_one_line(
    words: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        parse(words, tmp_path)
    assert ended.value.code == 2
    assert message in capsys.readouterr().err
