"""Variables of the shell's environment that hold or are set aside: the table of lib/shell.sh."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Mapping
from pathlib import Path

import pytest
from waiting import PATIENCE

ROOT = Path(__file__).resolve().parents[2]
WORKSPACE = ROOT / "ros2_ws"
BASE = {"HOME": os.environ.get("HOME", "/"), "PATH": "/usr/local/bin:/usr/bin:/bin"}

ASIDE = {
    "RMW_IMPLEMENTATION": "rmw_cyclonedds_cpp",
    "RMW_FASTRTPS_USE_QOS_FROM_XML": "1",
    "RMW_FASTRTPS_PUBLICATION_MODE": "ASYNCHRONOUS",
    "RCL_ASSERT_RMW_ID_MATCHES": "rmw_cyclonedds_cpp",
    "RCL_LOGGING_IMPLEMENTATION": "rcl_logging_noop",
    "RCUTILS_LOGGING_USE_STDOUT": "yes",
    "RCUTILS_COLORIZED_OUTPUT": "always",
    "RCUTILS_LOGGING_MIN_SEVERITY": "RCUTILS_LOG_MIN_SEVERITY_NONE",
    "ROS_DISCOVERY_SERVER": "127.0.0.1:11811",
    "ROS_SUPER_CLIENT": "TRUE",
    "ROS_STATIC_PEERS": "10.1.2.3",
    "ROS_LOCALHOST_ONLY": "0",
    "ROS_AUTOMATIC_DISCOVERY_RANGE": "OFF",
    "ROS_NAMESPACE": "/robot",
    "ROS_LOG_DIR": "/proc/no/such/folder",
    "CYCLONEDDS_URI": "file:///etc/cyclone.xml",
    "FASTRTPS_DEFAULT_PROFILES_FILE": "/etc/profiles.xml",
    "FASTDDS_DEFAULT_PROFILES_FILE": "/etc/profiles.xml",
    "FASTDDS_BUILTIN_TRANSPORTS": "SHM",
    "FASTDDS_STATISTICS": "HISTORY_LATENCY_TOPIC",
    "FASTDDS_ENVIRONMENT_FILE": "/etc/fastdds.json",
    "PYTHONHOME": "/usr",
    "PYTHONPLATLIBDIR": "lib64",
    "PYTHONEXECUTABLE": "/usr/bin/python3",
    "PYTHONOPTIMIZE": "2",
    "PYTHONINSPECT": "1",
    "PYTHONIOENCODING": "ascii",
    "PYTHONWARNINGS": "error",
    "PYTHONDEVMODE": "1",
    "PYTHONHASHSEED": "x",
    "PYTHONUTF8": "2",
    "PYTHON_OF_A_LATER_VERSION": "1",
    "_PYTHON_SYSCONFIGDATA_NAME": "conda",
    "TMPDIR": "/no/such/folder",
    "MPLBACKEND": "module://matplotlib_inline.backend_inline",
    "RAY_ADDRESS": "10.1.2.3:6379",
}
"""Variables that would reach into a ride or end it; each is seen by somebody in the stack."""

KEPT = {
    "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp",
    "ROS_DOMAIN_ID": "7",
    "ROS_PYTHON_CHECK_FIELDS": "1",
    "ROS_SECURITY_ENABLE": "false",
    "ROS_MASTER_URI": "http://localhost:11311",
    "RCUTILS_COLORIZED_OUTPUT": "0",
    "RCUTILS_CONSOLE_OUTPUT_FORMAT": "[{severity}] {message}",
    "PYTHONSTARTUP": "/etc/pythonrc",
    "PYTHONSAFEPATH": "1",
    "PYTHONUNBUFFERED": "1",
    "PYTHONHASHSEED": "4294967",
    "OMP_NUM_THREADS": "3",
    "OPENBLAS_NUM_THREADS": "2",
    "PIP_INDEX_URL": "https://example.com/simple",
    "LANG": "C",
    "TMPDIR": "/tmp",
    "CC": "clang",
    "LD_PRELOAD": "libm.so.6",
}

NOT_FOR_BUILDING = {
    "CFLAGS": "-m32",
    "CXXFLAGS": "-Werror -ffast-math",
    "LDFLAGS": "-static",
    "CPATH": "/opt/include",
    "DESTDIR": "/elsewhere",
    "MAKEFLAGS": "-n",
    "CXX": "no-such-compiler",
    "CMAKE_PREFIX_PATH": "/opt/other",
    "CMAKE_TOOLCHAIN_FILE": "/opt/arm.cmake",
    "COLCON_PREFIX_PATH": "/opt/other/install",
    "COLCON_DEFAULTS_FILE": "/etc/colcon.yaml",
    "AMENT_PYTHON_EXECUTABLE": "/usr/bin/python2",
    "Python3_ROOT_DIR": "/opt/python",
    "SETUPTOOLS_USE_DISTUTILS": "stdlib",
    "PIP_TARGET": "/elsewhere",
    "PIP_USER": "1",
    "PIP_NO_BINARY": ":all:",
    "PIP_DRY_RUN": "1",
    "UV_SYSTEM_PYTHON": "1",
    "UV_EXCLUDE_NEWER": "2020-01-01",
    "PYTHONSAFEPATH": "1",
}

FOR_BUILDING = {
    "CXX": "c++ -pipe",
    "MAKEFLAGS": "-j3",
    "CMAKE_CXX_COMPILER_LAUNCHER": "ccache",
    "PIP_INDEX_URL": "https://example.com/simple",
    "PIP_CERT": "/etc/ssl/ca.pem",
    "PIP_CACHE_DIR": "/var/cache/pip",
    "UV_INDEX": "https://example.com/simple",
    "UV_CACHE_DIR": "/var/cache/uv",
    "SSL_CERT_DIR": "/etc/ssl",
    "https_proxy": "http://proxy:3128",
    "PYTHON": "/usr/bin/python3",
}


def sourced(script: str, env: Mapping[str, str], shell: str = "bash") -> tuple[str, list[str]]:
    """Return output and errors of a shell that sources env.sh and runs a script."""
    done = subprocess.run(
        [shell, "-c", f". '{WORKSPACE}/env.sh'; {script}"],
        env={**BASE, **env},
        cwd="/",
        capture_output=True,
        text=True,
        timeout=PATIENCE,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout, done.stderr.splitlines()


def show(name: str) -> str:
    return f'printf %s "${{{name}-unset}}"'


@pytest.mark.parametrize("name", ASIDE)
def test_what_does_not_fit_is_set_aside_in_one_line(name: str) -> None:
    value, warnings = sourced(show(name), {name: ASIDE[name]})
    assert value != ASIDE[name]
    (line,) = warnings
    assert line.startswith(f"env.sh: set aside: {name}")
    assert line.endswith("To keep one: BICYCLE_KEEP=NAME.")


@pytest.mark.parametrize("name", KEPT)
def test_what_fits_is_kept_without_a_word(name: str) -> None:
    assert sourced(show(name), {name: KEPT[name]}) == (KEPT[name], [])


def test_what_is_to_be_kept_is_kept() -> None:
    env = {"ROS_NAMESPACE": "/a", "PYTHONWARNINGS": "error", "BICYCLE_KEEP": "X ROS_NAMESPACE"}
    value, warnings = sourced(f"{show('ROS_NAMESPACE')}; {show('PYTHONWARNINGS')}", env)
    assert value == "/aunset"
    assert "PYTHONWARNINGS" in warnings[0]
    assert "ROS_NAMESPACE" not in warnings[0]


@pytest.mark.parametrize("name", ["ROS_DISCOVERY_SERVER", "ROS_STATIC_PEERS", "CYCLONEDDS_URI"])
def test_the_network_s_own_settings_hold_on_it(name: str) -> None:
    env = {name: ASIDE[name], "BICYCLE_NETWORK": "lan"}
    assert sourced(show(name), env) == (ASIDE[name], [])


def test_a_missing_middleware_is_set_aside_on_the_network_too() -> None:
    env = {"RMW_IMPLEMENTATION": "rmw_cyclonedds_cpp", "BICYCLE_NETWORK": "lan"}
    value, (line,) = sourced(show("RMW_IMPLEMENTATION"), env)
    assert value == "unset"
    assert "rmw_cyclonedds_cpp is not installed here" in line


@pytest.fixture
def foreign(tmp_path: Path) -> Path:
    """Another numpy that cannot be imported, another libstdc++, another clone's package."""
    (tmp_path / "python" / "numpy").mkdir(parents=True)
    (tmp_path / "python" / "numpy" / "__init__.py").write_text("raise ImportError('foreign')")
    (tmp_path / "standard").mkdir()
    (tmp_path / "standard" / "queue.py").write_text("raise ImportError('foreign')")
    (tmp_path / "lib").mkdir()
    (tmp_path / "lib" / "libstdc++.so.6").write_text("")
    packages = tmp_path / "ament" / "share" / "ament_index" / "resource_index" / "packages"
    packages.mkdir(parents=True)
    (packages / "bicycle_msgs").write_text("")
    (tmp_path / "own" / "my_robot_msgs").mkdir(parents=True)
    return tmp_path


