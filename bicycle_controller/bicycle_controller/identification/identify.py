"""Identification of the ridden bicycle from logs and a similar bicycle.

Where a linear bicycle explains the ride down to its noise, all of the ride is fitted. Real
steering has friction and play, which a linear bicycle has not; where that leaves more than noise
and pushes show the weave, the modes that the pushes show are fitted instead.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from bicycle_common.validation import require
from bicycle_controller.identification.curvature import straightened
from bicycle_controller.identification.fitting import Fit, fit, noise_of
from bicycle_controller.identification.logs import Array, Log, Piece
from bicycle_controller.identification.ride_model import OutputNoise, matrices, residuals, weave
from bicycle_controller.identification.ringdown import MeasuredMode, Ringdown, ringdowns, summary
from bicycle_controller.identification.score import PredictionScore, ahead, law_of
from bicycle_controller.identification.unknowns import EXTRAS, Unknowns, unknowns
from bicycle_controller.identification.windows import Window, cut, stacks
from bicycle_sim.plants.whipple.parameters import Parameters

SECONDS = 1.0
"""s of a window."""
LEAST = 15
"""Windows below which a ride is too short."""
MOST = 150
"""Windows that are fitted at most, spread over the ride: more cost time and say little new."""
LAWFUL = 0.98
"""Share of the torque that a law must explain to be one."""
ADEQUATE = 1.5
"""Noise that a linear bicycle's fit may leave; above it, the linear model does not suffice."""
KEPT = 0.75
"""Share of each log that is fitted for the held-out score where no log is held out."""
TURNED_ROUND = {
    (-1.0, -1.0): "steer angle and torque turned round: add --steer-left, or turn the lean rate",
    (1.0, -1.0): "the steer torque turned round: it must be positive as the steer angle is",
    (-1.0, 1.0): "the steer angle turned round: it must be positive as lean rate and torque are",
}
"""Factors on steer angle and torque, and the advice to a user who logged them that way."""
CLEARLY = 0.4
"""Share of the residual as logged below which turned signs are certain."""
UNDETERMINED = 0.7
"""Share of its prior deviation above which a parameter was not determined."""


@dataclass(frozen=True)
class Mode:
    """The weave at one speed, 1/s and rad/s."""

    speed: float
    gain: float
    """N m s/rad of the law: steer torque per lean rate; zero lets the handlebar free."""
    sigma: float
    sigma_error: float
    omega: float
    omega_error: float


@dataclass(frozen=True)
class Identified:
    """Result of an identification."""

    fit: Fit
    logs: list[Log]
    noise: OutputNoise
    laws: list[tuple[float, float] | None]
    """(a, b) of each log whose torque is (a + b v) times the lean rate; else None."""
    by_pushes: bool
    """True if modes after pushes were fitted, False if the whole ride was."""
    measured: list[MeasuredMode]
    modes: list[Mode]
    held_out: tuple[PredictionScore, PredictionScore]
    held_out_names: list[str]
    held_out_modes: list[tuple[MeasuredMode, Mode]]

    @property
    def parameters(self) -> Parameters:
        """Parameters of the identified bicycle."""
        return self.fit.parameters

    def errors(self) -> dict[str, float]:
        """Return standard errors by parameter, in its unit."""
        deviation = np.sqrt(np.diag(self.fit.covariance))
        sizes = deviation * self.fit.unknowns.in_units(self.fit.x)
        return dict(zip(self.fit.unknowns.names, map(float, sizes), strict=True))

    def undetermined(self) -> list[str]:
        """Return the parameters about which the ride says little."""
        deviation = np.sqrt(np.diag(np.linalg.inv(self.fit.ride + np.eye(len(self.fit.x)))))
        pairs = zip(self.fit.unknowns.names, deviation, strict=True)
        return [name for name, value in pairs if value > UNDETERMINED]

    def combinations(self) -> tuple[int, list[dict[str, float]]]:
        """Return how many combinations of the parameters the ride determines, and these.

        They are the eigenvectors of its Fisher information whose eigenvalue exceeds the prior's,
        the best known first, each by the parameters (in prior deviations) that make most of it.
        """
        values, vectors = np.linalg.eigh(self.fit.ride)
        known = [index for index in np.argsort(-values) if values[index] > 1.0]
        names = self.fit.unknowns.names
        described = []
        for index in known:
            vector = vectors[:, index] * np.sign(
                vectors[np.abs(vectors[:, index]).argmax(), index]
            )
            large = [i for i in np.argsort(-np.abs(vector)) if abs(vector[i]) > 0.3]
            described.append({names[i]: float(vector[i]) for i in large})
        return len(known), described


