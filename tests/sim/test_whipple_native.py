"""The compiled Whipple step: the same bits as numpy, whatever instructions it takes."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from whipple_maker import riding, various

from bicycle_sim.plants.base import Loads, to_array
from bicycle_sim.plants.whipple import native, parameters
from bicycle_sim.plants.whipple.native import Library
from bicycle_sim.plants.whipple.parameters import Parameters
from bicycle_sim.plants.whipple.plant import WhipplePlant

FOLDER = Path(native.__file__).parent


@pytest.fixture
def library() -> Library:
    found = native.load()
    assert found is not None, "set-up has not built it"
    return found


def ride(p: Parameters, width: int | None, count: int, loaded: bool) -> np.ndarray:
    """States after rides of 60 periods, as bits; `width` None is numpy."""
    plant = WhipplePlant(p, compiled=width is not None)
    if plant._library is not None and width is not None:
        plant._library.width = width
    rng = np.random.default_rng(11)
    state = riding(plant, rng.uniform(1.0, 7.0, count), 0.4 * rng.normal(size=count), count)
    for step in range(60):
        torque, pedal = 3.0 * rng.normal(size=count), 50.0 * rng.normal(size=count)
        moved = 0.03 * rng.normal(size=count) * (p.rider is not None)
        loads = Loads(lateral_force=30.0 * rng.normal(size=count), wind_x=rng.normal(size=count))
        state = plant.step(
            state,
            torque,
            moved,
            pedal,
            (1.0, 6.0) if step % 2 else None,
            loads if loaded else None,
        )
    return to_array(state).view(np.int64)


CASES = {
    "plain": (various(21, 1, plain=True), 21, False),
    "loads on plain bicycles": (various(21, 1, plain=True), 21, True),
    "everything": (various(21, 2), 21, True),
    "leaning riders": (various(21, 3, rider=True), 21, True),
    "one bicycle": (parameters.take(various(1, 4, rider=True), slice(0, 1)), 1, True),
}


@pytest.mark.parametrize("case", CASES)
def test_all_instructions_and_numpy_give_the_same_bits(library: Library, case: str) -> None:
    p, count, loaded = CASES[case]
    widest = library.width
    try:
        expected = ride(p, None, count, loaded)
        for width in range(widest + 1):
            assert np.array_equal(ride(p, width, count, loaded), expected), width
    finally:
        library.width = widest


def test_the_place_in_the_batch_does_not_matter(library: Library) -> None:
    """Whichever lane of a vector a bicycle is in, and with how many others."""
    p = various(1, 5)
    alone = parameters.take(p, slice(0, 1))
    many = parameters.take(alone, np.zeros(19, dtype=int))
    once = ride(many, library.width, 19, False)
    plant = WhipplePlant(many)
    state = riding(plant, 4.0, 0.2, 19)
    for _ in range(20):
        state = plant.step(state, np.full(19, 0.5), np.zeros(19), np.zeros(19))
    rows = to_array(state).view(np.int64)
    assert (rows == rows[:1]).all()
    assert not (once == once[:1]).all()


def test_it_never_changes_its_input(library: Library) -> None:
    p = various(9, 6, rider=True)
    plant = WhipplePlant(p)
    state = riding(plant, 4.0, 0.2, 9)
    kept = {name: values.copy() for name, values in vars(state).items()}
    torque = np.ones(9)
    plant.step(state, torque, np.full(9, 0.01), np.ones(9))
    plant.trace(state, torque, np.full(9, 0.01), np.ones(9))
    plant.pushed(state, 0.3)
    for name, values in kept.items():
        assert np.array_equal(getattr(state, name), values), name
    assert (torque == 1.0).all()


def test_no_product_is_fused(tmp_path: Path) -> None:
    """Code compiled for the widest instructions has no fused multiply-add."""
    objdump = shutil.which("objdump")
    if objdump is None:
        pytest.skip("no objdump here")
    (built,) = FOLDER.glob(f"{native.LIBRARY}*.so")
    text = subprocess.run(
        [objdump, "-d", str(built)], capture_output=True, text=True, check=True
    ).stdout
    assert "vmulpd" in text
    assert "vfmadd" not in text
    assert "vfmsub" not in text


def test_without_it_numpy_steps_and_one_line_says_so(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(native, "LIBRARY", "_absent")
    native.load.cache_clear()
    try:
        plant = WhipplePlant(various(3, 7))
        assert plant._library is None
        WhipplePlant(various(3, 7))
        err = capsys.readouterr().err
        assert err.count("\n") == 1
        assert "ros2_ws/setup.sh" in err
    finally:
        native.load.cache_clear()


def test_a_library_of_other_sources_is_not_used(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(native, "LAYOUT", native.LAYOUT.replace("gravity", "levity", 1))
    native.load.cache_clear()
    try:
        assert native.load() is None
        assert "other sources" in capsys.readouterr().err
    finally:
        native.load.cache_clear()
