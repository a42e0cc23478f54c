"""The first page of a report: at most five sentences and one table, made from the values of verdicts, never from what a command printed."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from toolbox.drilling.answer_results import HEADS, Answers
from toolbox.files.printing import table
from toolbox.files.unit_systems import reading
from toolbox.measuring.judge import NOT_DECIDED
from toolbox.modelling.numbers_in_words import given_as
from toolbox.scenes.judged import judged_measures
from toolbox.scenes.scene import Scene
from toolbox.scenes.verdict_table import Row, begun_otherwise, situation_of

STOP, RUN, END = "stop without groan", "run without stick-slip", "end stick-slip"
"""Aims of controllers, of which the first two are those of studies."""
ALL, SOME, NONE = "all", "some", "none"
"""How many of the controllers succeed."""


@dataclass(frozen=True)
class Outcome:
    """The runs of one controller in one case. held: how many come to smooth running;  runs: how many there are;  words: the verdict on a single run."""

    held: int
    runs: int
    words: str = ""

    @property
    def cell(self) -> str:
        """The outcome in a table."""
        return self.words or (f"{self.held} of {self.runs}" if self.runs else "-")

    @property
    def why(self) -> str:
        """The outcome as a reason in a sentence."""
        return self.words or f"{self.runs - self.held} of {self.runs} runs fail"


@dataclass(frozen=True)
class Price:
    """A column of prices: its name and unit, {controller: value in this unit}, and whether a sentence tells it."""

    name: str
    unit: str
    values: Mapping[str, float]
    main: bool = False

    @property
    def head(self) -> str:
        """The head of the column."""
        return self.name if self.unit == "1" else f"{self.name} [{self.unit}]"

    def told(self, labels: Sequence[str], named: bool = True) -> str:
        """The range of the values of some controllers, in words; empty if none has a value. named: whether the controllers are named."""
        known = {label: self.values[label] for label in labels if math.isfinite(self.values.get(label, math.nan))}
        if not known:
            return ""
        low, high = min(known, key=known.__getitem__), max(known, key=known.__getitem__)
        unit = "" if self.unit == "1" else f" {self.unit}"
        if f"{known[low]:.4g}" == f"{known[high]:.4g}":
            return f"{known[low]:.4g}{unit}"
        if not named:
            return f"{known[low]:.4g} to {known[high]:.4g}{unit}"
        return f"{known[low]:.4g}{unit} (`{low}`) to {known[high]:.4g}{unit} (`{high}`)"


@dataclass(frozen=True)
class Findings:
    """Verdicts on the controllers of one scene, as values.

    Attributes
    ----------
    title
        The scene.
    aim
        The aim of the controllers, as a verb with its object in the plural: `STOP`, `RUN` or `END`.
    situation
        The situation for which the verdicts hold, as the end of a sentence.
    cases
        {head of a column: {controller: its outcome}}.
    prices
        Further columns.
    sure
        How sure the verdicts are, in a sentence.
    advice
        {`ALL`, `SOME` or `NONE` of the controllers succeed: what to try next, in a sentence}.
    """

    title: str
    aim: str
    situation: str
    cases: Mapping[str, Mapping[str, Outcome]]
    prices: tuple[Price, ...]
    sure: str
    advice: Mapping[str, str]

    @property
    def labels(self) -> list[str]:
        """Labels of the controllers, in order."""
        return list(dict.fromkeys(label for outcomes in self.cases.values() for label in outcomes))

    def lost(self, label: str) -> list[str]:
        """Return the cases in which a controller fails, each with the verdict."""
        failed = {head: of[label] for head, of in self.cases.items() if label in of and of[label].held < of[label].runs}
        return [each.why if len(self.cases) == 1 else f"{head}: {each.why}" for head, each in failed.items()]


# --- findings of results


def of_study(scene: Scene, rows: Sequence[Row]) -> Findings:
    """The findings of a study: one run of every controller."""
    plant, units = scene.plant(), scene.display_units
    effort = reading(plant.unit(scene.effort), units)
    stop = scene.standstill_speed is not None
    outcomes = {row.controller: _outcome(row) for row in rows}
    prices = []
    for name in dict.fromkeys(name for row in rows for name in row.more):
        measures = judged_measures(name, scene[scene.labels[0]], 0.0, scene.duration) if stop or name in STOPPING else {}
        read = reading(measures[name].unit_in(plant) if name in measures else "1", units)
        stands = [row for row in rows if name == STOPPING[0] or not (stop and row.settling == math.inf)]  # the rest of a stop has no end
        values = {row.controller: row.more.get(name, math.nan) * read.factor for row in stands}
        prices.append(Price(name, read.unit, values, main=name in STOPPING))
    if not stop:
        prices += [
            Price("overshoot", "%", {row.controller: 100.0 * row.overshoot for row in rows if row.settling != math.inf}, main=True),
            Price("settling", "s", {row.controller: row.settling for row in rows}),
        ]
    prices.append(Price(f"peak of {scene.effort}", effort.unit, {row.controller: row.peak * effort.factor for row in rows}, main=not stop))
    error = max((row.error for row in rows if math.isfinite(row.error)), default=math.nan)
    accurate = "" if math.isnan(error) else f", with a numerical error of at most {error:.0e}"
    return Findings(
        scene.title, STOP if stop else RUN, _situation(scene, rows), {"verdict": outcomes}, tuple(prices),
        f"one run of each controller with the numbers of the scene{accurate}; no number was varied.", _advice(scene, rows),
    )  # fmt: skip


def _outcome(row: Row) -> Outcome:
    """The outcome of a run; it counts as no run if the verdict says neither that it is smooth nor that it is not."""
    verdict = row.verdict
    unknown = verdict.regime == NOT_DECIDED and verdict.tone == "fair" and not verdict.failed
    return Outcome(int(not verdict.failed and not unknown), int(not unknown), verdict)


STOPPING = ("distance", "jerk")
"""Metrics of a stop that are its price."""


def _situation(scene: Scene, rows: Sequence[Row]) -> str:
    held = situation_of(scene, rows)
    read = reading(scene.plant().unit(scene.signal), scene.display_units)
    start = [
        f"`{name}` = {given_as(value, scene.plant().signal_unit(name), scene.display_units) or value}"
        for name, value in scene.start.items()
    ]
    begun = begun_otherwise(rows) or " and ".join(start) or "rest"
    words = [held.plants, f"started from {begun}"]
    if scene.reference:
        words.append(f"set-point {scene.reference * read.factor:.4g}{read.tail}")
    if scene.standstill_speed is not None:
        words.append(f"judged until standstill ({scene.standstill_speed * read.factor:.4g}{read.tail})")
    return ", ".join([*words, f"with {held.surroundings}", held.design, f"for {held.duration}"])


def _advice(scene: Scene, rows: Sequence[Row]) -> dict[str, str]:
    if scene.standstill_speed is None:
        other = "`stickslip answer` for the same scene: takeover of existing stick-slip, connections and a number that is off."
        none = "`stickslip answer --range` for the same scene: the lowest set-point from which on a controller succeeds."
        return {ALL: other, SOME: other, NONE: none}
    rolling = [row.controller for row in rows if row.settling == math.inf]
    if rolling:
        return dict.fromkeys(
            (ALL, SOME, NONE), f"a longer `duration`, because {_names(rolling)} did not stand within {scene.duration:g} s."
        )
    other = "the same stops with friction 20 % lower and higher, under [parameters] of the scene, and one report of all folders."
    return {ALL: other, SOME: other, NONE: "a controller with a `margin` below the border of groan, or a lower deceleration."}


def of_answers(found: Answers) -> Findings:
    """The findings of a table of answers: several starts of every controller."""
    read, speed, torque = (reading(unit, found.display_units) for unit in (found.unit, "rad/s", "N m"))
    cases = {
        head: {label: Outcome(count.held, count.runs) for label, each in found.results.items() for count in (each.starts[name],)}
        for name, head in HEADS.items()
    }
    cases["one number off"] = {label: Outcome(each.errors.held, each.errors.runs) for label, each in found.results.items()}
    every = found.results.items()
    lowest = {
        label: float(np.max([*each.lowest.values()])) * read.factor for label, each in every if each.lowest
    }  # nan if one start has none
    prices = [Price("lowest set-point for all starts", read.unit, lowest, main=True)] if lowest else []
    prices += [
        Price("period of own stick-slip", "s", {label: each.own_period for label, each in every}),
        Price("top peak", speed.unit, {label: each.top_peak * speed.factor for label, each in every}, main=not lowest),
        Price("bit peak", speed.unit, {label: each.bit_peak * speed.factor for label, each in every}),
        Price("torque peak", torque.unit, {label: each.torque_peak * torque.factor for label, each in every}, main=True),
        Price("torque of its limit", "%", {label: 100.0 * each.torque_peak / each.torque_limit for label, each in every}),
    ]
    counts = [sum(outcomes[label].runs for outcomes in cases.values() if label in outcomes) for label in found.results]
    off = max((each.errors.runs for each in found.results.values()), default=0)
    number_off = f", {off} of them with one number of the plant off" if off else "; no number of the plant was off"
    turned = f"at a set-point of {found.nominal_value * read.factor:.4g}{read.tail}"
    further = "`stickslip answer --range`, which also finds the lowest set-point for each start." if not lowest else (
        "`stickslip chance` with all uncertain numbers at once, at the set-point that is chosen."
    )  # fmt: skip
    where = "from the starts in the heads of the columns; the line `Holds for` below names plant, design, surroundings and duration"
    return Findings(
        found.title, END, f"{found.title} {turned}, {where}", cases, tuple(prices),
        f"{_span(counts)} runs of each controller{number_off}.",
        {ALL: further, SOME: further, NONE: "a higher set-point, which `stickslip answer --range` finds for each start."},
    )  # fmt: skip


# --- the page


def first_page(findings: Sequence[Findings]) -> tuple[list[str], str]:
    """(sentences, table in HTML) of the findings of a report; nothing if there are none. Several studies of one kind are cases of one table."""
    if not findings:
        return [], ""
    found = together(findings)
    ended = [label for label in found.labels if not found.lost(label) and any(of[label].runs for of in found.cases.values() if label in of)]
    others = [label for label in found.labels if label not in ended]
    prices = [
        (price.name, price.told(ended or others), price.told(others, named=False) if ended else "") for price in found.prices if price.main
    ]
    costs = [f"{name} {told}" + (f", others {beside}" if beside else "") for name, told, beside in prices if told]
    sentences = [
        _who(found, ended, others),
        f"This holds for {found.situation}.",
        f"Price: {'; '.join(costs)}." if costs else "",
        f"How sure: {found.sure}",
        f"To try next: {found.advice[NONE if not ended else SOME if others else ALL]}",
    ]
    counted = ": how many runs come to smooth running, and the price" if found.aim == END else ""
    heads = ("controller", *found.cases, *(price.head for price in found.prices))
    rows = []
    for label in found.labels:
        cells = [outcomes[label].cell if label in outcomes else "-" for outcomes in found.cases.values()]
        rows.append((label, *cells, *(_cell(price.values.get(label, math.nan)) for price in found.prices)))
    return [sentence for sentence in sentences if sentence], table(f"Every controller at a glance{counted}", heads, rows)


def together(findings: Sequence[Findings]) -> Findings:
    """Findings as one: those with several starts if there are some, else all studies of one kind, each as a case, with their highest prices."""
    first = next((each for each in findings if len(each.cases) > 1), findings[0])
    same = [each for each in findings if each.aim == first.aim and len(each.cases) == 1] if len(first.cases) == 1 else [first]
    if len(same) == 1:
        return first
    heads = _heads([each.title for each in same])
    cases = {head: next(iter(each.cases.values())) for head, each in zip(heads, same, strict=True)}
    prices = []
    for name, unit, main in dict.fromkeys((price.name, price.unit, price.main) for each in same for price in each.prices):
        every = [price.values for each in same for price in each.prices if (price.name, price.unit) == (name, unit)]
        labels = dict.fromkeys(label for values in every for label in values)
        highest = {label: max((v[label] for v in every if not math.isnan(v.get(label, math.nan))), default=math.nan) for label in labels}
        prices.append(Price(f"highest {name}", unit, highest, main))
    varied = (
        {
            SOME: "a smaller `margin`, or a `car_jerk`, for controllers that groan in some of the cases.",
            ALL: "numbers that are the same in all cases.",
        }
        if first.aim == STOP
        else {}
    )
    return Findings(
        first.title, first.aim, f"the {len(same)} cases in the heads of the columns; each section below gives its situation", cases, tuple(prices),
        f"one run of each controller in each of the {len(same)} cases.", {**first.advice, **varied},
    )  # fmt: skip


def _heads(titles: Sequence[str]) -> list[str]:
    """Different titles of cases, without the words after a colon or comma with which all of them end."""
    columns = zip(*(title[::-1] for title in titles), strict=False)
    same = "".join(column[0] for column in itertools.takewhile(lambda column: len(set(column)) == 1, columns))[::-1]
    cut = max((len(same) - place for place in (same.find(": "), same.find(", ")) if place >= 0), default=0)
    short = [title[: len(title) - cut] for title in titles]
    return [title if short.count(title) == 1 else f"{title} ({k})" for k, title in enumerate(short, 1)]


def _who(found: Findings, ended: Sequence[str], others: Sequence[str]) -> str:
    """Which controllers end stick-slip, and in which cases the others do not."""
    verb, rest = found.aim.split(" ", 1)
    everywhere = " in every case" if len(found.cases) > 1 else ""
    reasons: dict[str, list[str]] = {}
    for label in others:
        lost = found.lost(label)
        judged = sum(label in of for of in found.cases.values())
        why = (
            "in no case"
            if 1 < len(lost) == judged
            else f"not in {len(lost)} of {judged} cases ({'; '.join(lost)})"
            if judged > 1
            else "; ".join(lost)
        )
        reasons.setdefault(why or "not judged", []).append(label)
    if not ended:
        return f"No controller {verb}s {rest}{everywhere} ({'; '.join(f'{_names(labels)}: {why}' for why, labels in reasons.items())})."
    words = f"{_names(ended)} {verb}{'s' * (len(ended) == 1)} {rest}{everywhere}"
    if everywhere:
        return f"{'; '.join([words, *(f'{_names(labels)} {why}' for why, labels in reasons.items())])}."
    return f"{'; '.join([words, *(f'{_names(of)} {DO[len(of) > 1]} not ({why})' for why, of in reasons.items())])}."


DO = {False: "does", True: "do"}
"""The verb after one name and after several."""


def _names(labels: Iterable[str]) -> str:
    told = [f"`{label}`" for label in labels]
    return told[0] if len(told) == 1 else f"{', '.join(told[:-1])} and {told[-1]}"


def _span(counts: Sequence[int]) -> str:
    low, high = min(counts, default=0), max(counts, default=0)
    return f"{low}" if low == high else f"{low} to {high}"


def _cell(value: float) -> str:
    return "-" if math.isnan(value) else "never" if math.isinf(value) else f"{value:.4g}"
