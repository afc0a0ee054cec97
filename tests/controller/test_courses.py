"""Courses by name and from files."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from bicycle_controller.control import courses
from bicycle_controller.control.courses import CourseError


def test_every_course_of_the_folder_can_be_ridden_by_a_bicycle_that_turns_in_6_m() -> None:
    asked = {"straight", "circle-10", "circle-20", "lane-change", "slalom", "figure-eight", "road"}
    assert asked <= set(courses.names())
    for name in courses.names():
        one = courses.load(name, 6.3)
        assert one.about or name == "square", name
        assert one.path.length > 50.0, name


def test_the_lane_change_is_3_5_m_in_20_m() -> None:
    path = courses.load("lane-change").path
    before, after = path.y[path.x < 40.0], path.y[path.x > 60.0]
    assert np.abs(before).max() < 1e-9
    assert after == pytest.approx(3.5)


def test_a_gpx_track_is_laid_in_metres_east_and_north(tmp_path: Path) -> None:
    file = tmp_path / "track.gpx"
    points = [(52.0 + 1e-4 * i, 4.0 + 1e-4 * i) for i in range(30)]
    inner = "".join(f'<trkpt lat="{a:.6f}" lon="{b:.6f}"/>' for a, b in points)
    file.write_text(f'<gpx xmlns="x"><trk><name>n</name><trkseg>{inner}</trkseg></trk></gpx>')
    one = courses.load(str(file))
    north = math.radians(29e-4) * courses.EARTH
    assert one.path.y[-1] == pytest.approx(north, abs=0.5)
    assert one.path.x[-1] == pytest.approx(north * math.cos(math.radians(52.0)), abs=0.5)
    assert one.about == "n"


def test_a_file_of_waypoints_is_a_course_too(tmp_path: Path) -> None:
    csv, yaml = tmp_path / "a.csv", tmp_path / "a.yaml"
    csv.write_text("x,y\n0,0\n30,0\n30,30\n")
    yaml.write_text("waypoints: [[0, 0], {x: 30, y: 0}, [30, 30]]\n")
    first, second = courses.load(str(csv)), courses.load(str(yaml))
    assert first.path.length == second.path.length == pytest.approx(60.0, abs=3.0)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("points: [[0, 0]]", "two different points"),
        ("points: [[0, 0], [x, 1]]", "is not a point"),
        ("segments: [{arc: {radius: 1}}]", "arc needs radius, turn"),
        ("segments: [{ark: 1}]", "is no segment"),
        ("segments: [{arc: {radius: 2, turn: 360}}]", "radius of 2.0"),
        ("closed: true\nsegments: [{straight: 20}]", "ends 20.00 m from its start"),
        ("points: [[0, 0], [9, 0]]\nlap: 2", "did you mean 'laps'"),
        ("{", "not YAML"),
        ("segments: [{arc: {radius: 100000, turn: 36000}}]", "longer than 200000 m together"),
        ("segments: [{slalom: {amplitude: 1, period: 10000, periods: 10000}}]", "longer than"),
        (f"segments: [{', '.join(3 * ['{straight: 100000}'])}]", "longer than 200000 m together"),
        ("points: [[0, 0], [1e300, 0]]", "m is longer than 200000 m"),
        ("3", "points or segments"),
        ("points: [[0, 0], [9, 0]]\nspeed: 8.5", "speed is 8.5: give a number from 0.5 to 8"),
        ("points: [[0, 0], [9, 0]]\nlaps: true", "laps is True: give a whole number"),
        ("points: [[0, 0], [9, 0]]\nclosed: 'no'", "closed is 'no': write true or false"),
        ("segments: [{straight: 20}]\nclosed: 1", "closed is 1: write true or false"),
    ],
)
def test_a_bad_file_is_told_in_one_line(tmp_path: Path, text: str, message: str) -> None:
    file = tmp_path / "bad.yaml"
    file.write_text(text)
    with pytest.raises(CourseError, match=message.replace("(", r"\(")) as error:
        courses.load(str(file), 3.0)
    assert "\n" not in str(error.value)
    assert "bad.yaml" in str(error.value)


@pytest.mark.parametrize("text", ["<gpx/>", "no", '<!DOCTYPE a [<!ENTITY b "c">]><gpx/>'])
def test_a_bad_gpx_file_is_told(tmp_path: Path, text: str) -> None:
    file = tmp_path / "bad.gpx"
    file.write_text(text)
    with pytest.raises(CourseError):
        courses.load(str(file))


def test_an_unknown_course_names_the_nearest() -> None:
    with pytest.raises(CourseError, match="did you mean 'slalom'"):
        courses.load("slalon")
    with pytest.raises(CourseError, match="no course file"):
        courses.load("nowhere.gpx")
