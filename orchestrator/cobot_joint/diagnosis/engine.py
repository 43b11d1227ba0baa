"""The diagnosis: calibrate, locate, select what explains the difference, and say what was found and how surely."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from cobot_joint.diagnosis import thresholds
from cobot_joint.diagnosis.anchored.answer import diagnosis as anchored_diagnosis
from cobot_joint.diagnosis.anchored.follow import can_follow, motion_is_given
from cobot_joint.diagnosis.anchored.free_runs import in_free_runs, predicts_better, spoils
from cobot_joint.diagnosis.budget import Budget
from cobot_joint.diagnosis.candidates.scan import Scan
from cobot_joint.diagnosis.candidates.scan_ranges import driven
from cobot_joint.diagnosis.data.campaign import Campaign
from cobot_joint.diagnosis.estimation.calibrate import basis, calibrate, watched
from cobot_joint.diagnosis.estimation.fit import Fit
from cobot_joint.diagnosis.estimation.problem import Problem, Run, one_blas_thread
from cobot_joint.diagnosis.experiments.discriminate import advise
from cobot_joint.diagnosis.explanation.beyond_the_list import BeyondTheList
from cobot_joint.diagnosis.explanation.explanation import Explanation, answer, units_of
from cobot_joint.diagnosis.explanation.waves import by_recorded_angle
from cobot_joint.diagnosis.findings import Diagnosis, Verdict
from cobot_joint.diagnosis.localization.localize import locate_difference
from cobot_joint.diagnosis.plant.fmu_plant import FmuPlant
from cobot_joint.diagnosis.plant.plant import Plant, TermCandidate
from cobot_joint.diagnosis.selection.elimination import worth_naming
from cobot_joint.diagnosis.selection.external_loads import (
    look_for_external_loads,
    look_for_onset,
    look_for_unlogged_load,
    term_in_place,
)
from cobot_joint.diagnosis.selection.misreading import Misread, look_for_misreading
from cobot_joint.diagnosis.selection.mistimed import held_inputs, look_for_mistiming, still_late
from cobot_joint.diagnosis.selection.selection import Selection
from cobot_joint.diagnosis.selection.some_recordings import some_of
from cobot_joint.diagnosis.selection.stepwise import Selector
from cobot_joint.diagnosis.selection.tolerances.outside import (
    Outside,
    Select,
    beside_load,
    in_place_of,
    let_go,
    look_outside,
    nearly_alone,
)
from cobot_joint.diagnosis.selection.unlisted.held_against import look_beside_parameter, within_reach
from cobot_joint.diagnosis.selection.unlisted.remains import remains
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
    with FmuPlant(systems, campaign.scan) as plant:
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
    problem, calibrated = calibrate(campaign, plant, say, store)
    problem.budget, say = budget, watched(problem, say)
    budget.keep = lambda name, look: store.remember(name, basis(campaign), look)
    with ThreadPoolExecutor(1) as beside:  # the search leaves a quarter of two cores idle
        say("locating the difference")
        located = beside.submit(_located, problem, calibrated, store)
        found, explanation = explain(campaign, problem, calibrated, say, store)
        found.located = located.result()
    if explanation.calibrated is not calibrated:  # a better one came up on the way
        found.located = _located(problem, explanation.calibrated, store)
    if found.findings and budget.allows("the experiment that would tell more"):
        say("looking for the experiment that would tell more")
        inputs = [f.term for f in found.findings], explanation.fit.x
        found.advice = store.remember("experiment", inputs, lambda: advise(problem, found.findings, explanation.fit))
    if explanation.misread is None:
        claims = any(f.confidence >= thresholds.EVEN for f in found.findings)  # what is none explains nothing away
        at = explanation.fit if claims else explanation.calibrated
        late = partial(still_late, problem, explanation.calibrated, at)
        found.mistimed = store.remember("mistimed", at.x, late)
        found.held = store.remember("held", at.x, partial(held_inputs, problem, at))
        stretches = problem.stretches(at.residual)
        found.strained = at.at_ends(stretches) if at.is_strained(stretches) else []
    if found.mistimed:  # a wrong name takes some of it: a claim waits for stamps that are right
        found.findings = [f.withheld("a channel's time stamps may be wrong") for f in found.findings]
    found.left_out = budget.left_out
    if found.left_out:  # what was not looked at may explain it better: no name is a claim yet
        found.findings = [f.withheld("time was up before everything was tried") for f in found.findings]
    found.verdict = verdict(found, drifts_visibly(problem))
    found.seconds = time.monotonic() - begun
    return found


def verdict(found: Diagnosis, drifts: bool = False) -> Verdict:
    """As it stands, but undecided where no finding is a claim, and where nothing was found though time was up before,
    or a position drifts off by what anyone would see: its drift was set aside, not explained."""
    nothing_claimed = found.findings and all(f.confidence < thresholds.EVEN for f in found.findings)
    not_all_of_it = (found.left_out or drifts) and found.verdict == "nothing_missing"
    return "undecided" if nothing_claimed or not_all_of_it else found.verdict


def drifts_visibly(problem: Problem) -> bool:
    """Whether a position is off by more than three times its noise (rms), however little its drift counts."""
    return any(off > thresholds.LEFT_SIGMA for off in problem.drifting.values())


def _located(problem: Problem, calibrated: Fit, store: Store) -> dict[str, Any]:
    """Where the difference lies, as a diagnosis keeps it."""
    return store.remember("located", calibrated.x, lambda: locate_difference(problem, calibrated).to_json())


def explain(
    campaign: Campaign, problem: Problem, calibrated: Fit, say: Progress, store: Store
) -> tuple[Diagnosis, Explanation]:
    """What is missing, without where it shows in the recordings and what would tell more."""
    select = partial(_select, campaign, problem, calibrated, say, store)
    explanation = problem.budget.kept("selection", select)
    say("writing down what was found")
    if explanation.anchored is not None and not explanation.selected:
        search, units = explanation.anchored, units_of(problem)
        along = anchored_diagnosis(search, units)
        predicts = partial(predicts_better, campaign)
        along = in_free_runs(problem, along, search, explanation.calibrated, units, predicts)
        if not (_takes_half(problem, explanation) and spoils(problem, along, search, explanation.calibrated)):
            return along, explanation
        found = answer(problem, replace(explanation, selected=explanation.selection.selected, anchored=None))
        found.findings = [f.withheld("the recorded motion names something else") for f in found.findings]
        return found, explanation
    return answer(problem, explanation), explanation


def _takes_half(problem: Problem, explanation: Explanation) -> bool:
    """Whether listed terms that were found take half of what is above noise in free runs."""
    listed, left = explanation.selection, (1 - thresholds.HOLDS) * problem.above(explanation.calibrated.residual)
    return bool(listed.selected) and problem.above(listed.fit.residual) < left


def identify(campaign: Campaign, plant: Plant) -> Diagnosis:
    """`diagnose_plant` without where the difference lies and what would tell more: enough for counting."""
    store, say = Store(None), (lambda words: None)
    with one_blas_thread():
        problem, calibrated = calibrate(campaign, plant, say, store)
        return explain(campaign, problem, calibrated, say, store)[0]


def _select(campaign: Campaign, problem: Problem, calibrated: Fit, say: Progress, store: Store) -> Explanation:
    """What explains the recordings, with the terms of other units that respond alike."""
    scan = Scan(problem, driven(problem, calibrated, _terms(problem, campaign.terms)), say)
    found = _searched(campaign, problem, calibrated, scan, say, store)
    return replace(found, selection=replace(found.selection, indistinguishable=dict(scan.indistinguishable)))


def _searched(
    campaign: Campaign, problem: Problem, calibrated: Fit, scan: Scan, say: Progress, store: Store
) -> Explanation:
    """With `terms` in the campaign: these, and nothing beyond them. Else channels first, then all, listed or not."""
    if campaign.terms:
        return _selected(campaign, problem, calibrated, scan, say, store)
    say("asking the channels for gains, offsets and delays")
    asked = partial(store.remember, "misread", basis(campaign), lambda: _misread(problem, calibrated))
    misread = problem.budget.spend("gains, offsets and delays of channels", asked)
    if misread and misread.explains(problem) and not misread.rivalled(problem, calibrated, scan):
        return _channel_or_parameter(problem, Selection([calibrated]), misread, say)
    found = _selected(campaign, problem, calibrated, scan, say, store)
    if misread and misread.beats(problem, found.fit):
        return _channel_or_parameter(problem, found.selection.up_to(0), misread, say)
    is_formula = found.unmodelled is not None and found.unmodelled.may_be_a_data_sheet
    select: Select = Selector(problem, scan, say).beside
    if beside := _beside_claimed(problem, found, select, say):
        return _or_misread(problem, beside, misread)
    visible = problem.stands_out(found.calibrated.residual) or drifts_visibly(problem)
    along = found.anchored and found.anchored.claims
    if along and visible and (instead := _far_off(problem, found, select, say)):
        return _or_misread(problem, instead, misread)
    if found.outside:
        return _or_misread(problem, found, misread)
    if (found.unmodelled and not is_formula) or along or (found.background and not found.selected):
        return found
    if is_formula and (instead := _parameter_in_place(problem, found, say)):
        return instead
    listed = (found.selection.fit, found.selection.selected) if is_formula else (found.fit, found.selected)
    if found.unmodelled and found.unmodelled.is_likely:
        select = within_reach(problem, found.unmodelled, select)
    outside = problem.budget.stage(
        "parameters outside their tolerances",
        lambda: look_outside(problem, found.calibrated, *listed, select, say),
    )
    if isinstance(outside, Selection):
        return _found_beside_it(problem, found, outside)
    if outside is None or (found.unmodelled and outside.gives_way(problem, found.unmodelled)):
        return found
    if (formula := found.gave_way) and _alone_explains(problem, found.calibrated, formula, outside):
        return Explanation(found.calibrated, formula.fit, found.selection, formula.selected, formula)
    return _or_misread(problem, _with_formula(problem, found.calibrated, outside, say), misread)


def _or_misread(problem: Problem, found: Explanation, misread: Misread | None) -> Explanation:
    """With the channel that, misread, does as well as the parameter outside its tolerance."""
    gain = found.outside.gain if found.outside else 0.0
    as_good = misread is not None and misread.as_good(problem, found.calibrated, gain)
    return replace(found, misread=misread) if as_good else found


def _with_formula(problem: Problem, calibrated: Fit, outside: Outside, say: Progress) -> Explanation:
    """A parameter outside its tolerance, and the formula that is missing beside it, if there is one."""
    beside = problem.budget.stage("formulas", lambda: look_beside_parameter(problem, outside.selection, say))
    both = outside.with_formula(problem, beside) if beside and not beside.as_good else None
    told = both or outside
    explained = Explanation(calibrated, told.fit, told.selection, told.selection.selected)
    rival = beside if beside and beside.as_good else None
    return replace(explained, outside=told, unmodelled=beside if both else None, rival=rival)


def _beside_claimed(problem: Problem, found: Explanation, select: Select, say: Progress) -> Explanation | None:
    """Where the recorded motion claims nothing but one parameter outside its tolerance, that one in free runs, which
    may show listed terms or a formula beside it (machines 53/23, 163/27). None: they take less than half with it."""
    search, calibrated = found.anchored, found.calibrated
    if search is None or not search.claims or found.selected or len(search.named) != 1:
        return None
    name, alike = search.named[0].name, search.named[0].alike
    if name not in problem.plant.parameters or name not in search.repaired:
        return None
    free = partial(let_go, problem, calibrated, {name: search.repaired[name].value}, alike, select)
    outside = problem.budget.stage("parameters outside their tolerances", free)
    if outside is None:
        return None
    beside = _with_formula(problem, calibrated, outside, say)
    enough = thresholds.HOLDS * problem.above(calibrated.residual)
    return beside if calibrated.cost - beside.fit.cost >= enough else None


def _far_off(problem: Problem, found: Explanation, select: Select, say: Progress) -> Explanation | None:
    """Where the recorded motion claims parameters and nothing else: one that free runs have far off, if it leaves less
    of them. Along the motion all are linear about values that are wrong: a gear of a quarter of its stiffness was a
    brake's inertia (machine 193/26). None: there is none."""
    search = found.anchored
    if search is None or not search.named or any(n.name not in problem.plant.parameters for n in search.named):
        return None
    (own,) = problem.simulate([Run({name: estimate.value for name, estimate in search.repaired.items()})])
    left = np.inf if own is None else float(np.sum((problem.recorded - own.white) ** 2))
    outside = problem.budget.stage(
        "parameters outside their tolerances",
        lambda: look_outside(problem, found.calibrated, found.calibrated, [], select, say),
    )
    if not isinstance(outside, Outside) or left - outside.fit.chi2 < problem.evidence:
        return None
    return _with_formula(problem, found.calibrated, outside, say)


