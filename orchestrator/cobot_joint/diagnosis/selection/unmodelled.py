"""What no list names: the signal that is missing at an additive port, as a formula of the component's own signals."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cobot_joint.diagnosis.candidates.formulas import Dictionary
from cobot_joint.diagnosis.candidates.score_test import TWINS
from cobot_joint.diagnosis.candidates.tables import Table, look_for_table
from cobot_joint.diagnosis.estimation.fit import Fit
from cobot_joint.diagnosis.estimation.port_response import (
    Choice,
    Column,
    LeastSquares,
    equally_good,
    forward,
    refit,
    respond,
)
from cobot_joint.diagnosis.estimation.problem import Problem
from cobot_joint.diagnosis.findings import Estimate, Feature, Finding, Form
from cobot_joint.diagnosis.localization.evidence import locate_gain
from cobot_joint.diagnosis.plant.plant import Port
from cobot_joint.diagnosis.selection.confidence import confidence
from cobot_joint.diagnosis.selection.late_onset import look_late
from cobot_joint.diagnosis.selection.stepwise import EVIDENCE, Named, Naming

REMAINDER = (
    0.1  # of what was above noise before naming, left after it, from which on a list has not explained the recordings
)
STANDS = 0.15  # the same, up to which listed terms stand, though the form of one may be somewhat off
SEVERAL = 3.0  # times less, per feature, that a formula must leave in place of one listed term; a table than a formula
FLOOR = 0.02  # of what was above noise, below which leaving less proves nothing
HOLDS = 0.5  # of the remainder, that a form must take away to be an answer
WHOLE = 0.8  # the same, for a form that needs no listed term beside it
ENOUGH = 0.97  # the same, from which on no further forms are tried
TABLE = 4  # features that a smooth table counts for
NEAR = 0.5  # of the best port's gain, from which on a second one is looked at in full


@dataclass
class Unlisted:
    """The finding, the fit with it, and the listed terms that stay beside it."""

    fit: Fit
    named: list[Named]
    finding: Finding
    taken: float  # share of the slow structure


def look_for_unlisted(problem: Problem, calibrated: Fit, listed: Naming, say: Callable[[str], None]) -> Unlisted | None:
    """None: the list explains what there is, or no form at any port does better.

    First alone: a form that explains all of it makes listed terms patches. Else beside listed terms that do most of it.
    """
    before, left = problem.excess(calibrated.residual), problem.excess(listed.fit.residual)
    terms = len(listed.named)
    if left < 10 * problem.excess_scatter or (terms == 1 and left < REMAINDER * before):
        return None
    say("looking for what no list names, port by port")
    alone = _look(problem, calibrated, [], say)
    if terms and left < STANDS * before:
        return alone if alone is not None and _worth_more(problem, alone, before, left, terms) else None
    if alone is not None and (alone.taken > WHOLE or not terms):
        return alone
    beside = _look(problem, listed.fit, listed.named, say) if left < (1 - HOLDS) * before else None
    if beside is not None:
        return beside
    return alone if alone is not None and alone.finding.gain > calibrated.cost - listed.fit.cost else None


def _worth_more(problem: Problem, alone: Unlisted, before: float, left: float, terms: int) -> bool:
    """Whether it leaves so much less than the listed terms that its freedom does not account for it.

    A formula follows whatever the data show; one term whose form is somewhat off is still the right name, while several
    may be patches. What is left counts once per feature or term.
    """
    form = alone.finding.shape
    assert form is not None
    freedom = len(form.features) or TABLE
    rest = max(problem.excess(alone.fit.residual), problem.excess_scatter)
    if terms == 1:
        return left > SEVERAL * freedom * max(rest, FLOOR * before)
    return left * terms > rest * freedom


def _look(problem: Problem, start: Fit, named: list[Named], say: Callable[[str], None]) -> Unlisted | None:
    """The best port and form beside the terms of `start`; None: nothing takes HOLDS of what it leaves."""
    places = _places(problem, start)
    choices = [p.choice for p in places if p.choice is not None]
    best = max(choices, key=lambda choice: choice.gain, default=None)
    found = _answer(problem, start, named, best) if best else None
    if found is None or found.taken < ENOUGH:
        late = _late(problem, start, named, places, found.taken if found else 0.0, say)
        found = late or found
    if found is None or found.taken < WHOLE:
        near = [p.port for p in places[:2] if p.points > NEAR * places[0].points]
        table = look_for_table(problem, start, near, say)
        tabled = _answer(problem, start, named, table.choice, table) if table else None
        if found is None or (tabled is not None and 1 - tabled.taken < (1 - found.taken) / SEVERAL):
            found = tabled
    if found is not None:
        form, structure = found.finding.shape, start.chi2 - problem.samples
        assert form is not None
        say(f"{found.finding.term} at {form.port} takes {found.finding.gain:.0f} of {structure:.0f} above noise")
    return found


@dataclass
class Place:
    """A port: chi-square that its first forms take together, and the best formula there."""

    port: Port
    points: float
    columns: list[Column]
    choice: Choice | None


def _places(problem: Problem, start: Fit) -> list[Place]:
    """Those to which the residual points first: a few forms are tried at every port, all of them at the first ones."""
    structure, places = max(problem.excess(start.residual), 1e-9), []
    dictionaries = {}
    for port in problem.plant.ports:
        dictionary = dictionaries[port.name] = Dictionary(problem, start, port)
        if dictionary.locals:
            columns = respond(problem, start, port, dictionary.first(dictionary.waves(start.residual)))
            points = LeastSquares(start, columns).gain(range(len(columns)))[0]
            places.append(Place(port, points, columns, forward(problem, start, columns)))
    places = _without_twins(sorted(places, key=lambda place: -place.points))
    if any(p.choice is not None and p.choice.gain > ENOUGH * structure for p in places):
        return places
    for place in places[:2]:
        if place.points > NEAR * places[0].points:
            dictionary = dictionaries[place.port.name]
            rest = respond(problem, start, place.port, dictionary.more(dictionary.waves(start.residual)))
            place.choice = forward(problem, start, [*place.columns, *rest])
    return places


def _without_twins(places: Sequence[Place]) -> list[Place]:
    """Of ports where the same signal does the same, the first."""
    kept: list[Place] = []
    for place in places:
        if not any(p.port.unit == place.port.unit and _alike(p.columns, place.columns) for p in kept):
            kept.append(place)
    return kept


def _alike(a: Sequence[Column], b: Sequence[Column]) -> bool:
    """Whether a constant added at either port does the same to the residual."""
    (u,), (v,) = ([c.vector for c in columns if c.form == "1"] for columns in (a, b))
    return bool(abs(u @ v) > TWINS * np.linalg.norm(u) * np.linalg.norm(v))


def _late(
    problem: Problem, start: Fit, named: list[Named], places: Sequence[Place], taken: float, say: Callable[[str], None]
) -> Unlisted | None:
    """A form that sets in during the runs and leaves SEVERAL times less than one that was always there."""
    say("forms that set in later")
    near = [p for p in places[:2] if p.columns and p.points > NEAR * places[0].points]
    tried = [late for p in near if (late := look_late(problem, start, p.columns)) is not None]
    if not tried:
        return None
    choice, onset = max(tried, key=lambda late: late[0].gain)
    found = _answer(problem, start, named, choice, onset=onset)
    return found if found is not None and 1 - found.taken < (1 - taken) / SEVERAL else None


def _answer(
    problem: Problem,
    start: Fit,
    named: list[Named],
    choice: Choice,
    table: Table | None = None,
    onset: float | None = None,
) -> Unlisted | None:
    """The choice with everything else re-fitted; None: it does not hold."""
    found = refit(problem, start, choice)
    if found is None:
        return None
    gained, structure = start.cost - found.cost, problem.excess(start.residual)
    taken = (structure - problem.excess(found.residual)) / max(structure, 1e-9)
    if taken < HOLDS or gained < EVIDENCE:
        return None
    form = _table_form(choice.port, table, taken) if table else _formula(choice, taken)
    alike = equally_good(problem, start, choice)
    finding = replace(_finding(problem, start, found, form, choice.port, alike, gained), onset=onset)
    return Unlisted(found, named, finding, taken)


def _formula(choice: Choice, taken: float) -> Form:
    port, vectors = choice.port, np.column_stack([c.vector for c in choice.columns])
    sigma = np.sqrt(np.diag(np.linalg.pinv(vectors.T @ vectors)))
    features = tuple(
        Feature(c.form, Estimate(float(k), port.unit, (float(k - 1.96 * s), float(k + 1.96 * s))))
        for c, k, s in zip(choice.columns, choice.coefficients, sigma, strict=True)
    )
    formula = " + ".join(f"{f.coefficient.value:.4g}*{f.form}" for f in features).replace("+ -", "- ")
    used = tuple(s for s in port.signals if any(_mentions(f.form, s.split(".", 1)[1]) for f in features))
    return Form(port.name, port.unit, used, formula, features, round(taken, 3))


def _table_form(port: Port, table: Table, taken: float) -> Form:
    argument = table.argument
    used = tuple(
        s
        for s in port.signals
        if s.split(".", 1)[1] == argument.signal or _mentions(argument.factor, s.split(".", 1)[1])
    )
    return Form(
        port.name,
        port.unit,
        used,
        None,
        (),
        round(taken, 3),
        signal=argument.signal,
        table=(argument.knots, table.values),
        period=argument.period,
        factor=argument.factor,
    )


def _finding(
    problem: Problem, start: Fit, found: Fit, form: Form, port: Port, alike: list[Port], gained: float
) -> Finding:
    where, words = locate_gain(problem, start.residual**2 - found.residual**2)
    return Finding(
        term=f"{port.component}.unlisted",
        equivalent=tuple(f"{c}.unlisted" for c in dict.fromkeys(p.component for p in alike)),
        confidence=confidence(gained, max(problem.excess(found.residual), 0.0), unlisted=True),
        onset=None,
        parameters={},
        where=where,
        gain=gained,
        shape=form,
        words=f"no listed term explains it; at {port.name} it is {_said(form)}; {words}",
    )


def _said(form: Form) -> str:
    if form.formula:
        return form.formula
    return f"a table over {form.signal}" + (f", times {form.factor}" if form.factor else "")


def _mentions(form: str, name: str) -> bool:
    return re.search(rf"(?<![\w.]){re.escape(name)}(?!\w)", form) is not None
