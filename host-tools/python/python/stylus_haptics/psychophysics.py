"""Analysis of the answers that pages of ``stylus compare`` save, and simulated listeners to check it with.

    >>> from stylus_haptics import psychophysics
    >>> rows = psychophysics.read(["answers-1.csv", "answers-2.csv"])    # or pandas.read_csv, R's read.csv
    >>> psychophysics.sensitivities(rows)                                # A/B/X: d' of each pair, with intervals
    >>> psychophysics.thresholds(rows)                                   # staircases: the 70.7 % points
    >>> psychophysics.ratings(rows)                                      # a mixed model; takes statsmodels

**d'** of A/B/X follows from the proportion of right answers of an unbiased listener, by one of two models (Macmillan
and Creelman, "Detection Theory: A User's Guide", 2nd edition, 2005, chapter 9; the R package ``psyphy`` has the same
formulas in ``dprime.ABX``). ``differencing``: the listener takes the one of A and B that is nearer to X, P = Φ(d'/√2)
Φ(d'/√6) + Φ(-d'/√2) Φ(-d'/√6). It suits tests whose trials have many surfaces, as those of ``compare``.
``independent``: the listener knows where the border of both kinds lies, P = Φ(d'/√2) Φ(d'/2) + Φ(-d'/√2) Φ(-d'/2). It
suits two sounds that never change, and is the best that anyone can do. Both rise with d', so that the exact interval of
the proportion (Clopper and Pearson, 1934) becomes that of d'.
"""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Callable, Iterable, Sequence

import numpy as np

from . import _native

Row = dict[str, Any]

#: Divisors of d' in the two factors of the proportion, by model.
MODELS = {"differencing": (math.sqrt(2), math.sqrt(6)), "independent": (math.sqrt(2), 2.0)}

#: Proportion of right answers at which two of them in a row are as likely as not.
TWO_DOWN_ONE_UP = math.sqrt(0.5)

#: Most strengths of a staircase's grid: many times those of a page.
MOST_STEPS = 1000


def read(paths: str | Path | Iterable[str | Path]) -> list[Row]:
    """The rows of saved answers, with numbers where columns have them, all files after each other. Files are read and
    checked as by ``score``; rows without a design are left out."""
    given = [paths] if isinstance(paths, (str, Path)) else list(paths)
    rows = [dict(row) for row in _native._read_answers(given)]
    for row in rows:
        row["listener"] = int(row["listener"]) if row["listener"].isdecimal() else row["listener"]
    return rows


# ---- A/B/X


@dataclass(frozen=True)
class Sensitivity:
    """d' of a pair of kinds, with its exact interval; ``high`` is infinite if every answer was right."""

    pair: str
    right: int
    trials: int
    d_prime: float
    low: float
    high: float


def abx_proportion(d_prime: float, model: str = "differencing") -> float:
    """The proportion of right answers in A/B/X at ``d_prime``."""
    one, other = (d_prime / divisor for divisor in MODELS[model])
    return _normal(one) * _normal(other) + _normal(-one) * _normal(-other)


def abx_d_prime(proportion: float, model: str = "differencing") -> float:
    """The d' at which answers are right in ``proportion`` of trials: 0 at one half and below, infinite at 1."""
    if proportion <= 0.5:
        return 0.0
    if proportion >= 1.0:
        return math.inf
    return _root(lambda d_prime: abx_proportion(d_prime, model) - proportion, 0.0, 40.0)


def sensitivity(
    right: int, trials: int, *, pair: str = "all", model: str = "differencing", confidence: float = 0.95
) -> Sensitivity:
    """d' of so many right answers."""
    found, low, high = (
        abx_d_prime(share, model) for share in (right / trials, *proportion_interval(right, trials, confidence))
    )
    return Sensitivity(pair, right, trials, found, low, high)


def sensitivities(
    rows: Iterable[Row], *, model: str = "differencing", confidence: float = 0.95
) -> list[Sensitivity]:
    """d' of each pair of kinds of A/B/X, all listeners together. Give the rows of one listener for a listener's own: d'
    of pooled answers is smaller than the mean of listeners who differ."""
    counts: dict[str, list[int]] = {}
    for row in _of_design(rows, "abx"):
        counts.setdefault(row["pair"], []).append(row["correct"])
    return [
        sensitivity(sum(own), len(own), pair=pair, model=model, confidence=confidence) for pair, own in counts.items()
    ]


def proportion_interval(right: int, trials: int, confidence: float = 0.95) -> tuple[float, float]:
    """The exact interval of a proportion, after Clopper and Pearson."""
    tail = (1 - confidence) / 2
    all_counts = range(trials + 1)
    chosen = np.array([-math.lgamma(n + 1) - math.lgamma(trials - n + 1) for n in all_counts]) + math.lgamma(trials + 1)

    def at_least(least: int, share: float) -> float:
        counts = np.arange(least, trials + 1)
        terms = chosen[least:] + counts * math.log(share) + (trials - counts) * math.log1p(-share)
        return float(np.exp(terms).sum())

    def bound(least: int) -> float:
        return _root(lambda share: at_least(least, share) - tail, 1e-12, 1 - 1e-12)

    return (0.0 if right == 0 else bound(right)), (1.0 if right == trials else 1 - bound(trials - right))