@pytest.mark.parametrize(
    ("name", "folder", "reason"),
    [
        ("PYTHONPATH", "python", "has another numpy"),
        ("PYTHONPATH", "standard", "has another queue"),
        ("LD_LIBRARY_PATH", "lib", "has another libstdc++"),
        ("AMENT_PREFIX_PATH", "ament", "has another bicycle_msgs"),
        ("LD_PRELOAD", "lib/gone.so", "is missing"),
    ],
)
def test_only_entries_that_take_another_s_place_go(
    foreign: Path, name: str, folder: str, reason: str
) -> None:
    own = "/usr/lib/x86_64-linux-gnu/libm.so.6" if name == "LD_PRELOAD" else str(foreign / "own")
    value, warnings = sourced(show(name), {name: f"{foreign / folder}:{own}"})
    line = warnings[-1]  # the loader has complained of what it could not preload
    assert f"set aside: {name} ({foreign / folder} {reason})" in line
    assert str(foreign / folder) not in value
    assert value.endswith(own)


def test_an_overlay_of_one_s_own_stays(foreign: Path) -> None:
    own = str(foreign / "own")
    for name in ("PYTHONPATH", "LD_LIBRARY_PATH", "AMENT_PREFIX_PATH"):
        value, warnings = sourced(show(name), {name: own})
        assert value.endswith(f":{own}")
        assert warnings == []


