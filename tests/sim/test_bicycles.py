"""Bicycles by name, and yours from a YAML file."""

from __future__ import annotations

import json
import math
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from bicycle_sim.plants.whipple import catalogue, linear, measure
from bicycle_sim.plants.whipple.measure import RigidRider, TapeReadings
from bicycle_sim.plants.whipple.parameters import Bicycle

MEASURED = (
    "balance-assist",
    "browser",
    "browser-instrumented",
    "crescendo",
    "fisher",
    "pista",
    "rigid",
    "silver",
    "yellow",
    "yellow-reversed",
)
FOLDER = Path(catalogue.__file__).parent / "bicycles"


def bicycle(name: str) -> Bicycle:
    return catalogue.load(name).parameters.bicycle


def test_every_bicycle_tells_its_source_and_licence() -> None:
    names = catalogue.names()
    assert {"benchmark", "browser", "browser-rider", "steer-by-wire"} <= set(names)
    assert {"balance-assist", "balance-assist-rider", *MEASURED} <= set(names)
    for name in names:
        found = catalogue.load(name)
        assert found.name == found.parameters.name == name
        assert found.about
        assert "/" in found.source
        text = FOLDER / found.licence.split(", ")[1]
        assert "Copyright" in text.read_text()


def test_parameters_are_those_of_the_source() -> None:
    """Digits copied by hand from the sources' files."""
    assert bicycle("browser").IBxx == 0.52962890621
    assert bicycle("steer-by-wire").mR == 10.12
    assert bicycle("pista").lam == 0.275762021815
    assert catalogue.load("browser").standard_deviation["zB"] == 0.00265022978777


def test_a_rigid_rider_is_part_of_the_rear_frame() -> None:
    """The parallel axis theorem, and the sum of Meijaard et al. 2007's benchmark."""
    alone, ridden = bicycle("browser"), bicycle("browser-rider")
    assert ridden.mB == pytest.approx(alone.mB + 72.0)
    assert ridden.mass == pytest.approx(90.21)
    (stable,) = linear.critical_speeds(ridden).stable
    assert stable == pytest.approx((5.0, 7.11), abs=0.01)
    parts = (
        RigidRider(2.0, 0.4, -1.0, 0.1, 0.2, 0.3, 0.05),
        RigidRider(3.0, 0.1, -0.6, 0.4, 0.5, 0.6, -0.1),
    )
    both = measure.with_rider(measure.with_rider(alone, parts[0]), parts[1])
    # About the rear contact everything simply adds up.
    for axis, x, z in (("xx", 0.0, 1.0), ("yy", 1.0, 1.0), ("zz", 1.0, 0.0)):
        whole = getattr(both, f"IB{axis}") + both.mB * (x * both.xB**2 + z * both.zB**2)
        pieces = getattr(alone, f"IB{axis}") + alone.mB * (x * alone.xB**2 + z * alone.zB**2)
        for part in parts:
            pieces += getattr(part, f"I{axis}") + part.m * (x * part.x**2 + z * part.z**2)
        assert whole == pytest.approx(pieces, rel=1e-12)
    product = both.IBxz - both.mB * both.xB * both.zB
    pieces = alone.IBxz - alone.mB * alone.xB * alone.zB
    pieces += sum(part.Ixz - part.m * part.x * part.z for part in parts)
    assert product == pytest.approx(pieces, rel=1e-12)


def test_estimates_are_the_means_of_the_measured_bicycles() -> None:
    found = measure.estimates_of([bicycle(name) for name in MEASURED])
    assert len(found) == 19
    for name, (mean, deviation) in found.items():
        assert measure.ESTIMATES[name].mean == pytest.approx(mean, abs=5.1e-4), name
        assert measure.ESTIMATES[name].deviation == pytest.approx(deviation, abs=1e-3), name


def tape(b: Bicycle, **more: float) -> TapeReadings:
    """Return the readings of tape measure and scale on a measured bicycle."""
    return TapeReadings(
        wheelbase=b.w,
        head_angle=90.0 - math.degrees(b.lam),
        rear_radius=b.rR,
        front_radius=b.rF,
        mass=b.mass,
        trail=b.c,
        **more,
    )


def test_a_tape_measure_finds_the_weave_speed_roughly() -> None:
    """Half of ten measured bicycles are within 0.2 m/s, all but one within 0.8 m/s."""
    errors = []
    for name in MEASURED:
        guessed, notes = measure.bicycle(tape(bicycle(name)))
        assert guessed.mass == pytest.approx(bicycle(name).mass)
        assert len(notes) > 10
        (exact,), (found,) = (
            linear.critical_speeds(one).weave for one in (bicycle(name), guessed)
        )
        errors.append(abs(found - exact))
    assert np.median(errors) < 0.2
    assert np.sort(errors)[-2] < 0.8
    assert max(errors) < 1.5


def test_what_is_measured_is_kept() -> None:
    b = bicycle("browser")
    found, notes = measure.bicycle(
        tape(
            b,
            rear_wheel_mass=b.mR,
            front_wheel_mass=b.mF,
            fork_mass=b.mH,
            front_load=b.mass * b.mass_forward / b.w,
            mass_height=b.mass_height,
        )
    )
    for name in ("w", "c", "lam", "rR", "rF", "mR", "mF", "mH", "mB"):
        assert getattr(found, name) == pytest.approx(getattr(b, name), rel=1e-12), name
    assert found.mass_forward == pytest.approx(b.mass_forward)
    assert found.mass_height == pytest.approx(b.mass_height)
    assert not any(note.startswith(("mR", "mF", "mH", "xB", "zB")) for note in notes)
    assert any(note.startswith("IBxx") for note in notes)