def _parameter_in_place(problem: Problem, found: Explanation, say: Progress) -> Explanation | None:
    """The parameter that does as well as a formula, and the listed terms beside it; None: there is none."""
    calibrated, formula = found.calibrated, found.unmodelled
    assert formula is not None
    outside = problem.budget.stage(
        "parameters outside their tolerances", lambda: in_place_of(problem, calibrated, formula, say)
    )
    if outside is None:
        return None
    return Explanation(calibrated, outside.fit, outside.selection, outside.selection.selected, outside=outside)


def _found_beside_it(problem: Problem, found: Explanation, listed: Selection) -> Explanation:
    """Listed terms that were found beside a parameter; a formula that leaves less per feature than they do per term is
    said beside them, and one that leaves several times less stays the answer."""
    other = found.unmodelled or found.rival
    if other is not None and found.unmodelled is not None and other.outdoes(problem, listed.fit):
        return found
    left, rest = remains(problem, listed.fit, other.fit) if other is not None else (0.0, 0.0)
    less = other is not None and left * len(listed.selected) > rest * other.freedom
    rival = replace(other, as_good=True) if other is not None and less else None
    return Explanation(found.calibrated, listed.fit, listed, listed.selected, rival=rival)


def _alone_explains(problem: Problem, calibrated: Fit, formula: Unmodelled, outside: Outside) -> bool:
    """Whether a formula that gave way to listed terms leaves less, per feature, than the parameter and the terms that
    took their place, and nothing that stands out where these do: a brake's drag was its idle torque, 65 %, and a load
    (machine 199/40)."""
    if not problem.stands_out(outside.fit.residual) or problem.stands_out(formula.fit.residual):
        return False
    if outside.stands(problem, calibrated, formula):
        return False
    left, rest = remains(problem, outside.fit, formula.fit)
    return left * (1 + len(outside.selection.selected)) > formula.freedom * rest