def identify(
    logs: list[Log],
    prior: Parameters,
    trust: float = 1.0,
    held_out: list[Log] | None = None,
    speeds: tuple[float, ...] = (),
) -> Identified:
    """Return the bicycle that was ridden.

    Args:
        logs: what is fitted.
        prior: a bicycle that is alike.
        trust: factor on how well the prior's numbers are known.
        held_out: logs that are foretold, not fitted; None judges the last quarter of each log by
            a fit to the rest of it.
        speeds: m/s of more modes.

    Raises:
        ValueError: if the logs are too short or hold no torque; one line.
    """
    require(prior.count is None, "the bicycle's file must have one number for each parameter")
    require(prior.rider is None, "a leaning rider cannot be identified: give one who sits still")
    noise = noise_of(logs)
    laws = [_law(log) for log in logs]
    windows = _checked(logs)
    pushed = [ringdowns(log) for log in logs]
    _check_signs(prior, windows, noise)
    found = _fitted(logs, prior, trust, noise, laws, windows, pushed, None)
    by_pushes = found[1]
    measured = [m for log, seen in zip(logs, pushed, strict=True) for m in summary(log, seen)]
    if held_out:
        judged, since, names = held_out, 0.0, [log.name for log in held_out]
        judge = found[0].parameters
    else:
        judged, since, names = logs, KEPT, [f"the last quarter of {log.name}" for log in logs]
        judge = _fitted(logs, prior, trust, noise, laws, windows, pushed, KEPT)[0].parameters
    judged_laws = [_law(log) for log in judged]
    scores = ahead(judge, judged, noise_of(judged), judged_laws, since)
    held_modes = []
    for log, law in zip(judged, judged_laws, strict=True) if held_out else ():
        if law is None:
            continue
        for seen in summary(log, ringdowns(log)):
            held_modes.append((seen, _mode(found[0], seen.speed, law[0] + law[1] * seen.speed)))
    return Identified(
        found[0], logs, noise, laws, by_pushes, measured,
        _modes(found[0], logs, laws, speeds), scores, names, held_modes,
    )  # fmt: skip


def _law(log: Log) -> tuple[float, float] | None:
    a, b, share = law_of(log)
    return (a, b) if share >= LAWFUL else None


def _checked(logs: list[Log]) -> list[Window]:
    """Return the windows of the logs; refuse logs that determine nothing."""
    windows = cut(logs, SECONDS)
    require(
        len(windows) >= LEAST,
        f"only {len(windows)} s of riding above 0.5 m/s without pushes in "
        f"{', '.join(log.name for log in logs)}; at least {LEAST} s are needed",
    )
    torque = np.concatenate([piece.torque for log in logs for piece in log.pieces])
    lean = np.concatenate([piece.lean_rate for log in logs for piece in log.pieces])
    steer = np.concatenate([piece.steer_angle for log in logs for piece in log.pieces])
    for name, values in (("steer torque", torque), ("lean rate", lean), ("steer angle", steer)):
        require(float(np.std(values)) > 1e-9, f"the {name} never changes: is it the right column?")
    return windows


