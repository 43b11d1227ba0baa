"""What of a formula goes by an angle, and what does not."""

from __future__ import annotations

from dataclasses import replace

from cobot_joint.diagnosis.anchored.search import Search
from cobot_joint.diagnosis.estimation.effects import PortSignal
from cobot_joint.diagnosis.estimation.fit import Fit
from cobot_joint.diagnosis.estimation.least_squares import fit
from cobot_joint.diagnosis.estimation.problem import Problem
from cobot_joint.diagnosis.findings import Feature
from cobot_joint.diagnosis.selection.competition import finished
from cobot_joint.diagnosis.selection.unlisted.unmodelled import Unmodelled

SAME = 0.01  # share by which two orders may differ and be one: an angle is followed over tens of turns
WAVES = ("sin", "cos")


def without_waves(found: Unmodelled) -> Unmodelled | None:
    """The formula without what goes by an angle; None: nothing is left of it."""
    shape = found.finding.shape
    assert shape is not None
    rest = tuple(f for f in shape.features if not any(factor.function in WAVES for factor in f.form.factors))
    if not rest:
        return None
    return replace(found, finding=replace(found.finding, shape=replace(shape, features=rest)))


def wave_alone(problem: Problem, found: Unmodelled, order: float) -> Fit | None:
    """The fit with nothing of the formula but its wave of that order, all else re-fitted; None: it has none, or that
    cannot be simulated. It goes by the recorded motion, as the formula does."""
    shape = found.finding.shape
    own = {str(f.form) for f in shape.features if _is_wave(f, order)} if shape is not None else set()
    at = found.fit.settled()
    whole = next((e for e in at.hypothesis.effects if isinstance(e, PortSignal)), None)
    if not own or whole is None:
        return None
    some = [k for k, form in enumerate(whole.forms) if form in own]
    forms, features = tuple(whole.forms[k] for k in some), tuple(whole.features[k] for k in some)
    wave = PortSignal(whole.port, forms, features, tuple(whole.coefficients[k] for k in some))
    less = replace(at.hypothesis, effects=tuple(wave if e is whole else e for e in at.hypothesis.effects))
    left = {c.names[0] for c in less.coordinates}
    kept = [k for k, c in enumerate(at.hypothesis.coordinates) if c.names[0] in left]
    return fit(problem, less, at.x[kept], at.jacobian[:, kept], finished(1))


def repeats(formula: Unmodelled, found: Search) -> bool:
    """Whether it is a wave that the motion has named, in the phase that free runs have lost: orders of that unit alone,
    and nothing else."""
    shape, unit = formula.finding.shape, f"{formula.finding.component}."
    orders = [v.value for name, v in found.repaired.items() if name.startswith(unit) and name.endswith(".n")]
    features = shape.features if shape is not None else ()
    return bool(features) and all(any(_is_wave(f, order) for order in orders) for f in features)


def _is_wave(feature: Feature, order: float) -> bool:
    """Whether it is a sine or cosine, as large at any speed and load."""
    (factor, *more) = feature.form.factors or (None,)
    return not more and factor is not None and factor.function in WAVES and abs(factor.p - order) < SAME * order