def _channel_or_parameter(problem: Problem, nothing: Selection, misread: Misread, say: Progress) -> Explanation:
    """A channel that is misread, and the base parameter that would do as well outside its tolerance, if there is one: a
    brake's torque per ampere is a gain of its current. nothing: the base model, and what was looked at beside it."""
    calibrated = nothing.fit
    channel = Explanation(calibrated, calibrated, nothing, [], misread=misread)
    outside = problem.budget.stage(
        "parameters outside their tolerances",
        lambda: look_outside(problem, calibrated, calibrated, [], lambda fit: Selection([fit]), say),
    )
    if not isinstance(outside, Outside) or outside.gain < calibrated.cost - misread.fit.cost - misread.slack(problem):
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
    only, stage = campaign.terms, problem.budget.stage
    beside = Selector(problem, scan, say)

    def unlogged() -> Unmodelled | None:
        return look_for_unlogged_load(problem, calibrated, beside.select, say, beside.predicted_share)

    if not only and (load := stage("a load that is not logged", unlogged)):
        nothing = Selection([calibrated], indistinguishable=dict(scan.indistinguishable))
        return Explanation(calibrated, load.fit, nothing, load.selected, load)
    given = motion_is_given(campaign) and not problem.is_table
    listed = Selector(problem, scan, say, store, given).select(calibrated, basis(campaign))
    calibrated = listed.history[0]  # that of before, or a better one that came up on the way
    if only:
        kept = worth_naming(problem, calibrated, listed)
        return Explanation(calibrated, kept.fit, listed, kept.selected)
    if loads := stage("external loads", lambda: look_for_external_loads(problem, listed, beside.select, say)):
        if instead := term_in_place(problem, listed, loads, beside):
            return Explanation(calibrated, instead.fit, instead, instead.selected)
        return Explanation(calibrated, loads.fit, listed, loads.selected, loads)
    if not given and (late := stage("terms that set in", lambda: look_for_onset(problem, listed, beside, say))):
        listed = late

    def parameter() -> Outside | None:
        return nearly_alone(problem, listed, beside.beside, say) or beside_load(problem, listed, say)

    if outside := stage("parameters outside their tolerances", parameter):
        return _with_formula(problem, calibrated, outside, say)
    if can_follow(campaign, problem.plant) and not given:
        waves = partial(by_recorded_angle, problem, listed, beside, say)
        with_wave = stage("waves by the recorded angle", waves)
        listed = with_wave or listed
    return BeyondTheList(campaign, problem, listed, beside, say, store).explanation()


def _terms(problem: Problem, only: Sequence[str]) -> list[TermCandidate]:
    """The plant's, or those of them that a campaign lists. UserError: it lists one that is not there."""
    known = [term.name for term in problem.plant.terms]
    if unknown := [name for name in only if name not in known]:
        raise UserError(f"terms: {unknown[0]!r} is given, the system has {among(known)}")
    if only:
        return [term for term in problem.plant.terms if term.name in only]
    asked = [term for term in problem.plant.terms if not term.compensated]
    return [term for term in asked if not (problem.is_table and _remembers(term))]


def _remembers(term: TermCandidate) -> bool:
    """Whether a time or a way is among its shapes: the rows of a table follow one another in no time that counts."""
    return any(shape.unit in ("s", "rad", "m") and not shape.whole for shape in term.shapes)