def test_the_working_directory_is_no_entry(tmp_path: Path) -> None:
    for name in ("PYTHONPATH", "LD_LIBRARY_PATH"):
        value, warnings = sourced(show(name), {name: f":{tmp_path}:"})
        assert value.endswith(f":{tmp_path}")
        assert "::" not in value
        assert warnings == []


@pytest.fixture
def everything(foreign: Path) -> dict[str, str]:
    """Every foreign variable at once, but for what no shell starts with."""
    return {
        **BASE,
        **ASIDE,
        **NOT_FOR_BUILDING,
        "PYTHONPATH": f":{foreign / 'python'}:{foreign / 'standard'}",
        "LD_LIBRARY_PATH": str(foreign / "lib"),
        "CDPATH": str(foreign),
        "POSIXLY_CORRECT": "1",
        "LC_ALL": "C",
        "HOME": "/no/such/home",
        "VIRTUAL_ENV": str(foreign),
        "OMP_NUM_THREADS": "many",
    }


def without_libraries(env: Mapping[str, str]) -> dict[str, str]:
    """Without what keeps the shell itself from starting: a libstdc++ of no bytes is no library."""
    return {name: value for name, value in env.items() if name != "LD_LIBRARY_PATH"}


def test_a_script_runs_in_a_shell_made_for_something_else(everything: dict[str, str]) -> None:
    done = subprocess.run(
        [WORKSPACE / "topic.sh", "list"],
        env={**without_libraries(everything), "ROS_DOMAIN_ID": "101"},
        capture_output=True,
        text=True,
        timeout=PATIENCE,
    )
    assert done.returncode == 0, done.stderr
    assert "/parameter_events" in done.stdout
    (line,) = done.stderr.splitlines()
    for name in (*ASIDE, "PYTHONPATH"):
        assert name in line


