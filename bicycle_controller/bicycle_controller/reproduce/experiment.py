"""Definition of an experiment: one YAML file of `figures/`, validated on reading."""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from importlib import resources
from typing import Any

from bicycle_common import yaml_text
from bicycle_common.validation import nearest, reject_unknown, require
from bicycle_controller.config import loading
from bicycle_controller.evaluation.rollouts import Disturbance
from bicycle_sim.task.scenario import Scenario, named

MODES = ("faithful", "corrected")
ROLES = ("paper", "authors", "baseline", "best", "lqr")
"""Roles: Tables 2 and 3 as printed; the authors' settings; NAF and PPO; ours; the LQR."""
PICTURES = (
    "terms",
    "learning",
    "states",
    "displacement",
    "goals",
    "turn",
    "speed",
    "robustness",
    "cause",
)
"""Kinds of figures, see `pictures`."""
CAUSES = "causes"
"""Folder of the experiments named `why-...`."""


@dataclass(frozen=True)
class Length:
    """Length of an experiment."""

    seeds: int
    """Number of training runs of each arm, with seeds 1, 2, ..."""
    episodes: int
    """Episodes of `Experiment.limit` steps in each run; 0 if nothing is trained."""
    rides: int
    """Number of rides that score each controller."""
    evaluations: int = 10
    """Least number of scores without noise along a training run."""
    limit: int = 0
    """Step limit of every episode and ride instead of the experiment's; 0 keeps that."""

    def __post_init__(self) -> None:
        for name in ("seeds", "rides"):
            require(getattr(self, name) >= 1, f"{name} must be at least 1")
        require(self.episodes >= 0, "episodes must not be below 0")


@dataclass(frozen=True)
class Arm:
    """Something that is trained."""

    name: str
    """Name in the data's column."""
    role: str
    """Role in the comparison, one of ROLES."""
    preset: str
    set: tuple[str, ...] = ()
    """Changes of the preset."""
    most_steps: int = 0
    """Environment steps that suffice, regardless of the experiment's length; 0 sets no bound."""


@dataclass(frozen=True)
class ExistingController:
    """An existing controller."""

    name: str
    role: str
    controller: str
    """Name or file, as `bicycle evaluate` accepts it."""
    variants: tuple[str, ...] = ()
    """Names of the variants that it rides; all by default."""


@dataclass(frozen=True)
class Variant:
    """Settings that an experiment compares with others."""

    name: str
    label: str
    scenario: str = ""
    """Scenario instead of the experiment's."""
    set: tuple[str, ...] = ()
    """Changes of the scenario."""
    disturbance: dict[str, Any] = field(default_factory=dict)
    """Fields of `rollouts.Disturbance`."""

    @property
    def trial(self) -> Disturbance:
        """Disturbance of the rides."""
        reject_unknown(Disturbance, self.disturbance)
        return Disturbance(**self.disturbance)


ALL = Variant("all", "")
"""Variant of an experiment that compares no settings."""


@dataclass(frozen=True)
class Experiment:
    """One figure or table.

    Raises:
        ValueError: on an unknown name or a value out of range.
    """

    name: str
    title: str
    picture: str
    """Kind of picture, one of PICTURES."""
    scenario: str
    paper: str
    """Result in the paper."""
    differs: str
    """Differences of this reproduction."""
    full: Length
    """Length as in the paper."""
    short: Length
    """Length of about a minute."""
    reports: str = ""
    """The paper's result in a few words, for a table."""
    limit: int = 400
    """Steps of a full episode."""
    set: tuple[str, ...] = ()
    """Changes of the scenario, in training and in rides."""
    ride_set: tuple[str, ...] = ()
    """Changes of the scenario in rides only."""
    arms: tuple[Arm, ...] = ()
    riders: tuple[ExistingController, ...] = ()
    variants: tuple[Variant, ...] = (ALL,)
    train_variants: bool = True
    """True to train every arm on every variant; False to train once, without variants."""
    tracks: int = 0
    """Number of rides whose track is kept for the picture."""

    def __post_init__(self) -> None:
        require(self.picture in PICTURES, f"unknown picture {self.picture!r}")
        for role in (*(a.role for a in self.arms), *(r.role for r in self.riders)):
            require(role in ROLES, f"unknown role {role!r}")

    def variant(self, name: str) -> Variant:
        """Return the variant of that name, or the plain one."""
        return next((item for item in self.variants if item.name == name), ALL)

    def trained(self) -> tuple[Variant, ...]:
        """Return the variants on which each arm is trained."""
        return self.variants if self.train_variants else (ALL,)

    def training_changes(self, variant: Variant) -> list[str]:
        """Return the `--set` changes of a run's scenario."""
        name = variant.scenario or self.scenario
        return [f"scenario={name}", *(f"scenario.{text}" for text in (*self.set, *variant.set))]

    def ridden(self, variant: Variant) -> Scenario:
        """Return the scenario on which controllers are scored."""
        scenario = named(variant.scenario or self.scenario)
        return loading.changed(scenario, [*self.set, *variant.set, *self.ride_set])


