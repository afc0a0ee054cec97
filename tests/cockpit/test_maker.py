"""Films of recorded rides: `report.sh --video`, drawn by a real browser without a display."""

from __future__ import annotations

import io
import json
import re
import shlex
import shutil
import subprocess
from pathlib import Path

import pytest
from made_bag import write_bag
from PIL import Image
from policies import own_policy

from bicycle_cockpit.film import browser, encoder
from bicycle_cockpit.film.command import main, parse
from bicycle_cockpit.film.maker import SHOT, SHOTS, FilmOptions
from bicycle_controller.policy.policy import save_policy

ROOT = Path(__file__).resolve().parents[2]
FILM_RIDE = ROOT / "tests" / "data" / "film-ride"


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """5 s of a ride."""
    return write_bag(tmp_path_factory.mktemp("bag") / "ride")


@pytest.mark.slow
@pytest.mark.skipif(not any(map(shutil.which, browser.PROGRAMS)), reason="needs Chromium")
def test_a_film_shows_the_ride(bag: Path, tmp_path: Path) -> None:
    film = tmp_path / "ride.webp"
    options = ["--size", "320x180", "--fps", "2", "--from", "1", "--to", "4", "--camera", "side"]
    assert main([str(bag), "--video", str(film), *options]) == 0
    with Image.open(film) as images:
        assert images.size == (320, 180)
        assert getattr(images, "n_frames", 1) == 6
        pictures = []
        for number in range(6):
            images.seek(number)
            pictures.append(images.convert("RGB").tobytes())
    assert len(set(pictures)) == 6, "wheels turn and the ground goes by"
    assert [path.name for path in tmp_path.iterdir()] == ["ride.webp"]


@pytest.mark.slow
@pytest.mark.skipif(not any(map(shutil.which, browser.PROGRAMS)), reason="needs Chromium")
@pytest.mark.skipif(shutil.which("ffmpeg") is None, reason="needs ffmpeg")
def test_report_sh_films_a_race_against_the_lqr(tmp_path: Path) -> None:
    film = tmp_path / "race.mp4"
    words = ["--video", str(film), "--against", "lqr", "--to", "1", "--fps", "4"]
    report = [str(ROOT / "ros2_ws" / "report.sh"), str(FILM_RIDE), *words, "--size", "320x180"]
    done = subprocess.run(report, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    probe = ["ffprobe", "-v", "error", "-count_frames", "-show_entries"]
    shown = "stream=width,height,nb_read_frames"
    read = subprocess.run([*probe, shown, "-of", "csv=p=0", str(film)], capture_output=True)
    assert read.stdout.decode().strip() == "320,180,4"


def test_the_film_of_the_readme_is_what_its_command_makes() -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    (line,) = re.findall(r"^\./ros2_ws/report\.sh (.*ride\.webp.*)$", readme, re.MULTILINE)
    options = parse(shlex.split(line))
    assert (ROOT / options.bags[0]).resolve() == FILM_RIDE
    film = ROOT / options.video
    assert film.stat().st_size < 5_000_000
    assert str(options.video) in readme.partition("```")[0], "it stands at the head"
    with Image.open(film) as images:
        assert images.size == options.film.size
        assert getattr(images, "n_frames", 1) == len(options.film.times(options.film.end)) == 360


def test_a_policy_file_rides_along(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "runs" / "mine" / "policies" / "00001500.safetensors"
    save_policy(own_policy(), file)
    page = tmp_path / "page"
    assert main([str(FILM_RIDE), "--viewer", str(page), "--against", str(file)]) == 0
    listed = json.loads((page / "rides" / "index.json").read_text())["bags"]
    assert [one["name"] for one in listed] == [
        "film-ride",
        "film-ride by mine after 1,500 updates",
    ]
    ghost = json.loads((page / "rides" / f"{listed[1]['name']}.json").read_text())
    assert [one["label"] for one in ghost["riders"]] == ["mine after 1,500 updates"]
    assert any(mark["kind"] == "reached" for mark in ghost["marks"])
    assert main([str(FILM_RIDE), "--viewer", str(page), "--against", str(tmp_path / "none")]) == 1
    said = capsys.readouterr().err.splitlines()
    assert len(said) == 1
    assert "none" in said[0]


def jpeg(shade: int) -> bytes:
    """Return a small grey picture."""
    file = io.BytesIO()
    Image.new("RGB", (64, 36), (shade, shade, shade)).save(file, "JPEG")
    return file.getvalue()


@pytest.mark.parametrize("ending", encoder.FORMATS)
def test_every_format_is_written(tmp_path: Path, ending: str) -> None:
    if ending in (".mp4", ".webm") and shutil.which("ffmpeg") is None:
        pytest.skip("needs ffmpeg")
    film = tmp_path / f"film{ending}"
    with encoder.encoder(film, 10.0) as writer:
        for shade in range(0, 250, 50):
            writer.add(jpeg(shade))
    start = film.read_bytes()[:12]
    marks = {".mp4": b"ftyp", ".webm": b"\x1aE\xdf\xa3", ".gif": b"GIF89a", ".webp": b"WEBP"}
    assert marks[ending] in start


def test_without_ffmpeg_the_remedy_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("BICYCLE_FFMPEG", "no-such-program")
    monkeypatch.setitem(__import__("sys").modules, "imageio_ffmpeg", None)
    with pytest.raises(encoder.EncoderError, match=r"apt install ffmpeg.*\.gif and \.webp"):
        encoder.check_format(tmp_path / "a.mp4")
    encoder.check_format(tmp_path / "a.gif")


def test_without_a_browser_the_remedy_is_said(
    bag: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    assert main([str(bag), "--video", str(tmp_path / "a.gif")]) == 1
    assert "apt install chromium" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--video", "a.avi"], "must end in .mp4"),
        (["--video", "no/such/a.gif"], "does not exist"),
    ],
)
def test_a_film_that_cannot_be_is_refused_in_one_line(
    bag: Path, words: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([str(bag), *words]) == 1
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1


@pytest.mark.parametrize(
    "words",
    [
        ["--fps", "0"],
        ["--size", "3x3"],
        ["--size", "wide"],
        ["--camera", "drone"],
        ["--from", "3", "--to", "2"],
        ["--viewer", "folder"],
        ["other-bag"],
    ],
)
def test_wrong_options_end_with_status_2(bag: Path, words: list[str]) -> None:
    with pytest.raises(SystemExit) as left:
        main([str(bag), "--video", "a.gif", *words])
    assert left.value.code == 2


def test_the_tour_goes_through_the_cameras() -> None:
    options = FilmOptions(rate=10.0)
    seen = [options.camera_at(number) for number in range(int(10 * SHOT * len(SHOTS)))]
    assert list(dict.fromkeys(seen)) == list(SHOTS)


def test_pictures_are_taken_at_even_times() -> None:
    options = FilmOptions(rate=10.0, speed=2.0, start=1.0, end=2.0)
    assert options.times(60.0) == pytest.approx([1.0, 1.2, 1.4, 1.6, 1.8])
    with pytest.raises(ValueError, match=r"lasts 0\.5 s"):
        options.times(0.5)