def _check_signs(prior: Parameters, windows: list[Window], noise: OutputNoise) -> None:
    """Refuse logs that the prior bicycle explains far better with a sign turned round."""
    m = matrices(prior)
    groups = stacks(_spread(windows, 40))

    def left(steer: float, torque: float) -> float:
        sizes = []
        for stack in groups:
            turned = stack._replace(
                steer_angle=steer * stack.steer_angle, torque=torque * stack.torque
            )
            sizes.append((residuals(prior, m, turned, noise) ** 2).mean(axis=1))
        return float(np.median(np.sqrt(np.concatenate(sizes))))

    as_logged = left(1.0, 1.0)
    for (steer, torque), remedy in TURNED_ROUND.items():
        if left(steer, torque) < CLEARLY * as_logged:
            raise ValueError(f"the logs fit a bicycle far better with {remedy}")


def _fitted(
    logs: list[Log],
    prior: Parameters,
    trust: float,
    noise: OutputNoise,
    laws: list[tuple[float, float] | None],
    windows: list[Window],
    pushed: list[list[Ringdown]],
    until: float | None,
) -> tuple[Fit, bool]:
    """Return the fit, and True if it is to modes after pushes."""
    share = 1.0 if until is None else until
    used = [one for one in windows if one.time < share * _length(logs[one.log], one)]
    first = stacks(_spread(used, 40))
    unknown = unknowns(prior, trust, tuple(EXTRAS))
    rough = fit(unknown, first, noise, turns=2)
    rough = fit(
        unknown, straightened(rough.parameters, first, noise), noise, start=rough.x, turns=1
    )
    measured = []
    for log, law, seen in zip(logs, laws, pushed, strict=True):
        early = [one for one in seen if one.start < share * len(log.pieces[one.piece].speed)]
        if law is not None:
            measured += [(one, law[0] + law[1] * one.speed) for one in summary(log, early)]
    if max(rough.misfit) > ADEQUATE and measured:
        free: Unknowns = unknowns(prior, trust, ("damping",))
        return fit(free, [], noise, measured=measured), True
    whole = stacks(_spread(used, MOST))
    for turns in (1, 2):
        even = straightened(rough.parameters, whole, noise)
        rough = fit(unknown, even, noise, start=rough.x, turns=turns)
    return rough, False


def _length(log: Log, one: Window) -> float:
    """Return the length of the log's longest piece, s; a window's length is a share of it."""
    longest: Piece = max(log.pieces, key=lambda piece: len(piece.speed))
    return len(longest.speed) * one.dt


def _spread(windows: list[Window], most: int) -> list[Window]:
    if len(windows) <= most:
        return windows
    return [windows[i] for i in np.linspace(0, len(windows) - 1, most).astype(int)]


def _modes(
    found: Fit, logs: list[Log], laws: list[tuple[float, float] | None], speeds: tuple[float, ...]
) -> list[Mode]:
    """Return the weave at each log's usual speed, free and under its law, and at more speeds."""
    rows = []
    known = [law for law in laws if law is not None]
    for log, law in zip(logs, laws, strict=True):
        values = np.concatenate([piece.speed for piece in log.pieces])
        speed = float(np.median(values[values > 0.5]))
        rows.append(_mode(found, speed, 0.0))
        if law is not None:
            rows.append(_mode(found, speed, law[0] + law[1] * speed))
    for speed in speeds:
        rows.append(_mode(found, speed, 0.0))
        if len(known) == len(laws):
            a, b = np.mean(known, axis=0)
            rows.append(_mode(found, speed, float(a + b * speed)))
    return rows


def _mode(found: Fit, speed: float, gain: float) -> Mode:
    """Return a mode with its standard errors, by the derivatives of both its parts."""

    def at(x: Array) -> Array:
        p = found.unknowns.parameters(x)
        mode = weave(p, matrices(p), speed, gain)
        return np.array([mode.real, mode.imag])

    here = at(found.x)
    slopes = np.zeros((2, len(found.x)))
    for column in range(len(found.x)):
        moved = found.x.copy()
        moved[column] += 1e-4
        slopes[:, column] = (at(moved) - here) / 1e-4
    spread = np.sqrt(np.maximum(np.diag(slopes @ found.covariance @ slopes.T), 0.0))
    errors = [float(value) if math.isfinite(value) else math.inf for value in spread]
    return Mode(speed, gain, float(here[0]), errors[0], float(here[1]), errors[1])
