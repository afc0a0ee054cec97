"""What an experiment is made of: one YAML file of `figures/` each, validated on reading."""

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
"""Tables 2 and 3 as printed; what the authors ran; NAF and PPO; ours; the classical controller."""
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
    """How much of an experiment is run."""

    seeds: int
    """Training runs of each arm, with seeds 1, 2, ..."""
    episodes: int
    """Episodes of `Experiment.limit` steps each run makes; 0 where nothing is trained."""
    rides: int
    """Rides that each controller is scored by."""
    evaluations: int = 10
    """Scores without noise along a training run, at least."""
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
    """Of its column in the data."""
    role: str
    """One of ROLES."""
    preset: str
    set: tuple[str, ...] = ()
    """Changes of the preset."""
    most_steps: int = 0
    """Environment steps that suffice, however long the experiment is; 0 sets no bound."""


@dataclass(frozen=True)
class Rider:
    """A controller that is there already."""

    name: str
    role: str
    controller: str
    """What `bicycle evaluate` takes."""
    variants: tuple[str, ...] = ()
    """Names of the variants that it rides; all by default."""


@dataclass(frozen=True)
class Variant:
    """One of several settings that an experiment compares."""

    name: str
    label: str
    scenario: str = ""
    """Instead of the experiment's."""
    set: tuple[str, ...] = ()
    """Changes of the scenario."""
    disturbance: dict[str, Any] = field(default_factory=dict)
    """Fields of `rides.Disturbance`."""

    @property
    def trial(self) -> Disturbance:
        """What the rides are disturbed by."""
        reject_unknown(Disturbance, self.disturbance)
        return Disturbance(**self.disturbance)


ALL = Variant("all", "")
"""Of an experiment that compares no settings."""


@dataclass(frozen=True)
class Experiment:
    """One figure or table.

    Raises:
        ValueError: on an unknown name or a value out of range.
    """

    name: str
    title: str
    picture: str
    """One of PICTURES."""
    scenario: str
    paper: str
    """What the paper reports."""
    differs: str
    """What is different here."""
    full: Length
    """As long as the paper's."""
    short: Length
    """A minute's."""
    reports: str = ""
    """The same in a few words, for a table."""
    limit: int = 400
    """Steps of a full episode."""
    set: tuple[str, ...] = ()
    """Changes of the scenario, in training and in rides."""
    ride_set: tuple[str, ...] = ()
    """Changes of the scenario in rides only."""
    arms: tuple[Arm, ...] = ()
    riders: tuple[Rider, ...] = ()
    variants: tuple[Variant, ...] = (ALL,)
    train_variants: bool = True
    """Whether every arm is trained on every variant, or once, without."""
    tracks: int = 0
    """Rides whose way is kept for the picture."""

    def __post_init__(self) -> None:
        require(self.picture in PICTURES, f"unknown picture {self.picture!r}")
        for role in (*(a.role for a in self.arms), *(r.role for r in self.riders)):
            require(role in ROLES, f"unknown role {role!r}")

    def variant(self, name: str) -> Variant:
        """The variant of that name, or the plain one."""
        return next((item for item in self.variants if item.name == name), ALL)

    def trained(self) -> tuple[Variant, ...]:
        """What each arm is trained on."""
        return self.variants if self.train_variants else (ALL,)

    def training_changes(self, variant: Variant) -> list[str]:
        """`--set` changes that make a run's scenario."""
        name = variant.scenario or self.scenario
        return [f"scenario={name}", *(f"scenario.{text}" for text in (*self.set, *variant.set))]

    def ridden(self, variant: Variant) -> Scenario:
        """The scenario that controllers are scored on."""
        scenario = named(variant.scenario or self.scenario)
        return loading.changed(scenario, [*self.set, *variant.set, *self.ride_set])


def names() -> list[str]:
    """The paper's figures and what is measured beside them, in the paper's order."""
    return sorted(_files(), key=lambda name: (not name.startswith("figure-"), len(name), name))


def causes() -> list[str]:
    """The experiments that look for why a claim does not hold."""
    return [f"why-{name}" for name in sorted(_files(CAUSES))]


def _files(folder: str = "") -> list[str]:
    found = resources.files("bicycle_controller") / "figures" / folder
    return [entry.name[:-5] for entry in found.iterdir() if entry.name.endswith(".yaml")]


def find(name: str) -> list[Experiment]:
    """The experiment of that name (`10` is `figure-10`), or all of them.

    Raises:
        ValueError: on an unknown name, with the nearest.
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
    """The experiment of a file of `figures/`."""
    folder = resources.files("bicycle_controller") / "figures"
    file = folder / f"{name}.yaml"
    if name.startswith("why-"):
        file = folder / CAUSES / f"{name.removeprefix('why-')}.yaml"
    return build(name, yaml_text.load(file.read_text()))


def build(name: str, tree: dict[str, Any]) -> Experiment:
    """The experiment of nested plain data.

    Raises:
        ValueError: on an unknown key or value.
    """
    tree = tree | {"name": name}
    reject_unknown(Experiment, tree)
    values = dict(tree)
    for key in ("full", "short"):
        values[key] = _made(Length, tree[key])
    for key, kind in (("arms", Arm), ("riders", Rider), ("variants", Variant)):
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
    """The experiment with the step limit of `length`, where that has one."""
    if not length.limit:
        return experiment
    changes = (*experiment.set, f"max_steps={length.limit}")
    return replace(experiment, limit=length.limit, set=changes, ride_set=())


def lengthened(
    experiment: Experiment, short: bool, episodes: int | None, seeds: int | None
) -> Length:
    """The full or the short length, with what the command line changes of it."""
    length = experiment.short if short else experiment.full
    if seeds is not None:
        length = replace(length, seeds=seeds)
    if episodes is not None and length.episodes:
        length = replace(length, episodes=episodes)
    return length