def test_fork_offset_gives_the_trail() -> None:
    b = bicycle("browser")
    offset = b.rF * math.sin(b.lam) - b.c * math.cos(b.lam)
    given = {**asdict(tape(b)), "trail": None, "fork_offset": offset}
    found, _ = measure.bicycle(TapeReadings(**given))
    assert found.c == pytest.approx(b.c, rel=1e-12)


@pytest.mark.parametrize(
    ("name", "mass", "height", "forward", "mean"),
    [("browser", 72.0, 1.0114, 0.1755, 4.99), ("balance-assist", 83.5, 1.0597, 0.1965, 4.09)],
)
def test_a_rider_by_weight_and_height(
    name: str, mass: float, height: float, forward: float, mean: float
) -> None:
    """The reference is the rider who was measured in 95 places, on the same bicycle."""
    rider = measure._rider(
        tape(
            bicycle(name),
            rider_mass=mass,
            rider_height=measure.RIDER_HEIGHT,
            saddle_height=height,
            saddle_forward=forward,
        )
    )
    ridden = measure.with_rider(bicycle(name), rider)
    measured = bicycle(f"{name}-rider")
    (weave,), (expected,) = (linear.critical_speeds(one).weave for one in (ridden, measured))
    assert expected == pytest.approx(mean, abs=0.01)
    assert weave == pytest.approx(expected, abs=0.2)


def test_the_loader_takes_a_name_or_a_file(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text((FOLDER / "pista.yaml").read_text().replace("name: pista\n", ""))
    found = catalogue.load(path)
    assert found.name == "mine"
    assert found.parameters.bicycle == bicycle("pista")


def text_of(**changes: Any) -> str:
    data = yaml.safe_load((FOLDER / "benchmark.yaml").read_text())
    return yaml.safe_dump({**data, **changes})


def test_a_file_may_have_all_parts() -> None:
    found = catalogue.read(
        text_of(
            motor={"lag": 0.03, "limit": 7},
            delay=0.05,
            steering={"friction": "2e-1"},
            resistance={"drag_area": 0.5},
            substeps=5,
        ),
        "mine",
        "mine.yaml",
    ).parameters
    assert (found.motor.lag, found.motor.limit, found.delay, found.substeps) == (
        0.03,
        7.0,
        0.05,
        5,
    )
    assert found.steering.friction == 0.2


BAD: dict[str, tuple[str, str]] = {
    "no YAML": ("{a: [", "mine.yaml is no YAML"),
    "a list": ("- 1", "must be a mapping"),
    "unknown part": (text_of(moter={}), "no 'moter' .did you mean 'motor'"),
    "unknown parameter": (
        text_of(bicycle={"wheelbase": 1.0}),
        "Bicycle has no field 'wheelbase'",
    ),
    "misspelt": (text_of(motor={"lagg": 1}), "has no field 'lagg' .did you mean 'lag'"),
    "missing": (text_of(bicycle={"w": 1.0}), "bicycle lacks c, lam, rR"),
    "both": (text_of(measured={}), "either 'bicycle' with the 25 parameters or 'measured'"),
    "neither": ("name: x", "either 'bicycle' with the 25 parameters or 'measured'"),
    "a word": (text_of(delay="long"), "delay must be a number, not 'long'"),
    "a list of words": (text_of(delay=["long"]), "delay must be a number"),
    "negative": (text_of(motor={"lag": -1}), "lag must be zero or more, not -1"),
    "name": (text_of(name=3), "name must be a text"),
    "no trail": (
        "measured: {wheelbase: 1, head_angle: 70, rear_radius: 0.3, front_radius: 0.3, mass: 15}",
        "either trail or fork_offset",
    ),
    "half a rider": (
        "measured: {wheelbase: 1, head_angle: 70, rear_radius: 0.3, front_radius: 0.3, mass: 15,"
        " trail: 0.05, rider_mass: 70}",
        "a rider needs rider_mass, rider_height",
    ),
    "radians": (
        "measured: {wheelbase: 1, head_angle: 1.2, rear_radius: 0.3, front_radius: 0.3, mass: 15,"
        " trail: 0.05}",
        "head_angle must lie between 25 and 155 degrees, not 1.2",
    ),
    "too large": (
        "measured: {wheelbase: 1, head_angle: 70, rear_radius: 1.0e+308, front_radius: 0.3,"
        " mass: 15, trail: 0.05}",
        "mine.yaml: ",
    ),
    "a deviation of words": (text_of(standard_deviation={"w": [1]}), "w is '.1.', not a number"),
    "a name that forges": (text_of(name="a" + chr(27) + "[31m"), "must be one line of plain text"),
    "too heavy wheels": (
        "measured: {wheelbase: 1, head_angle: 70, rear_radius: 0.3, front_radius: 0.3, mass: 15,"
        " trail: 0.05, rear_wheel_mass: 9, front_wheel_mass: 9}",
        "as heavy as the whole bicycle",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_mistakes_are_one_line_that_names_the_key(case: str) -> None:
    text, words = BAD[case]
    with pytest.raises(ValueError, match=words) as caught:
        catalogue.read(text, "mine", "mine.yaml")
    assert str(caught.value).startswith("mine.yaml")
    assert "\n" not in str(caught.value)


def test_an_unknown_bicycle_gives_the_nearest_and_all() -> None:
    with pytest.raises(ValueError, match=r"did you mean 'crescendo'.*yellow-reversed"):
        catalogue.load("crescendoo")
    with pytest.raises(ValueError, match="no bicycle '/nowhere"):
        catalogue.load("/nowhere/at/all.yaml")


def test_the_json_of_a_named_bicycle_has_its_name() -> None:
    from bicycle_sim.plants import registry

    plant = registry.named("whipple", "browser-rider")
    assert json.loads(plant.to_json())["name"] == "browser-rider"
