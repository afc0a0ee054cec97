"""Verdicts on the paper's claims, from the summary's numbers: one function per kind of figure.

A claim about DDPG is judged by `authors`, the paper's authors' settings; the other arms, ours
and the classical controller appear in the notes and decide nothing.
"""

from __future__ import annotations

from collections.abc import Callable

from bicycle_controller.reproduce import learning_claims, riding_claims
from bicycle_controller.reproduce.experiment import Experiment
from bicycle_controller.reproduce.verdicts import FigureVerdict, Summary

CLAIMS: dict[str, Callable[[Experiment, Summary], FigureVerdict]] = {
    "terms": learning_claims.terms,
    "learning": learning_claims.learning,
    "states": learning_claims.states,
    "displacement": riding_claims.displacement,
    "goals": riding_claims.goals,
    "turn": riding_claims.turn,
    "speed": riding_claims.speed,
    "robustness": riding_claims.robustness,
    "cause": riding_claims.cause,
}


def verdict(experiment: Experiment, summary: Summary) -> FigureVerdict:
    """Return the verdict on an experiment's claims."""
    return CLAIMS[experiment.picture](experiment, summary)