# ---- Staircases


@dataclass
class Staircase:
    """Two right answers in a row make a step down a grid of strengths, and one wrong answer makes a step up, as on the
    page (Levitt, "Transformed up-down methods in psychoacoustics", 1971)."""

    strengths: Sequence[float]
    reversals_at_end: int = 12
    coarse_reversals: int = 2
    averaged_reversals: int = 8
    step: int = field(init=False)
    reversals: list[float] = field(init=False, default_factory=list)
    _run: int = field(init=False, default=0)
    _down: bool | None = field(init=False, default=None)

    def __post_init__(self) -> None:
        self.step = len(self.strengths) - 1

    @property
    def strength(self) -> float:
        """The strength of the next trial."""
        return self.strengths[self.step]

    @property
    def done(self) -> bool:
        """True after the last reversal."""
        return len(self.reversals) >= self.reversals_at_end

    def answer(self, right: bool) -> bool:
        """Takes an answer; returns true at a reversal."""
        self._run = self._run + 1 if right else 0
        if right and self._run < 2:
            return False
        is_reversal = self._down is not None and self._down != right
        if is_reversal:
            self.reversals.append(self.strength)
        self._run, self._down = 0, right
        size = 2 if len(self.reversals) < self.coarse_reversals else 1
        self.step = min(max(self.step + (-size if right else size), 0), len(self.strengths) - 1)
        return is_reversal

    def threshold(self) -> float:
        """The geometric mean of the last reversals; NaN of too few."""
        if len(self.reversals) < self.coarse_reversals + self.averaged_reversals:
            return math.nan
        return float(np.exp(np.mean(np.log(self.reversals[-self.averaged_reversals :]))))


@dataclass(frozen=True)
class Threshold:
    """The strength of a part at which a listener is right in 70.7 % of trials; NaN of too few reversals. ``at_end``
    says that a reversal stands at an end of the grid, so that the threshold may lie beyond it."""

    listener: Any
    part: str
    threshold: float
    unit: str
    trials: int
    reversals: int
    at_end: bool


def thresholds(rows: Iterable[Row]) -> list[Threshold]:
    """The thresholds of each listener and part. The answers are followed once more, and rows that no staircase has
    asked for are refused."""
    tracks: dict[tuple[Any, ...], list[Row]] = {}
    for row in _of_design(rows, "staircase"):
        tracks.setdefault((row["page"], row["listener"], row["part"]), []).append(row)
    found = []
    for (_, listener, part), own in tracks.items():
        own.sort(key=lambda row: row["trial"])
        for row in own:
            if not 1 <= row["step"] <= MOST_STEPS:
                raise ValueError(
                    f"trial {row['trial']} of listener {listener} is at step {row['step']}, and steps are 1 to "
                    f"{MOST_STEPS}; give the file as the page saved it"
                )
        strength_of = {row["step"] - 1: row["strength"] for row in own}
        # The first trial is at the greatest strength; strengths that were not asked for do not matter.
        stairs = Staircase([strength_of.get(step, math.nan) for step in range(own[0]["step"])])
        for row in own:
            asked = stairs.step
            if row["step"] - 1 != asked or stairs.answer(bool(row["correct"])) != bool(row["reversal"]):
                raise ValueError(
                    f"trial {row['trial']} of listener {listener} is at step {row['step']}, and the answers before "
                    f"lead to step {asked + 1}; give the file as the page saved it"
                )
        last = stairs.reversals[-stairs.averaged_reversals :]
        at_end = any(value in (stairs.strengths[0], stairs.strengths[-1]) for value in last)
        value, count = stairs.threshold(), len(stairs.reversals)
        found.append(Threshold(listener, part, value, own[0]["unit"], len(own), count, at_end))
    return found


# ---- Ratings


@dataclass(frozen=True)
class Rating:
    """The rating of a pair of kinds: its estimated mean, and how far that is from the reference's, with an interval."""

    pair: str
    mean: float
    difference: float
    low: float
    high: float


