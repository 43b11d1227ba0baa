"""The base model re-fitted inside its tolerances, before anything is added to it."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cobot_joint.cosim.clock import SLIGHT
from cobot_joint.diagnosis.data.campaign import Campaign
from cobot_joint.diagnosis.data.quantity import is_position
from cobot_joint.diagnosis.data.recording import Recording, condition
from cobot_joint.diagnosis.estimation.fit import Fit
from cobot_joint.diagnosis.estimation.hypothesis import Hypothesis, tolerances
from cobot_joint.diagnosis.estimation.least_squares import Precision, fit
from cobot_joint.diagnosis.estimation.multiscale import out_of_local_minimum
from cobot_joint.diagnosis.estimation.noise import Noise
from cobot_joint.diagnosis.estimation.problem import STRETCHES, Problem, Run, Simulated, Vector
from cobot_joint.diagnosis.plant.knots import on_fewer_knots
from cobot_joint.diagnosis.plant.plant import Plant, SimulationError
from cobot_joint.diagnosis.store import Store

SETTLED = 0.02  # of what is above noise, that a re-fit may leave to its next step
KNOTS = (2, 4, 8, 16, 32, 64, 128)  # samples from one to the next
UNFELT = 0.1  # of what a term must take, that a coarser simulation may change,
UNSEEN = 1e-5  # or of what the base model leaves: a three-hundredth of its amplitude
BY_CHANCE = 3.0  # sigma, up to which a simulation may come closer so
CALIBRATION = Precision(settled=10.0, roughly=SETTLED, jacobians=8)
Progress = Callable[[str], None]


def calibrate(campaign: Campaign, plant: Plant, say: Progress, store: Store) -> tuple[Problem, Fit]:
    """The problem, and the base model re-fitted inside its tolerances with nothing added."""
    given = Problem(plant, [straying(plant, r) for r in campaign.train], noises(campaign))
    bounds = {name: t.bounds(plant.parameters[name].nominal) for name, t in campaign.tolerances.items()}
    base = Hypothesis(tolerances(given, bounds))
    problem = with_long_steps(given, base.run(base.start()))
    watched(problem, say)("re-fitting the base model inside its tolerances")
    calibrated = store.remember("calibrated", told(campaign), lambda: _calibrated(problem, base))
    off = left_of_each(problem, calibrated)
    drifting = drifts(problem, off, campaign.told)
    weighed = Problem(plant, given.recordings, given.noise | drifting) if drifting else given
    quiet = with_quiet_inputs(with_long_steps(weighed, calibrated.run), calibrated.run)
    why = ["drift of positions set aside"] if drifting else []
    why += ["measured inputs simulated more coarsely"] if _as_simulated(quiet) != _as_simulated(problem) else []
    if why:
        watched(quiet, say)("re-fitting the base model, " + ", ".join(why))
        start = calibrated.x
        again = store.remember("calibrated again", (told(campaign), start), lambda: refit(quiet, base, start))
        problem, calibrated = (quiet, again) if again is not None else (given, calibrated)
        problem.drifting = {name: off[name] for name in drifting} if again is not None else {}
    problem.may_set_in = campaign.onsets
    return problem, calibrated


def straying(plant: Plant, recording: Recording) -> Recording:
    """With what 1 sigma of each start value that was taken from its noisy samples makes of its outputs: what turns
    nearly without friction carries it on to the end. SimulationError: a unit fails."""
    strays = []
    for shifts in recording.start_scatter.values():
        if any(shifts.values()):
            shifted = {name: value + shifts.get(name, 0.0) for name, value in recording.initial.items()}
            there, beside = (plant.simulate({}, r) for r in (recording, replace(recording, initial=shifted)))
            strays.append({name: beside[name] - there[name] for name in recording.outputs})
    return replace(recording, strays=strays) if strays else recording


def with_long_steps(problem: Problem, run: Run) -> Problem:
    """With longer steps of the integrator where that makes no difference to what is compared: it stops where an input
    turns, noise turns at every sample, and from one to the next its error asked for up to eight steps. The problem
    itself where no input has such noise. run: at which that is asked."""
    if problem.is_table or not any(_noisy_inputs(r) for r in problem.recordings):
        return problem
    (followed,) = problem.simulate([run])
    tried = [replace(r, coarse=True) if _noisy_inputs(r) else r for r in problem.recordings]
    (found,) = _of(problem, tried).simulate([run])
    if followed is None or found is None:
        return problem
    return _of(problem, _where(_unfelt(problem, followed, found), tried, problem.recordings))


def with_quiet_inputs(problem: Problem, run: Run) -> Problem:
    """With measured inputs on as few knots as make no difference to what is compared, or bring the simulation closer to
    it: one that follows the noise of a current from sample to sample takes up to five times as long and says the same,
    and the noise of a voltage's log, which no motor felt, shows in its current. What changes a simulation by d adds d'd
    to what it leaves where the input was as logged, and takes as much where that was noise. The problem itself where
    its inputs have no such noise, or every sample counts. run: at which that is asked."""
    if problem.is_table or not any(_noisy_inputs(r) for r in problem.recordings):
        return problem
    (followed,) = problem.simulate([run])
    if followed is None:
        return problem
    quiet, kept = list(problem.recordings), followed.white.copy()
    for every in KNOTS:
        tried = [_on_fewer_knots(r, every) for r in problem.recordings]
        (found,) = _of(problem, tried).simulate([run])
        if found is None:
            break
        fewer = np.array([_turns(new) < _turns(old) for new, old in zip(tried, quiet, strict=True)])
        good = (fewer & _unfelt(problem, followed, found)) | _closer(problem, kept, found.white)
        quiet = _where(good, tried, quiet)
        for n in np.flatnonzero(good):
            rows = problem.rows_of([int(n)])
            kept[rows] = found.white[rows]
    return _of(problem, quiet)


def _closer(problem: Problem, kept: Vector, found: Vector) -> NDArray[np.bool_]:
    """Of each recording, whether the second simulation leaves less than the first, by half of what is between the two
    at least, and by more than chance from stretch to stretch, (recordings,). kept, found: whitened, (rows,)"""
    gains = _of_each(problem, problem.recorded - kept) - _of_each(problem, problem.recorded - found)
    gained, scatter = gains.sum(axis=1), np.sqrt(STRETCHES) * gains.std(axis=1)
    half = _of_each(problem, kept - found).sum(axis=1) / 2
    return np.asarray((gained > half) & (gained > BY_CHANCE * scatter))


def _of_each(problem: Problem, rows: Vector) -> Vector:
    """Sums of squares over the stretches of each recording, (recordings, STRETCHES)"""
    found = np.zeros((len(problem.recordings), STRETCHES))
    for block in problem.blocks:
        squares = rows[block.rows] ** 2
        at = np.arange(len(squares)) * STRETCHES // len(squares)
        found[block.recording] += np.bincount(at, squares, STRETCHES)
    return found


def _unfelt(problem: Problem, followed: Simulated, found: Simulated) -> NDArray[np.bool_]:
    """Of each recording, whether what is compared is the same in both simulations, (recordings,)."""
    above = problem.above(problem.recorded - followed.white)
    least = max(UNFELT * problem.evidence, UNSEEN * above) / len(problem.recordings)
    return np.asarray(_of_each(problem, followed.white - found.white).sum(axis=1) < least)


def _where(same: NDArray[np.bool_], new: Sequence[Recording], old: Sequence[Recording]) -> list[Recording]:
    return [x if alike else y for alike, x, y in zip(same, new, old, strict=True)]


def _of(problem: Problem, recordings: Sequence[Recording]) -> Problem:
    """The problem with others in place of its recordings; itself where these are the same."""
    same = all(new is old for new, old in zip(recordings, problem.recordings, strict=True))
    return problem if same else Problem(problem.plant, recordings, problem.noise)


def _as_simulated(problem: Problem) -> list[tuple[bool, list[int]]]:
    """Per recording: whether with longer steps, and which arrays go in."""
    return [(r.coarse, [id(x) for x in r.inputs.values()]) for r in problem.recordings]


def _noisy_inputs(recording: Recording) -> list[str]:
    """Those that turn at most samples."""
    return [n for n, x in recording.inputs.items() if n not in recording.held and np.mean(_is_turn(x)) > 0.5]


def _turns(recording: Recording) -> int:
    """Samples at which an input turns, over all inputs."""
    return sum(int(_is_turn(x).sum()) for x in recording.inputs.values())


def _is_turn(x: Vector) -> NDArray[np.bool_]:
    """(n - 2,)"""
    return np.asarray(np.abs(np.diff(x, 2)) > SLIGHT * np.max(np.abs(x), initial=0.0))


def _on_fewer_knots(recording: Recording, every: int) -> Recording:
    lines = {name: on_fewer_knots(recording.time, recording.inputs[name], every) for name in _noisy_inputs(recording)}
    return replace(recording, inputs=recording.inputs | lines)


def drifts(problem: Problem, off: Mapping[str, float], believed: Collection[str]) -> dict[str, Noise]:
    """Position -> noise with which it counts no more per sample than that of the other channels that fits worst.

    A position adds up what is off in a speed, so that of an encoder's log next to nothing but drift is fitted: an axis
    was given a formula for it that made its speed twice as wrong. Without other channels there is nothing to go by.
    off: channel -> rms of what is left, times its noise.
    """
    units = {name: unit for r in problem.recordings for name, unit in r.units.items()}
    positions = {name for name in off if is_position(units.get(name))}
    worst = max((off[name] for name in off.keys() - positions), default=np.inf)
    found = {}
    for name in positions - set(believed):
        times = off[name] / max(worst, 1.0)
        if times > 1:
            was = problem.noise[name]
            found[name] = replace(was, sigma=times * was.sigma)
    return found


def left_of_each(problem: Problem, calibrated: Fit) -> dict[str, float]:
    """Channel -> rms of what the fit leaves, times its noise."""
    squares: dict[str, list[float]] = {}
    for block in problem.blocks:
        of_channel = squares.setdefault(block.channel, [0.0, 0.0])
        of_channel[0] += float(np.sum(calibrated.residual[block.rows] ** 2))
        of_channel[1] += float(block.weight.sum())
    return {name: float(np.sqrt(total / max(count, 1.0))) for name, (total, count) in squares.items()}


def watched(problem: Problem, say: Progress) -> Progress:
    """`say`, and until it says something else, how many simulations there were so far."""
    stage = ""

    def tell(words: str) -> None:
        nonlocal stage
        stage = words.split(": ")[0]
        say(words)

    problem.watch = lambda done, total: say(f"{stage}: {problem.runs + done} simulations so far")
    return tell


def _calibrated(problem: Problem, base: Hypothesis) -> Fit:
    """See refit. SimulationError: it cannot be simulated, nominal or beside it; which unit, which call, and why."""
    found = refit(problem, base)
    if found is not None:
        return found
    problem.outputs(base.run(base.start()))
    for k, coordinate in enumerate(base.coordinates):
        beside = base.start()
        beside[k] += problem.step
        try:
            problem.outputs(base.run(beside))
        except SimulationError as error:
            raise SimulationError(f"beside the nominal value of {coordinate.names[0]}: {error}") from error
    raise SimulationError("the system cannot be simulated beside its nominal parameters on these recordings")


def refit(problem: Problem, base: Hypothesis, start: Vector | None = None) -> Fit | None:
    """The base model at its best point. None: its nominal one cannot be simulated. start: where to begin, if not
    there."""
    found = fit(problem, base, start, precision=CALIBRATION)
    return out_of_local_minimum(problem, found, CALIBRATION) if found is not None else None


def told(campaign: Campaign) -> tuple[object, ...]:
    """What the campaign says of noise, which a result depends on beside the recordings."""
    return tuple((name, c.noise, c.colour) for name, c in campaign.logged.items() if c.colour is not None)


def basis(campaign: Campaign) -> tuple[object, ...]:
    """What a search depends on that a store does not know of: what the campaign says of noise and the like, and the
    terms that it lists."""
    return (*told(campaign), *campaign.terms)


def noises(campaign: Campaign) -> dict[str, Noise]:
    """Per compared channel, as the campaign says; else as the recordings show it, and never below what the system's
    logger is specified for."""
    found = {}
    for name, quality in condition(campaign.train).items():
        logged = campaign.logged.get(name)
        floor = float(np.hypot(logged.noise, (logged.step or 0.0) / np.sqrt(12))) if logged and logged.noise else 0.0
        colour = logged.colour if logged and logged.colour is not None else max(quality.colour, 0.0)
        sigma = quality.sigma(floor)
        believed = bool(floor) and (name in campaign.told or sigma < 0.9 * floor)
        found[name] = Noise(floor if believed else sigma, colour, quality.step)
    return found
