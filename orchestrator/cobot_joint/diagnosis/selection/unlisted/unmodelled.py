"""What no list names: the signal that is missing at an additive port, as a formula or a table of the unit's signals."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from cobot_joint.diagnosis import thresholds
from cobot_joint.diagnosis.candidates.tables import Table, look_for_table, over_any, over_motion
from cobot_joint.diagnosis.estimation.effects import PortSignal
from cobot_joint.diagnosis.estimation.fit import Fit
from cobot_joint.diagnosis.estimation.port_response import (
    Choice,
    indistinguishable_ports,
    refit,
)
from cobot_joint.diagnosis.estimation.problem import Problem
from cobot_joint.diagnosis.findings import Estimate, Feature, Finding, Form
from cobot_joint.diagnosis.localization.evidence import where_it_gains
from cobot_joint.diagnosis.plant.correction import Product
from cobot_joint.diagnosis.plant.plant import Port
from cobot_joint.diagnosis.selection.confidence import beside_background, confidence
from cobot_joint.diagnosis.selection.elimination import kept_beside, without
from cobot_joint.diagnosis.selection.selection import Selected
from cobot_joint.diagnosis.selection.stepwise import share
from cobot_joint.diagnosis.selection.unlisted.formula import joined
from cobot_joint.diagnosis.selection.unlisted.late_onset import look_late
from cobot_joint.diagnosis.selection.unlisted.places import Place, elsewhere, expected_to_leave, pointed_to
from cobot_joint.diagnosis.selection.unlisted.remains import remains

CLOSER = 3  # times that forms are chosen beside those found, where these leave what stands out

Say = Callable[[str], None]
Answer = Callable[..., "Unmodelled | None"]


@dataclass
class Unmodelled:
    """The finding, the fit with it, and the listed terms that stay beside it.

    taken: share of what its start leaves. as_good: it leaves less than the listed terms that it would replace, but not
    so much less that these are wrong. stood_out: whether what its start leaves stands out from the noise.
    """

    fit: Fit
    selected: list[Selected]
    finding: Finding
    taken: float
    as_good: bool = False
    stood_out: bool = False

    @property
    def is_formula(self) -> bool:
        """Rather than a table, an offset, or loads that come and go."""
        return self.finding.shape is not None and any(f.form.factors for f in self.finding.shape.features)

    @property
    def goes_by_signals(self) -> bool:
        """A formula or a table."""
        return self.is_formula or (self.finding.shape is not None and self.finding.shape.table is not None)

    @property
    def may_be_a_data_sheet(self) -> bool:
        """Whether it is held against parameters outside their tolerances: a formula, or a table beside listed terms."""
        return self.is_formula or (self.goes_by_signals and bool(self.selected))

    @property
    def is_wave(self) -> bool:
        """Whether it goes by an angle."""
        shape = self.finding.shape
        if shape is None:
            return False
        waves = {factor.function for f in shape.features for factor in f.form.factors}
        return bool(shape.period) or bool(waves & {"sin", "cos"})

    @property
    def is_likely(self) -> bool:
        """Whether it takes so much that a background is not what it follows. A table follows most of one: it takes all
        but that, or of what stands out three times (rms) as much as it leaves."""
        if self.is_formula:
            return self.taken > thresholds.ALONE
        times_more = self.taken > thresholds.LEFT_SIGMA**2 * (1 - self.taken)
        return self.taken > thresholds.ENOUGH or (self.stood_out and times_more)

    @property
    def freedom(self) -> int:
        """Features, or what a smooth table counts for."""
        assert self.finding.shape is not None
        return len(self.finding.shape.features) or thresholds.TABLE_FREEDOM

    def outdoes(self, problem: Problem, other: Fit) -> bool:
        """Whether it leaves so much less than another fit, per feature, term, or parameter that was let go, that its
        freedom does not account for it."""
        left, rest = remains(problem, other, self.fit)
        count = max(len(other.hypothesis.effects), 1)
        return left * count > thresholds.TIMES_LESS * self.freedom * rest


def acts_where(found: Unmodelled, terms: Fit, indistinguishable: Mapping[str, str]) -> bool:
    """Whether it does so at the unit of a term that is on, or at one where the same force does the same: then either
    may be a patch of the other. indistinguishable: term -> the one of another unit that it equals."""
    on = {effect.name for effect in terms.hypothesis.terms}
    twins = [twin for twin, leader in indistinguishable.items() if leader in on]
    units = {effect.component for effect in terms.hypothesis.effects} | {t.split(".")[0] for t in twins}
    return any(name.split(".")[0] in units for name in (found.finding.term, *found.finding.equivalent))


def look_at_ports(
    problem: Problem,
    start: Fit,
    selected: list[Selected],
    say: Say,
    least: float = 0.0,
    units: Collection[str] | None = None,
    needed: float = 0.0,
) -> Unmodelled | None:
    """The best port and form beside the terms of `start`; None: nothing takes HOLDS of what it leaves. least: share of
    what is above noise that the first forms at a port are predicted to take together, or nothing else than one of them
    that takes nearly all is an answer. units: whose ports are asked; None: every one's. needed: share below which an
    answer changes nothing: what all forms there are predicted to take less than is not fitted."""
    answer = partial(_answer, problem, start, selected)
    say("asking every port for forms")
    places = pointed_to(problem, start, least, units)
    if not places:
        return _over_motion(problem, start, answer, say, needed)
    found = _best(problem, start, places, answer)
    takes_all = found is not None and found.taken > thresholds.ENOUGH
    if not takes_all and places[0].points < least * problem.above(start.residual):
        return _over_motion(problem, start, answer, say, needed)
    near = [p for p in places[:2] if p.columns and p.points > thresholds.NEAR_PORT * places[0].points]
    for _ in range(CLOSER):
        if _settled(problem, start, places, found):
            break
        form = found.finding.shape if found is not None else None
        for place in near:
            here = found is not None and form is not None and form.port == place.port.name
            place.look_closer(problem, start, found.fit if found is not None and here else None)
        if not _promises(problem, start, expected_to_leave(problem, start, places), found, needed):
            break
        closer = _best(problem, start, places, answer)
        gain = found.finding.gain if found is not None else 0.0
        if closer is None or closer.finding.gain < gain:
            break
        little = found and closer.finding.gain - gain < thresholds.LEAST * problem.above(found.fit.residual)
        found = closer
        if little or not problem.stands_out(found.fit.residual):
            break
    found = _simpler(problem, start, near, answer, found)
    enough = thresholds.ALONE if least else thresholds.ENOUGH  # a background is followed from any onset on
    if problem.onsets and (found is None or found.taken < enough):
        say("forms that set in later")
        worth = max(needed, _much_more(found)) * problem.above(start.residual)
        tried = [each for p in near if (each := look_late(problem, start, p.columns, worth)) is not None]
        choice, onset = max(tried, key=lambda each: each[0].gain, default=(None, None))
        late = answer(choice, onset=onset) if choice else None
        found = late if late is not None and _much_better(late, found) else found
    if found is None or found.taken < (thresholds.ALONE if found.freedom == 1 else thresholds.ENOUGH):
        worth = max(_with_table(needed), _much_more(found) if found is not None else 0.0)
        table = look_for_table(problem, start, [p.port for p in near], say, over_any, worth)
        tabled = answer(table.choice, table=table) if table else None
        found = tabled if found is None or (tabled is not None and _much_better(tabled, found)) else found
    if found is not None:
        above = problem.above(start.residual)
        say(f"a signal at {found.finding.component} takes {share(found.finding.gain, above)} of what is above noise")
    return found


def _over_motion(problem: Problem, start: Fit, answer: Answer, say: Say, needed: float) -> Unmodelled | None:
    """A table over a unit's own speed or place, where a few forms fall short of what stands out: a resonance, or a nut
    that is worn on half of its way, is none of them."""
    if not problem.stands_out(start.residual):
        return None
    worth = max(_with_table(needed), thresholds.ALONE)
    table = look_for_table(problem, start, problem.plant.ports, say, over_motion, worth)
    return answer(table.choice, table=table) if table is not None else None


def _with_table(needed: float) -> float:
    """Share that a table has to take, which is as free as several features, where one of them has to take this."""
    return 1 - (1 - needed) / thresholds.TABLE_FREEDOM if needed else 0.0


def _much_more(found: Unmodelled | None) -> float:
    """Share that what has an onset, or is a table, has to take to be much better."""
    return 1 - (1 - found.taken if found is not None else 1.0) / thresholds.TIMES_LESS


def _promises(problem: Problem, start: Fit, leaves: float, found: Unmodelled | None, needed: float) -> bool:
    """Whether a choice that is expected to leave this chi-square above noise takes what is needed, and more than what
    was found does."""
    so_far = problem.above(found.fit.residual) if found is not None else np.inf
    return leaves <= (1 - needed) * problem.above(start.residual) and leaves < (1 - thresholds.LEAST) * so_far


def _settled(problem: Problem, start: Fit, places: Sequence[Place], found: Unmodelled | None) -> bool:
    """Whether a few forms are enough: by what the best of them leaves; by what the Jacobian expects if it cannot be
    fitted."""
    if found is not None:
        left = found.fit.residual
        most = found.taken > thresholds.ENOUGH and not problem.stands_out(left)
        return most or (found.freedom == 1 and not problem.unexplained(left))
    enough = thresholds.ENOUGH * max(problem.excess(start.residual), 1e-9)
    return any(p.choice is not None and p.choice.gain > enough for p in places)


def _best(problem: Problem, start: Fit, places: Sequence[Place], answer: Answer) -> Unmodelled | None:
    """That of the choice from which the Jacobian expects most. Where this leaves what stands out, of one that comes
    near, or of the same forms at another unit, if it leaves less: behind a gear that sticks, or in its gap, the
    Jacobian sees little of what a load does."""
    chosen = sorted(((p.choice.gain, -k, p) for k, p in enumerate(places) if p.choice), reverse=True)
    best: Unmodelled | None = None
    for gain, _, place in chosen[:2]:
        if best and (gain < thresholds.NEAR_PORT * chosen[0][0] or not problem.stands_out(best.fit.residual)):
            break
        best = _less(best, answer(place.choice, at=place.at))
    for port in problem.plant.ports:
        if best is None or not problem.stands_out(best.fit.residual):
            break
        choice = elsewhere(problem, start, chosen[0][2], port)
        best = _less(best, answer(choice)) if choice else best
    return best


def _simpler(
    problem: Problem, start: Fit, near: Sequence[Place], answer: Answer, found: Unmodelled | None
) -> Unmodelled | None:
    """With two features of one form as one, where that leaves as little."""
    forms = [f.form for f in found.finding.shape.features] if found and found.finding.shape else []
    place = next((p for p in near if p.choice and forms and [c.form for c in p.choice.columns] == forms), None)
    if found is None or place is None or place.choice is None:
        return found
    choice = joined(problem, place.at or start, place.dictionary, place.choice)
    one = answer(choice, at=place.at) if choice is not None else None
    slack = thresholds.ALIKE + thresholds.ALIKE_SHARE * max(problem.excess(found.fit.residual), 0.0)
    return one if one is not None and one.fit.cost < found.fit.cost + slack else found


def _less(a: Unmodelled | None, b: Unmodelled | None) -> Unmodelled | None:
    """The one that leaves less."""
    return min((x for x in (a, b) if x is not None), key=lambda found: found.fit.cost, default=None)


def _much_better(other: Unmodelled, than: Unmodelled | None) -> bool:
    """Whether it leaves TIMES_LESS of what is slow, and no more of all: an onset, or a table, is a freedom more."""
    more = than is None or other.finding.gain > than.finding.gain
    return more and other.taken > _much_more(than)


def _answer(
    problem: Problem,
    start: Fit,
    selected: list[Selected],
    choice: Choice,
    table: Table | None = None,
    onset: float | None = None,
    at: Fit | None = None,
) -> Unmodelled | None:
    """The choice with everything else re-fitted, from `at` or where the search began; None: it takes too little of what
    `start` leaves."""
    found = refit(problem, at or start, choice)
    if found is None:
        return None
    gained = start.cost - found.cost
    before, rest = remains(problem, start, found)
    taken = 1 - rest / max(before, 1e-9)
    if taken < thresholds.HOLDS or gained < problem.evidence:
        return None
    port, forms = choice.port, [c.form for c in choice.columns]
    form = _table_form(found, port, table, taken) if table else _formula(problem, found, port, forms, taken)
    alike = indistinguishable_ports(problem, start, choice, thresholds.COLLINEAR)
    equivalent = tuple(f"{c}.unlisted" for c in dict.fromkeys(p.component for p in alike))
    finding = Finding(f"{port.component}.unlisted", equivalent, 0.0, onset, {}, {}, 0.0, shape=form)
    weighed, out = _weighed(problem, start, found, finding), problem.stands_out(start.residual)
    return Unmodelled(found, selected, weighed, taken, stood_out=out)


def _weighed(problem: Problem, start: Fit, found: Fit, finding: Finding) -> Finding:
    """With what the fit takes from one without it, and how sure that makes it."""
    gained = start.cost - found.cost
    left, above = max(problem.excess(found.residual), 0.0), problem.above(found.residual)
    sure = confidence(gained, left, unlisted=True)
    if left > thresholds.CLEARLY_LEFT * problem.excess_scatter:
        sure = max(sure, beside_background(gained / (gained + above), unlisted=True))
    as_large = problem.unexplained(found.residual) and not problem.stands_out(start.residual)
    where = where_it_gains(problem, start.residual**2 - found.residual**2)
    weighed = replace(finding, confidence=sure, where=where, gain=gained)
    return weighed.withheld("a background may be as large") if as_large else weighed


def without_what_it_replaces(problem: Problem, found: Unmodelled) -> Unmodelled:
    """A formula without the listed terms that it makes needless: what they took as well."""
    shape = found.finding.shape
    if shape is None or not found.is_formula:
        return found
    fit, kept = kept_beside(problem, found.fit, found.selected)
    gone = len(kept) < len(found.selected)
    start = without(problem, fit, lambda effect: isinstance(effect, PortSignal)) if gone else None
    if start is None:
        return found
    port = next(p for p in problem.plant.ports if p.name == shape.port)
    before, rest = remains(problem, start, fit)
    taken = 1 - rest / max(before, 1e-9)
    form = _formula(problem, fit, port, [f.form for f in shape.features], taken)
    finding = _weighed(problem, start, fit, replace(found.finding, shape=form))
    return Unmodelled(fit, kept, finding, taken, stood_out=problem.stands_out(start.residual))


def _formula(problem: Problem, found: Fit, port: Port, forms: Sequence[Product], taken: float) -> Form:
    """The coefficients as they were re-fitted, their intervals with everything else free."""
    first, stretches = len(found.x) - len(forms), problem.stretches(found.residual)
    coordinates = found.hypothesis.coordinates
    features = tuple(
        Feature(form, Estimate(float(found.x[k] * coordinates[k].scale), port.unit, found.interval(k, stretches)))
        for k, form in enumerate(forms, first)
    )
    used = [s for s in port.signals if any(s.split(".", 1)[1] in f.form.signals for f in features)]
    return Form(port.name, port.unit, tuple(used), features, round(taken, 3))


def _table_form(found: Fit, port: Port, table: Table, taken: float) -> Form:
    argument, size = table.argument, float(found.x[-1])  # its shape is kept, its size was re-fitted
    used = tuple(s for s in port.signals if s.split(".", 1)[1] in argument.signals)
    return Form(
        port.name,
        port.unit,
        used,
        (),
        round(taken, 3),
        signal=argument.signal,
        table=(argument.knots, size * table.values),
        period=argument.period,
        direction=argument.direction,
    )
