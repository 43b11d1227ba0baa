"""The diagnosis: calibrate, locate, select what explains the difference, and say what was found and how surely."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from functools import partial

from cobot_joint.diagnosis import thresholds
from cobot_joint.diagnosis.anchored.answer import diagnosis as anchored_diagnosis
from cobot_joint.diagnosis.anchored.follow import can_follow, follow, motion_is_given, where_it_lies
from cobot_joint.diagnosis.anchored.free_runs import beside_listed, in_free_runs
from cobot_joint.diagnosis.anchored.search import Search, confidence
from cobot_joint.diagnosis.budget import Budget
from cobot_joint.diagnosis.candidates.scan_ranges import driven
from cobot_joint.diagnosis.candidates.score_test import Scan
from cobot_joint.diagnosis.data.campaign import Campaign
from cobot_joint.diagnosis.estimation.calibrate import calibrate, told, watched
from cobot_joint.diagnosis.estimation.fit import Fit
from cobot_joint.diagnosis.estimation.problem import Problem, one_blas_thread
from cobot_joint.diagnosis.experiments.discriminate import advise
from cobot_joint.diagnosis.explanation import Explanation, answer, sure_beside_background, units_of
from cobot_joint.diagnosis.findings import Diagnosis
from cobot_joint.diagnosis.localization.isolability import prefetch
from cobot_joint.diagnosis.localization.localize import locate_difference
from cobot_joint.diagnosis.plant.fmu_plant import FmuPlant
from cobot_joint.diagnosis.plant.plant import Plant, TermCandidate
from cobot_joint.diagnosis.selection.elimination import prune, worth_naming
from cobot_joint.diagnosis.selection.external_loads import look_for_external_loads, look_for_unlogged_load
from cobot_joint.diagnosis.selection.misreading import Misread, look_for_misreading
from cobot_joint.diagnosis.selection.mistimed import look_for_mistiming
from cobot_joint.diagnosis.selection.outside import Outside, look_outside
from cobot_joint.diagnosis.selection.selection import Selected, Selection
from cobot_joint.diagnosis.selection.some_recordings import some_of
from cobot_joint.diagnosis.selection.stepwise import Selector
from cobot_joint.diagnosis.selection.unlisted.held_against import look_beside, look_for_unmodelled
from cobot_joint.diagnosis.selection.unlisted.remains import remains
from cobot_joint.diagnosis.selection.unlisted.together import look_together
from cobot_joint.diagnosis.selection.unlisted.unmodelled import Unmodelled
from cobot_joint.diagnosis.store import Store
from cobot_joint.errors import UserError, among

Progress = Callable[[str], None]


def diagnose(
    campaign: Campaign, *, progress: Progress | None = None, store: Store | None = None, budget: Budget | None = None
) -> Diagnosis:
    """What the recordings with role "train" say of the campaign's system. Held-out recordings are not looked at.

    progress: called with what is being done, in words. store: stages finished by an earlier call are taken from it.
    budget: None looks at everything.
    """
    systems = campaign.systems()
    with FmuPlant(systems) as plant:
        found = diagnose_plant(campaign, plant, progress=progress, store=store, budget=budget)
        found.crashes = [str(crash) for crash in plant.crashes.values()]
        return found


def diagnose_plant(
    campaign: Campaign,
    plant: Plant,
    *,
    progress: Progress | None = None,
    store: Store | None = None,
    budget: Budget | None = None,
) -> Diagnosis:
    """`diagnose` with any simulator."""
    say, store = progress or (lambda words: None), store or Store(None)
    with one_blas_thread():
        return _diagnosed(campaign, plant, say, store, budget or Budget())


def _diagnosed(campaign: Campaign, plant: Plant, say: Progress, store: Store, budget: Budget) -> Diagnosis:
    begun = time.monotonic()
    prefetch()
    problem, calibrated = calibrate(campaign, plant, say, store)
    problem.budget, say = budget, watched(problem, say)
    say("locating the difference")
    located = store.remember("located", calibrated.x, lambda: locate_difference(problem, calibrated).to_json())
    found, explanation = explain(campaign, problem, calibrated, say, store)
    found.located = located
    if explanation.calibrated is not calibrated:  # a better one came up on the way
        again = explanation.calibrated
        found.located = store.remember("located", again.x, lambda: locate_difference(problem, again).to_json())
    if found.findings and budget.allows("the experiment that would tell more"):
        say("looking for the experiment that would tell more")
        basis = [f.term for f in found.findings], explanation.fit.x
        found.advice = store.remember("experiment", basis, lambda: advise(problem, found.findings, explanation.fit))
    found.left_out = budget.left_out
    if found.left_out:  # what was not looked at may explain it better: no name is a claim yet
        found.findings = [replace(f, confidence=min(f.confidence, thresholds.WITHHELD)) for f in found.findings]
        found.verdict = "undecided" if found.verdict == "nothing_missing" else found.verdict
    found.seconds = time.monotonic() - begun
    return found


def explain(
    campaign: Campaign, problem: Problem, calibrated: Fit, say: Progress, store: Store
) -> tuple[Diagnosis, Explanation]:
    """What is missing, without where it shows in the recordings and what would tell more."""

    def select() -> Explanation:
        return _select(campaign, problem, calibrated, say, store)

    # what time cut short is no result to go on from; its finished rounds are kept
    explanation = select() if problem.budget.limited else store.remember("selection", _basis(campaign), select)
    say("writing down what was found")
    if explanation.anchored is not None and not explanation.selected:
        found = anchored_diagnosis(explanation.anchored, units_of(problem))
        return in_free_runs(
            problem, found, explanation.anchored, explanation.calibrated, units_of(problem)
        ), explanation
    return answer(problem, explanation), explanation


def identify(campaign: Campaign, plant: Plant) -> Diagnosis:
    """`diagnose_plant` without where the difference lies and what would tell more: enough for counting."""
    store, say = Store(None), (lambda words: None)
    with one_blas_thread():
        problem, calibrated = calibrate(campaign, plant, say, store)
        return explain(campaign, problem, calibrated, say, store)[0]


def _basis(campaign: Campaign) -> tuple[object, ...]:
    return (*told(campaign), *campaign.terms)


def _select(campaign: Campaign, problem: Problem, calibrated: Fit, say: Progress, store: Store) -> Explanation:
    """With `terms` in the campaign: these, and nothing beyond them. Else channels first, then all, listed or not."""
    only = campaign.terms
    scan = Scan(problem, driven(problem, calibrated, _terms(problem, only)), say)
    if only:
        return _selected(campaign, problem, calibrated, scan, say, store)
    say("asking the channels for gains, offsets and delays")
    asked = partial(store.remember, "misread", _basis(campaign), lambda: _misread(problem, calibrated))
    misread = problem.budget.spend("gains, offsets and delays of channels", asked)
    if misread and misread.explains(problem) and not misread.rivalled(problem, calibrated, scan):
        return _channel_or_parameter(problem, Selection([calibrated]), misread, say)
    found = _selected(campaign, problem, calibrated, scan, say, store)
    if misread and misread.beats(problem, found.fit):
        return _channel_or_parameter(problem, found.selection.up_to(0), misread, say)
    is_formula = found.unmodelled is not None and found.unmodelled.may_be_a_data_sheet
    along = found.anchored and (found.anchored.claims or not problem.stands_out(found.calibrated.residual))
    if (found.unmodelled and not is_formula) or along or (found.background and not found.selected):
        return found
    select = Selector(problem, scan, say).select
    listed = (found.selection.fit, found.selection.selected) if is_formula else (found.fit, found.selected)
    outside = problem.budget.spend(
        "parameters outside their tolerances",
        lambda: look_outside(problem, found.calibrated, *listed, select, say),
    )
    if outside is None or (found.unmodelled and _stands_before(problem, found.unmodelled, outside)):
        return found
    as_good = misread if misread and misread.as_good(problem, found.calibrated, outside.gain) else None
    beside = problem.budget.spend("formulas", lambda: look_beside(problem, outside.selection, say))
    fit = beside.fit if beside else outside.fit
    explained = Explanation(found.calibrated, fit, outside.selection, outside.selection.selected, beside)
    return replace(explained, outside=outside, misread=as_good)


def _stands_before(problem: Problem, formula: Unmodelled, outside: Outside) -> bool:
    """Whether a formula is the answer, not a parameter outside its tolerance: it leaves so much less, or less, and the
    parameter is no claim."""
    if formula.outdoes(problem, outside.fit):
        return True
    left, rest = remains(problem, outside.fit, formula.fit)
    return formula.is_likely and left > formula.freedom * rest and outside.confidence(problem) < thresholds.EVEN


def _channel_or_parameter(problem: Problem, nothing: Selection, misread: Misread, say: Progress) -> Explanation:
    """A channel that is misread, and the base parameter that would do as well outside its tolerance, if there is one: a
    brake's torque per ampere is a gain of its current. nothing: the base model, and what was looked at beside it."""
    calibrated = nothing.fit
    channel = Explanation(calibrated, calibrated, nothing, [], misread=misread)
    outside = problem.budget.spend(
        "parameters outside their tolerances",
        lambda: look_outside(problem, calibrated, calibrated, [], lambda fit: Selection([fit]), say),
    )
    if outside is None or outside.gain < calibrated.cost - misread.fit.cost - misread.slack(problem):
        return channel
    return replace(channel, fit=outside.fit, outside=outside)