def ratings(rows: Iterable[Row], *, reference: str | None = None, confidence: float = 0.95) -> list[Rating]:
    """A linear mixed model of ratings: a fixed effect of each pair, and normal effects of each listener and of each
    listener on each pair, by restricted maximum likelihood. Differences are to ``reference``, by default two excerpts
    of one recording, which is the best that a texture can reach. Intervals are Student's with one degree of freedom
    fewer than listeners. Takes statsmodels: ``pip install statsmodels``."""
    import pandas  # type: ignore
    import scipy.stats  # type: ignore
    import statsmodels.formula.api  # type: ignore

    table = pandas.DataFrame(_of_design(rows, "similarity"))
    pairs = list(dict.fromkeys(table["pair"]))
    if reference is None:
        reference = "recording-recording" if "recording-recording" in pairs else pairs[-1]
    listeners = table["listener"].nunique()
    if listeners < 2:
        raise ValueError("a mixed model takes two listeners or more; give all their files together")
    names = [reference] + [pair for pair in pairs if pair != reference]
    with warnings.catch_warnings():
        # A variance that is estimated as 0 lies on a border, where statsmodels warns of its own standard errors. They
        # are not taken.
        warnings.simplefilter("ignore")
        found = statsmodels.formula.api.mixedlm(
            f"rating ~ C(pair, levels={names})",
            table,
            groups="listener",
            re_formula="1",
            vc_formula={"pair": "0 + C(pair)"},
        ).fit(method=["lbfgs", "powell"])
    estimates = np.asarray(found.fe_params)
    # The covariance of generalised least squares at the variances that were found.
    of_listener, of_pair = float(found.cov_re.iloc[0, 0]), float(found.vcomp[0])
    information = np.zeros((len(names), len(names)))
    for _, own in table.groupby("listener"):
        is_of = np.array([own["pair"] == pair for pair in names], dtype=float).T
        design = np.column_stack([np.ones(len(own)), is_of[:, 1:]])
        covariance = of_listener + of_pair * is_of @ is_of.T + float(found.scale) * np.eye(len(own))
        information += design.T @ np.linalg.solve(covariance, design)
    errors = np.sqrt(np.diag(np.linalg.inv(information)))
    quantile = scipy.stats.t.ppf((1 + confidence) / 2, listeners - 1)
    effects = [Rating(reference, float(estimates[0]), 0.0, 0.0, 0.0)]
    for pair, by, error in zip(names[1:], estimates[1:], errors[1:]):
        margin = quantile * error
        effects.append(Rating(pair, float(estimates[0] + by), float(by), float(by - margin), float(by + margin)))
    return effects


# ---- Simulated listeners


def simulated_abx(
    d_prime: float, trials: int, generator: np.random.Generator, model: str = "differencing"
) -> np.ndarray:
    """Which of so many trials a simulated listener answers right: what A, B and X make felt is normal with a deviation
    of 1, and ``d_prime`` lies between the means of both kinds. No formula for proportions is used."""
    a_is_other, x_is_other = generator.random((2, trials)) < 0.5
    a, b, x = generator.normal(d_prime * np.array([a_is_other, ~a_is_other, x_is_other]))
    if model == "differencing":
        is_like_a = abs(x - a) < abs(x - b)
    else:
        is_like_a = (x - d_prime / 2) * (a - b) > 0
    return is_like_a == (x_is_other == a_is_other)


def simulated_staircase(
    d_prime_of: Callable[[float], float], strengths: Sequence[float], generator: np.random.Generator, trials: int = 80
) -> list[Row]:
    """The rows of a simulated listener who has ``d_prime_of(strength)``."""
    stairs = Staircase(strengths)
    rows: list[Row] = []
    while not stairs.done and len(rows) < trials:
        step, strength = stairs.step, stairs.strength
        right = bool(simulated_abx(d_prime_of(strength), 1, generator)[0])
        rows.append(
            {
                "design": "staircase", "listener": 1, "trial": len(rows) + 1, "part": "level", "step": step + 1,
                "strength": strength, "unit": "dB", "correct": int(right), "reversal": int(stairs.answer(right)),
                "page": "simulated",
            }  # fmt: skip
        )
    return rows


def simulated_ratings(
    means: dict[str, float],
    listeners: int,
    blocks: int,
    generator: np.random.Generator,
    *,
    of_listener: float = 8.0,
    of_pair: float = 5.0,
    of_trial: float = 10.0,
) -> list[Row]:
    """The rows of simulated listeners who rate pairs about ``means``, with these deviations between listeners, between
    a listener's pairs, and between trials. Ratings are not rounded and not held between 0 and 100."""
    rows: list[Row] = []
    for listener in range(1, listeners + 1):
        own = generator.normal(0, of_listener)
        of_pairs = {pair: mean + own + generator.normal(0, of_pair) for pair, mean in means.items()}
        for block in range(1, blocks + 1):
            for pair, mean in of_pairs.items():
                rating = generator.normal(mean, of_trial)
                rows.append(
                    {"design": "similarity", "listener": listener, "block": block, "pair": pair, "rating": rating}
                )
    return rows


def _of_design(rows: Iterable[Row], design: str) -> list[Row]:
    own = [row for row in rows if row["design"] == design]
    if not own:
        raise ValueError(f"there are no answers of `stylus compare --design {design}`")
    return own


def _normal(value: float) -> float:
    return 0.5 * math.erfc(-value / math.sqrt(2))


def _root(rising: Callable[[float], float], low: float, high: float) -> float:
    for _ in range(80):
        middle = (low + high) / 2
        if rising(middle) < 0:
            low = middle
        else:
            high = middle
    return (low + high) / 2
