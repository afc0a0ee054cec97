"""Source of the secret, which no command line contains."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from bicycle_cockpit.options import parse
from bicycle_cockpit.token_source import LARGEST_FILE, VARIABLE, find_token

SECRET = "0123456789abcdef0123"


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "token"
    path.write_text(f"{SECRET}\n")
    path.chmod(0o600)
    return path


def test_none_is_wanted_and_auto_makes_a_new_one_each_time() -> None:
    assert find_token(None, None, {}) == ""
    result = {find_token("auto", None, {}) for _ in range(3)}
    assert len(result) == 3
    assert all(len(token) == 32 and token.isalnum() for token in result)


def test_a_file_or_the_environment_give_it(file: Path) -> None:
    assert find_token(None, file, {}) == SECRET
    assert find_token(None, None, {VARIABLE: SECRET}) == SECRET
    assert len(find_token(None, None, {VARIABLE: "auto"})) == 32


def test_what_the_cockpit_starts_does_not_learn_it() -> None:
    environment = {VARIABLE: SECRET, "PATH": "/bin"}
    find_token(None, None, environment)
    assert environment == {"PATH": "/bin"}


@pytest.mark.parametrize("word", [SECRET, "", "AUTO", "0123"])
def test_a_secret_on_the_command_line_is_refused_and_not_repeated(word: str) -> None:
    with pytest.raises(ValueError, match="every user of this machine can read") as caught:
        find_token(word, None, {})
    assert SECRET not in str(caught.value)


def test_two_sources_are_one_too_many(file: Path) -> None:
    for word, path, environment in (
        ("auto", file, {}),
        (None, file, {VARIABLE: SECRET}),
        ("auto", None, {VARIABLE: SECRET}),
    ):
        with pytest.raises(ValueError, match="give one of them"):
            find_token(word, path, dict(environment))


@pytest.mark.parametrize("mode", [0o644, 0o640, 0o604, 0o660])
def test_a_file_that_others_can_read_is_refused(file: Path, mode: int) -> None:
    file.chmod(mode)
    with pytest.raises(ValueError, match="chmod 600"):
        find_token(None, file, {})


def test_a_file_that_holds_none_is_told(file: Path, tmp_path: Path) -> None:
    for text in ("", " \n", "a" * (LARGEST_FILE + 1)):
        file.write_text(text)
        with pytest.raises(ValueError, match="holds no secret"):
            find_token(None, file, {})
    for path in (tmp_path / "none", tmp_path, Path("a\0b")):
        with pytest.raises(ValueError, match="cannot read --token-file"):
            find_token(None, path, {})


@pytest.mark.parametrize("text", ["short", "with a space in it", SECRET + "/"])
def test_a_weak_secret_ends_it_without_showing_it(
    file: Path, text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    file.write_text(text)
    with pytest.raises(SystemExit) as caught:
        parse(["--bind", "0.0.0.0", "--token-file", str(file)], Path("/ws"))
    assert caught.value.code == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "at least 16 letters and digits" in line
    assert text not in line


def test_the_options_take_it(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    options = parse(["--bind", "0.0.0.0", "--token-file", str(file)], Path("/ws"))
    assert options.access_policy.token == SECRET
    monkeypatch.setenv(VARIABLE, SECRET)
    assert parse(["--bind", "0.0.0.0"], Path("/ws")).access_policy.token == SECRET
    assert VARIABLE not in os.environ