def names() -> list[str]:
    """Return the names of the figures and of further measurements, in the paper's order."""
    return sorted(_files(), key=lambda name: (not name.startswith("figure-"), len(name), name))


def causes() -> list[str]:
    """Return the names of the experiments that look for the cause of a failed claim."""
    return [f"why-{name}" for name in sorted(_files(CAUSES))]


def _files(folder: str = "") -> list[str]:
    found = resources.files("bicycle_controller") / "figures" / folder
    return [entry.name[:-5] for entry in found.iterdir() if entry.name.endswith(".yaml")]


def find(name: str) -> list[Experiment]:
    """Return the experiment of that name (`10` is `figure-10`), or all of them.

    Raises:
        ValueError: on an unknown name; names the nearest.
    """
    known = [*names(), *causes()]
    if name == "all":
        return [load(item) for item in known]
    full = f"figure-{name}" if name.isdigit() else name
    if full not in known:
        words = [item.removeprefix("figure-") for item in known]
        raise ValueError(f"unknown figure {name!r}{nearest(name, words)}; known: {words}, all")
    return [load(full)]


def load(name: str) -> Experiment:
    """Return the experiment of a file of `figures/`."""
    folder = resources.files("bicycle_controller") / "figures"
    file = folder / f"{name}.yaml"
    if name.startswith("why-"):
        file = folder / CAUSES / f"{name.removeprefix('why-')}.yaml"
    return build(name, yaml_text.load(file.read_text()))


def build(name: str, tree: dict[str, Any]) -> Experiment:
    """Build an experiment from nested plain data.

    Raises:
        ValueError: on an unknown key or value.
    """
    tree = tree | {"name": name}
    reject_unknown(Experiment, tree)
    values = dict(tree)
    for key in ("full", "short"):
        values[key] = _made(Length, tree[key])
    for key, kind in (("arms", Arm), ("riders", ExistingController), ("variants", Variant)):
        if key in tree:
            values[key] = tuple(_made(kind, item) for item in tree[key])
    for key in ("paper", "differs"):
        values[key] = " ".join(tree[key].split())
    for key in ("set", "ride_set"):
        values[key] = tuple(tree.get(key, ()))
    return Experiment(**values)


def _made(kind: Any, tree: Any) -> Any:
    reject_unknown(kind, tree)
    lists = {item.name for item in fields(kind) if item.type == "tuple[str, ...]"}
    return kind(**{key: tuple(v) if key in lists else v for key, v in tree.items()})


def limited(experiment: Experiment, length: Length) -> Experiment:
    """Return the experiment with the step limit of `length`, if that has one."""
    if not length.limit:
        return experiment
    changes = (*experiment.set, f"max_steps={length.limit}")
    return replace(experiment, limit=length.limit, set=changes, ride_set=())


def lengthened(
    experiment: Experiment, short: bool, episodes: int | None, seeds: int | None
) -> Length:
    """Return the full or the short length, with the command line's changes."""
    length = experiment.short if short else experiment.full
    if seeds is not None:
        length = replace(length, seeds=seeds)
    if episodes is not None and length.episodes:
        length = replace(length, episodes=episodes)
    return length