def test_a_module_in_the_working_directory_takes_no_other_s_place(foreign: Path) -> None:
    words = [str(WORKSPACE / "bin" / "bicycle"), "evaluate", "lqr", "--episodes", "1"]
    for folder in ("python", "standard"):
        done = subprocess.run(
            words, env=BASE, cwd=foreign / folder, capture_output=True, text=True, timeout=PATIENCE
        )
        assert done.returncode == 0, done.stderr


def test_cdpath_leads_nowhere_else(tmp_path: Path) -> None:
    (tmp_path / "ros2_ws").mkdir()
    script = f"CDPATH={tmp_path}; cd {ROOT}; . ros2_ws/env.sh; {show('BICYCLE_WS')}"
    done = subprocess.run(["bash", "-c", script], env=BASE, capture_output=True, text=True)
    assert (done.stdout, done.stderr) == (str(WORKSPACE), "")


@pytest.mark.parametrize(
    "habit",
    [
        "set -u",
        "set -o noclobber",
        "set -o pipefail",
        "shopt -s expand_aliases; alias ls='ls -la' mkdir='mkdir -pv' rm='rm -i'",
        'cd() { builtin cd "$@" && ls; }',
        "shopt -s nullglob",
        "shopt -s nocaseglob extglob",
        "export IFS=:",
        "umask 077",
        "set -f",
        "set -k",
        "shopt -s failglob",
        "shopt -s nocasematch",
        "pwd() { echo elsewhere; }",
    ],
)
def test_the_habits_of_a_shell_change_nothing(habit: str) -> None:
    names = ("PYTHONPATH", "AMENT_PREFIX_PATH", "LD_LIBRARY_PATH", "PATH", "BICYCLE_WS")
    printed = "\n".join(map(show, names))
    plain = subprocess.run(
        ["bash", "-c", f". {WORKSPACE}/env.sh\n{printed}"],
        env=BASE,
        capture_output=True,
        text=True,
    )
    done = subprocess.run(
        ["bash", "-c", f"{habit}\n. {WORKSPACE}/env.sh\n{printed}"],
        env=BASE,
        capture_output=True,
        text=True,
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, plain.stdout, "")


