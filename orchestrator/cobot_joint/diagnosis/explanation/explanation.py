"""What explains the recordings, and how a diagnosis says it: findings, how sure they are, and on what ground."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from cobot_joint.diagnosis import thresholds
from cobot_joint.diagnosis.anchored.search import Search
from cobot_joint.diagnosis.estimation.effects import ActiveTerm
from cobot_joint.diagnosis.estimation.fit import Fit
from cobot_joint.diagnosis.estimation.least_squares import sharpened
from cobot_joint.diagnosis.estimation.problem import Problem
from cobot_joint.diagnosis.estimation.projection import solve
from cobot_joint.diagnosis.findings import Diagnosis, Estimate, Finding, Ground, Verdict
from cobot_joint.diagnosis.localization.evidence import where_it_shows
from cobot_joint.diagnosis.plant.lost import lost
from cobot_joint.diagnosis.selection.confidence import BESIDE_MUCH, COUNTED_TERMS, beside_background, confidence
from cobot_joint.diagnosis.selection.misreading import Misread
from cobot_joint.diagnosis.selection.selection import Selected, Selection
from cobot_joint.diagnosis.selection.tolerances.outside import Outside
from cobot_joint.diagnosis.selection.unlisted.unmodelled import Unmodelled


@dataclass
class Explanation:
    """What explains the recordings: the base model alone, and with all that was selected."""

    calibrated: Fit
    fit: Fit
    selection: Selection
    selected: list[Selected]
    unmodelled: Unmodelled | None = None
    anchored: Search | None = None  # what the recorded motion says, where no model fits to the noise
    misread: Misread | None = None  # a channel whose log explains more than these, or as much as `outside`
    outside: Outside | None = None  # a base parameter beyond its tolerance that leaves no more than listed terms
    rival: Unmodelled | None = None  # a formula that leaves less than listed terms, yet does not prove them wrong
    gave_way: Unmodelled | None = None  # a likely formula that leaves less than listed terms, and was let go for them
    background: list[dict[str, object]] = field(default_factory=list)  # where the rest lies, if nothing has a name


def units_of(problem: Problem) -> dict[str, str]:
    """Parameters, amplitudes and shapes -> unit of measure"""
    plant = problem.plant
    units = {p.name: p.unit for p in plant.parameters.values()}
    return units | {t.amplitude: t.unit for t in plant.terms} | {s.name: s.unit for t in plant.terms for s in t.shapes}


def answer(problem: Problem, explanation: Explanation) -> Diagnosis:
    """What is said of it: verdict, findings by what they take, and parameters before and after with their intervals."""
    units, misread, before = units_of(problem), explanation.misread, explanation.calibrated
    fitted = explanation.fit.estimates(units, problem.stretches(explanation.fit.residual))  # as counted
    after = sharpened(problem, explanation.fit)
    repaired = after.estimates(units, problem.stretches(after.residual))
    refit = repaired if before is explanation.fit else before.estimates(units, problem.stretches(before.residual))
    left = max(problem.excess(explanation.fit.residual), 0.0)
    findings = [_finding(problem, explanation, selected, fitted, left) for selected in explanation.selected]
    others = [explanation.unmodelled.finding] if explanation.unmodelled else []
    others += [explanation.outside.finding(problem, before, fitted)] if explanation.outside else []
    findings += [replace(f, ground=_ground(problem, f, left)) for f in others]
    findings = [replace(f, parameters={n: repaired.get(n, e) for n, e in f.parameters.items()}) for f in findings]
    if explanation.rival:
        instead_of = {s.term for s in explanation.selection.selected} - {s.term for s in explanation.rival.selected}
        findings = [_beside(f, explanation.rival) if f.term in instead_of else f for f in findings]
    if problem.stands_out(explanation.fit.residual) and not problem.is_table:
        findings = [f.limited(BESIDE_MUCH, "what is left stands out from the noise") for f in findings]
        if lost(problem.recordings, before.simulated.outputs):
            why = "free runs of the re-fitted system go their own way, so that fits in them say little"
            findings = [f.withheld(why) for f in findings]
    if explanation.fit.is_strained(problem.stretches(explanation.fit.residual)):
        findings = [f.withheld("with it many parameters end at the ends of their tolerances") for f in findings]
    if explanation.anchored and not explanation.anchored.named:
        findings = [f.withheld("it does not show along the recorded motion") for f in findings]
    if misread:  # which of them it is, the recordings cannot say
        findings = [f.withheld("a channel that is misread would explain as much") for f in findings]
    findings = sorted((_together(f, findings) for f in findings), key=lambda f: -f.gain)
    return Diagnosis(
        verdict="undecided" if misread else _verdict(findings, left > thresholds.UNDECIDED * problem.excess_scatter),
        findings=findings,
        calibrated=refit,
        repaired=repaired,
        misreading=misread.told(problem) if misread else None,
        ranking=explanation.selection.ranking,
        background=explanation.background,
        structure={
            "calibrated": problem.excess(before.residual),
            "repaired": left,
            "scatter": problem.excess_scatter,
        },
    )


def _together(finding: Finding, all_of_them: Sequence[Finding]) -> Finding:
    """No claim where several terms of one unit are needed and the form of one ends at what it allows: together they
    imitate another."""
    beside = [f for f in all_of_them if f.component == finding.component]
    if len(beside) == 1 or not any(e.at for f in beside for e in f.parameters.values()):
        return finding
    return finding.withheld("several terms of one unit are needed, and one ends at a limit of its form")


def _beside(finding: Finding, rival: Unmodelled) -> Finding:
    """No claim: a formula in its place leaves less."""
    named = *finding.equivalent[: thresholds.MOST_NAMES - 2], rival.finding.term
    return replace(finding, equivalent=named).withheld("a formula that is on no list leaves less")


def _verdict(findings: Sequence[Finding], much_left: bool) -> Verdict:
    if any(f.shape for f in findings):
        return "unlisted"
    if findings:
        return "explained"
    return "undecided" if much_left else "nothing_missing"


def _sure(problem: Problem, explanation: Explanation, selected: Selected, left: float) -> tuple[float, Ground]:
    """Confidence in a listed term, and on what ground: by what is left, beside a background by the share that it took,
    or as the recorded motion says. What tens of rows leave is little in itself, so that of a table the share alone
    counts."""
    rows = problem.is_table and problem.unexplained(explanation.fit.residual)
    much = rows or left > thresholds.CLEARLY_LEFT * problem.excess_scatter
    beside = sure_beside_background(problem, _with_formula(explanation)).get(selected.term, 0.0) if much else 0.0
    along = explanation.anchored.supports(selected.term) if explanation.anchored else 0.0
    if problem.is_table:
        return beside if rows else max(confidence(selected.gain, left), beside, along), "table"
    grounds: list[tuple[float, Ground]] = [
        (confidence(selected.gain, left), "drawn machines"),
        (beside, "background"),
        (along, "recorded motion"),
    ]
    sure, ground = max(grounds, key=lambda each: each[0])
    return sure, ground if _is_counted(selected.term) else "term not counted"


def _is_counted(term: str) -> bool:
    return term.rsplit(".")[-1] in COUNTED_TERMS


def _with_formula(explanation: Explanation) -> Selection:
    """What was selected and a formula beside it, with what both leave."""
    formula, base = explanation.unmodelled, explanation.selection.history[0]
    if formula is None or not formula.goes_by_signals or not explanation.selected:
        return explanation.selection
    every = [*explanation.selected, Selected(formula.finding.term, formula.finding.gain)]
    return replace(explanation.selection, history=[base, explanation.fit], selected=every)


def _ground(problem: Problem, finding: Finding, left: float) -> Ground:
    """What stands behind its confidence."""
    if problem.is_table:
        return "table"
    if not finding.shape and not _is_counted(finding.term):
        return "term not counted"
    alone = confidence(finding.gain, left, unlisted=bool(finding.shape))
    return "drawn machines" if finding.confidence == alone else "background"


def _finding(
    problem: Problem, explanation: Explanation, selected: Selected, repaired: Mapping[str, Estimate], left: float
) -> Finding:
    """No claim where it is as large as it may be and leaves what stands out: a stiffness that gives way was a brake
    that fades altogether, 95 %, which left eighty sigma (machine 197/37). None either where its amplitude may be none:
    a term whose shape lies beyond all that was driven is a base parameter by another name, and neither is known."""
    on = {a.name: a for a in explanation.fit.hypothesis.terms}
    active = on[selected.term]
    equal = explanation.selection.indistinguishable  # term -> the one that it equals
    indistinguishable = [t for t, other in equal.items() if other == selected.term]
    indistinguishable += [equal[selected.term]] if selected.term in equal else []
    alike = sorted(selected.alike, key=selected.alike.__getitem__)
    both = [active, *(on[t] for t in indistinguishable if t in on)]
    sure, ground = _sure(problem, explanation, selected, left)
    size = repaired.get(active.term.amplitude)
    vague = size is not None and size.ci95 is not None and size.ci95[0] <= active.term.neutral <= size.ci95[1]
    if len(both) > 1 and vague:  # which unit has how much of it is not known; how much both have may be
        vague = explanation.fit.is_none([a.term.amplitude for a in both], problem.stretches(explanation.fit.residual))
    vague = vague and not _no_parameter_does(problem, explanation, both, selected.gain)
    as_large = all(repaired[a.term.amplitude].at for a in both if a.term.amplitude in repaired)
    short = size is not None and as_large and problem.stands_out(explanation.fit.residual)
    straight = _may_be_a_parameter(explanation.fit, active)
    found = Finding(
        term=selected.term,
        equivalent=tuple(dict.fromkeys([*indistinguishable, *alike]))[: thresholds.MOST_NAMES - 1],
        confidence=sure,
        onset=active.onset,
        parameters={name: repaired[name] for a in both for name in a.values if name in repaired},
        where=where_it_shows(problem, explanation.fit, active),
        gain=selected.gain,
        ground=ground,
    )
    found = found.withheld("its size may be none, by its interval") if vague else found
    if straight:
        words = "its curve bends beyond the speeds driven: a parameter of its unit that has no tolerance may be wrong"
        found = found.withheld(words)
    return found.withheld("it is as large as it may be, and that is not enough") if short else found


def _no_parameter_does(problem: Problem, explanation: Explanation, terms: Sequence[ActiveTerm], gain: float) -> bool:
    """Whether most of what terms take is left by all base parameters together, wherever their bounds are, in the linear
    terms of the calibrated fit. Where a term ends at what its form allows, those of the last fit mislead: a friction
    that is none in one direction differs there from no other."""
    at, base = explanation.fit, explanation.calibrated
    without = at.run.with_values({a.term.amplitude: a.term.neutral for a in terms})
    (other,) = problem.simulate([without])
    if other is None:
        return False
    does, J = at.simulated.white - other.white, base.jacobian
    rest = does - J @ solve(J.T @ J, J.T @ does)
    return float(rest @ rest) > thresholds.HOLDS * gain


def _may_be_a_parameter(fit: Fit, active: ActiveTerm) -> bool:
    """Whether, as fitted, it acts as a base parameter of its unit would, none of which may move: on a pendulum whose
    speed stays below 5 rad/s a Stribeck friction of 108 rad/s is dry friction."""
    values = next(a.values for a in fit.settled().hypothesis.terms if a.name == active.name)
    beyond = any(values[shape.name] > shape.reached for shape in active.term.shapes)
    return beyond and all(base.component != active.component for base in fit.hypothesis.base)


def sure_beside_background(problem: Problem, selection: Selection) -> dict[str, float]:
    """Term -> confidence by the share that it takes. What comes and goes at times of its own follows a background too,
    and must take as much as load pulses must."""
    episodes = {term.name for term in problem.plant.terms if term.episode}
    taken = selection.taken(problem).items()
    return {n: beside_background(x) for n, x in taken if n not in episodes or x > thresholds.LOADS_TAKE}