def _misread(problem: Problem, calibrated: Fit) -> Misread | None:
    """A channel's gain and offset, or its stamps; of many recordings some are asked first."""

    def look(at: Problem, fit: Fit) -> Misread | None:
        return look_for_misreading(at, fit) or look_for_mistiming(at, fit)

    some, there = some_of(problem, calibrated)
    return look(problem, calibrated) if some is problem or look(some, there) else None


def _selected(
    campaign: Campaign, problem: Problem, calibrated: Fit, scan: Scan, say: Progress, store: Store
) -> Explanation:
    """What is missing in the machine, its channels taken as they are."""
    only, spend = campaign.terms, problem.budget.spend
    beside = Selector(problem, scan, say)

    def unlogged() -> Unmodelled | None:
        return look_for_unlogged_load(problem, calibrated, beside.select, say, beside.predicted_share)

    if not only and (load := spend("a load that is not logged", unlogged)):
        nothing = Selection([calibrated], indistinguishable=dict(scan.indistinguishable))
        return Explanation(calibrated, load.fit, nothing, load.selected, load)
    given = motion_is_given(campaign) and not problem.is_table
    listed = Selector(problem, scan, say, store, given).select(calibrated, _basis(campaign))
    calibrated = listed.history[0]  # that of before, or a better one that came up on the way
    if only:
        kept = worth_naming(problem, calibrated, listed)
        return Explanation(calibrated, kept.fit, listed, kept.selected)
    if loads := spend("external loads", lambda: look_for_external_loads(problem, listed, beside.select, say)):
        return _term_in_place(problem, listed, loads, beside) or Explanation(
            calibrated, loads.fit, listed, loads.selected, loads
        )
    return _beyond_the_list(campaign, problem, listed, beside, say, store)