@pytest.mark.parametrize(
    "habit", ["set -f", "set -k", "shopt -s failglob", "shopt -s nocasematch"]
)
def test_the_habits_of_a_shell_stay(habit: str) -> None:
    options = "shopt -p; set +o"
    script = f'{habit}\nbefore=$({options})\n. {WORKSPACE}/env.sh\n[[ $before == "$({options})" ]]'
    done = subprocess.run(["bash", "-c", script], env=BASE, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")


FUNCTIONS = ("cd", "pwd", "ls", "mkdir", "cat", "die", "run")
"""Names of functions that a shell may export, as `export -f` does."""


@pytest.mark.parametrize(
    "habits",
    [
        {"SHELLOPTS": "noglob:noclobber:keyword"},
        {"BASHOPTS": "failglob:nocasematch:nullglob"},
        {f"BASH_FUNC_{name}%%": "() {  echo foreign; }" for name in FUNCTIONS},
        {"BASH_ENV": "habits.sh"},
    ],
    ids=["options", "shopt", "functions", "file"],
)
def test_a_script_has_none_of_its_caller_s_habits(habits: dict[str, str], tmp_path: Path) -> None:
    (tmp_path / "habits.sh").write_text(
        "set -fC; shopt -s failglob expand_aliases; cd() { echo foreign; }; alias rm='rm -i'\n"
    )
    for words in (["topic.sh", "list"], ["stop.sh"], ["setup.sh"], ["bin/bicycle", "--version"]):
        done = subprocess.run(
            [WORKSPACE / words[0], *words[1:]],
            env={**BASE, "ROS_DOMAIN_ID": "101", **habits},
            cwd=tmp_path,
            capture_output=True,
            text=True,
            timeout=PATIENCE,
        )
        assert (done.returncode, done.stderr) == (0, ""), words
        assert "foreign" not in done.stdout


@pytest.mark.skipif(shutil.which("dash") is None, reason="no dash here")
def test_a_shell_that_cannot_is_told_which_can() -> None:
    script = f". {WORKSPACE}/env.sh; echo status $?"
    done = subprocess.run(["dash", "-c", script], env=BASE, capture_output=True, text=True)
    assert done.stderr == "env.sh: it needs bash or zsh: source it in one of them.\n"
    assert done.stdout == "status 1\n"


def test_who_runs_the_file_instead_of_sourcing_it_is_told() -> None:
    done = subprocess.run(
        ["bash", WORKSPACE / "env.sh"], env=BASE, capture_output=True, text=True, timeout=PATIENCE
    )
    assert done.returncode == 2
    assert done.stderr == "env.sh: it changes nothing when it is run: source it, as in . env.sh\n"


@pytest.mark.skipif(shutil.which("zsh") is None, reason="no zsh here")
@pytest.mark.parametrize("habit", ["setopt no_glob", "setopt ignore_braces", "emulate sh"])
def test_the_habits_of_zsh_change_nothing(habit: str) -> None:
    script = f"{habit}; . {WORKSPACE}/env.sh; {show('PYTHONPATH')}"
    done = subprocess.run(["zsh", "-fc", script], env=BASE, capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (0, sourced(show("PYTHONPATH"), {})[0]), done.stderr


@pytest.mark.skipif(shutil.which("zsh") is None, reason="no zsh here")
def test_zsh_sets_the_same_aside() -> None:
    script = f"{show('RMW_IMPLEMENTATION')}; {show('PYTHONPATH')}"
    env = {"RMW_IMPLEMENTATION": "rmw_cyclonedds_cpp", "PYTHONOPTIMIZE": "1"}
    assert sourced(script, env, "zsh") == sourced(script, env)


def judged(env: Mapping[str, str]) -> tuple[dict[str, str], str]:
    """Return the environment in which setup.sh builds, and what it says is set aside."""
    script = f'. lib/shell.sh; _bicycle_set_aside build "{ROOT}" "{ROOT}/.venv"; env -0; '
    script += 'printf "told=%s" "$_bicycle_aside"'
    done = subprocess.run(
        ["bash", "-euo", "pipefail", "-c", script],
        env={**BASE, **env},
        cwd=WORKSPACE,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    found = dict(entry.split("=", 1) for entry in done.stdout.split("\0"))
    set_aside = found.pop("told")
    return found, set_aside


@pytest.mark.parametrize("name", NOT_FOR_BUILDING)
def test_setup_builds_without_what_does_not_fit(name: str) -> None:
    found, set_aside = judged({name: NOT_FOR_BUILDING[name]})
    assert name not in found
    assert set_aside.startswith(f"set aside: {name}")


@pytest.mark.parametrize("name", FOR_BUILDING)
def test_setup_keeps_where_packages_come_from(name: str) -> None:
    found, set_aside = judged({name: FOR_BUILDING[name]})
    assert found[name] == FOR_BUILDING[name]
    assert set_aside == ""


def test_pip_is_the_environment_s() -> None:
    found, _ = sourced("command -v pip; command -v pip3; pip --version", {})
    pip, pip3, version = found.splitlines()
    assert pip == str(ROOT / ".venv" / "bin" / "pip")
    assert pip3 == f"{pip}3"
    assert str(ROOT / ".venv") in version
