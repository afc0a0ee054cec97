from typing import Any

import numpy as np
import pytest

from bicycle_controller.control.exploration_noise import Noise, NoiseConfig


def make(
    kind: str = "ou", sigma: float = 0.2, count: int = 4, seed: int = 0, **more: Any
) -> Noise:
    config = NoiseConfig(kind, sigma, 0.15, **more)
    return Noise(config, count, 2, np.random.default_rng(seed))


def test_ornstein_uhlenbeck_follows_the_authors_recursion() -> None:
    noise, normal = make(), np.random.default_rng(0)
    expected = np.zeros((4, 2))
    for _ in range(5):
        expected = expected - 0.15 * expected + 0.2 * normal.standard_normal((4, 2))
        assert np.allclose(noise.sample(), expected, rtol=0, atol=1e-15)


def test_ornstein_uhlenbeck_has_the_stationary_spread_and_memory_of_the_formula() -> None:
    noise = make(count=500)
    samples = np.stack([noise.sample() for _ in range(300)])[100:]
    assert samples.std() == pytest.approx(0.2 / np.sqrt(1 - 0.85**2), rel=0.03)
    lagged = (samples[1:] * samples[:-1]).mean() / samples.var()
    assert lagged == pytest.approx(0.85, abs=0.02)


def test_gaussian_noise_has_no_memory() -> None:
    noise = make("gaussian", count=500)
    samples = np.stack([noise.sample() for _ in range(200)])
    assert samples.std() == pytest.approx(0.2, rel=0.02)
    assert abs((samples[1:] * samples[:-1]).mean()) < 0.001


def test_none_is_zero() -> None:
    assert not make("none").sample().any()


def test_reset_touches_only_the_bicycles_whose_episode_ended() -> None:
    noise = make()
    before = noise.sample()
    noise.reset(np.array([True, False, True, False]))
    assert not noise.value[[0, 2]].any()
    assert np.array_equal(noise.value[[1, 3]], before[[1, 3]])


def test_the_bicycles_sigmas_spread_from_the_least_to_the_largest() -> None:
    noise = make("gaussian", 0.1, 3, sigma_max=0.5)
    assert np.allclose(noise.sigma[:, 0], [0.1, 0.3, 0.5])


def test_a_saved_process_goes_on_to_the_bit() -> None:
    noise, other = make(), make(seed=9)
    noise.sample()
    other.load_state_dict(noise.state_dict())
    for _ in range(3):
        assert np.array_equal(noise.sample(), other.sample())


def test_what_sample_gives_is_the_callers() -> None:
    noise = make()
    noise.sample()[:] = 99.0
    assert np.abs(noise.value).max() < 5.0


@pytest.mark.parametrize(
    ("values", "word"),
    [
        (("brown", 0.2, 0.15), "noise.kind"),
        (("ou", -0.1, 0.15), "noise.sigma"),
        (("ou", 0.1, 1.5), "noise.theta"),
        (("ou", float("nan"), 0.1), "noise.sigma"),
    ],
)
def test_impossible_noise_is_refused(values: tuple[Any, ...], word: str) -> None:
    with pytest.raises(ValueError, match=word):
        NoiseConfig(*values)