def _term_in_place(problem: Problem, listed: Selection, loads: Unmodelled, selector: Selector) -> Explanation | None:
    """A listed term that sets in where a step offset does and leaves as little: the offset was its first jump."""
    if loads.finding.onset is None:
        return None
    start = listed.up_to(len(loads.selected))
    found = selector.setting_in(start.fit, loads.finding.onset)
    if found is None or found.cost > loads.fit.cost + thresholds.ALIKE:
        return None
    added = Selected(found.hypothesis.terms[-1].name, start.fit.cost - found.cost)
    selection = replace(start, history=[*start.history, found], selected=[*start.selected, added])
    return Explanation(listed.history[0], found, selection, selection.selected)


def _beyond_the_list(
    campaign: Campaign, problem: Problem, listed: Selection, beside: Selector, say: Progress, store: Store
) -> Explanation:
    """What listed terms leave: to a formula that leaves nothing, to a formula and a listed term together, to the
    recorded motion, to a formula, or to nothing.

    Where terms that take most leave what stands out, the recorded motion is asked for others beside them. Beside a
    background a formula has to be predicted to take as much as listed terms take, and most of it. Where motion
    is an input, free runs lose nothing: the listed term that does best there is said to come nearest, and the recorded
    motion says where the rest lies.
    """
    calibrated = listed.history[0]
    left, before = problem.excess(listed.fit.residual), problem.excess(calibrated.residual)
    follows, given = can_follow(campaign, problem.plant), motion_is_given(campaign)
    takes_most, much = _takes_most(problem, listed), _much_is_left(problem, listed)
    background = takes_most or follows
    doubtful = listed.imitates or problem.stands_out(listed.fit.residual)
    least = max(thresholds.ALONE, 0.0 if doubtful else 1 - left / max(before, 1e-9)) if background else 0.0
    spend = problem.budget.spend
    formula = partial(look_for_unmodelled, problem, calibrated, listed, say, least)
    unmodelled = spend("formulas", formula) if much else None
    rival, unmodelled = (unmodelled, None) if unmodelled and unmodelled.as_good else (None, unmodelled)
    if unmodelled and (not background or _leaves_nothing(problem, unmodelled)):
        return Explanation(calibrated, unmodelled.fit, listed, unmodelled.selected, unmodelled)
    outdone = unmodelled is not None and unmodelled.is_likely and unmodelled.outdoes(problem, listed.fit)
    # In free runs the angle that a listed term goes by is lost; a formula along the recorded motion has it.
    over_angle = unmodelled is not None and unmodelled.is_likely and unmodelled.is_wave
    lost = outdone and over_angle
    free = not given and not problem.is_table and not (over_angle and follows)
    if much and free and _stands_out_still(problem, listed, unmodelled):
        together = partial(look_together, problem, listed, unmodelled, beside, say)
        pair = spend("a listed term and a formula", together)
        if pair and not (pair.is_wave and follows):
            return Explanation(calibrated, pair.fit, listed, pair.selected, pair)
        if pair:
            unmodelled, outdone, lost = pair, True, True
    stands = listed.selected if left < thresholds.REMAINDER * before else []
    settled = outdone and not lost and not stands  # whatever the motion says
    asked = much and follows and not given and not settled
    along = partial(_followed, campaign, problem, listed, say, store)
    found = spend("the recorded motion", along) if asked and (lost or doubtful or not takes_most) else None
    gives_way = lost or not unmodelled  # a formula, to what the motion says
    if found and takes_most and gives_way and (both := beside_listed(problem, listed, found)):
        return Explanation(calibrated, both[0], listed, both[1], anchored=found, rival=rival)
    found = found if lost or not takes_most else None
    stay = {s.term for s in unmodelled.selected} if unmodelled else set[str]()  # with a formula, or without
    heard = [s.term for s in (stands if takes_most else stands[:1]) if s.term not in stay]
    if found and any(map(found.supports, heard)):
        return Explanation(calibrated, listed.fit, listed, stands, anchored=found, rival=rival)
    claimed = _claims_others(found, stay) if found else takes_most
    if unmodelled and unmodelled.is_likely and ((outdone and not (found and lost)) or not claimed):
        return Explanation(calibrated, unmodelled.fit, listed, unmodelled.selected, unmodelled)
    if found and (found.named or not stands):
        return Explanation(calibrated, listed.fit, listed, [], anchored=found)
    proven = worth_naming(problem, calibrated, listed) if problem.is_table else listed  # in time, by parts left out
    kept = proven if given else prune(problem, listed)
    some = replace(campaign, recordings=some_of(problem, calibrated)[0].recordings)
    lies = partial(where_it_lies, some, problem.plant, kept.fit.run, say)
    rest = spend("where the rest lies", lies) if given and much and follows and not takes_most else None
    return Explanation(calibrated, kept.fit, listed, kept.selected, background=rest or [], rival=rival)


def _stands_out_still(problem: Problem, listed: Selection, formula: Unmodelled | None) -> bool:
    """Whether listed terms leave more than those that stand do, and what stands out, and a formula does, too: neither
    may show what it is without the other."""
    left, before = (problem.excess(fit.residual) for fit in (listed.fit, listed.history[0]))
    fits = [listed.fit] if formula is None or not formula.is_likely else [listed.fit, formula.fit]
    return left > thresholds.TERMS_STAND * before and all(problem.stands_out(fit.residual) for fit in fits)


def _claims_others(found: Search, stay: Collection[str]) -> bool:
    """Whether the recorded motion claims a term other than these."""
    others = [n for n in found.named if not {n.name, *n.alike} & set(stay)]
    return found.claims and (not stay or any(confidence(n) >= thresholds.EVEN for n in others))


def _followed(campaign: Campaign, problem: Problem, listed: Selection, say: Progress, store: Store) -> Search | None:
    """What the recorded motion says."""
    in_runs, start = [c.term for ranked in listed.ranking[:1] for c in ranked], listed.history[0].run.values

    def on_the_way(words: str) -> None:
        problem.budget.check()
        say(words)

    along = partial(follow, campaign, problem.plant, on_the_way, in_runs, start)
    return store.remember("anchored", (_basis(campaign), start), along)


def _much_is_left(problem: Problem, listed: Selection) -> bool:
    """Whether listed terms leave more than noise does: several hardly do, unless together they imitate something."""
    left = listed.fit.residual
    several = len(listed.selected) > 1 and (listed.imitates or problem.unexplained(left))
    much = problem.excess(left) > thresholds.CLEARLY_LEFT * problem.excess_scatter
    return several or much or problem.stands_out(left)


def _takes_most(problem: Problem, listed: Selection) -> bool:
    """Whether a listed term takes so much that, though more than noise is left, it is more likely right than not."""
    return max(sure_beside_background(problem, listed).values(), default=0.0) >= thresholds.EVEN


def _leaves_nothing(problem: Problem, unmodelled: Unmodelled) -> bool:
    """Whether a formula leaves no background, which a formula follows as well as an effect."""
    return problem.excess(unmodelled.fit.residual) < thresholds.UNDECIDED * problem.excess_scatter


def _terms(problem: Problem, only: Sequence[str]) -> list[TermCandidate]:
    """The plant's, or those of them that a campaign lists. UserError: it lists one that is not there."""
    known = [term.name for term in problem.plant.terms]
    if unknown := [name for name in only if name not in known]:
        raise UserError(f"terms: {unknown[0]!r} is given, the system has {among(known)}")
    if only:
        return [term for term in problem.plant.terms if term.name in only]
    return [term for term in problem.plant.terms if not (problem.is_table and _remembers(term))]


def _remembers(term: TermCandidate) -> bool:
    """Whether a time or a way is among its shapes: the rows of a table follow one another in no time that counts."""
    return any(shape.unit in ("s", "rad", "m") and not shape.whole for shape in term.shapes)
