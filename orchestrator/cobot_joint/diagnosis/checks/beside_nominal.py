"""Recordings beside the nominal system: factors, signs, swapped and late channels, drift; nothing is fitted."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from cobot_joint.diagnosis.checks.delays import Delay, agreed, of_one_shaft
from cobot_joint.diagnosis.data.conditioning import noise_and_colour
from cobot_joint.diagnosis.data.recording import Recording
from cobot_joint.diagnosis.data.suspicion import Suspicion
from cobot_joint.errors import among

Vector = NDArray[np.float64]
Simulate = Callable[[Recording], Mapping[str, Vector]]  # outputs of the nominal system at the recording's time

ALIKE = 0.7  # correlation from which a recorded channel is the simulated one, apart from its size
SAME = 0.9  # correlation from which a hypothesis explains a channel
DOUBT = 0.97  # correlation below which an input is doubted: real machines with their background have 0.99 and more
FAR = 3.0  # factor between recorded and simulated motion that physics alone has never made (0.6 to 1.13 on real logs)
NEAR = 1.35  # within which a factor is taken for a known one
SHARE = 0.5  # of what the nominal system leaves, that a delay has to explain
STILL = 0.01  # of what is recorded, that a system moves at most which nothing drives: 0 of 220 sound runs
MOVES = 10.0  # times the noise, that a machine moves which something drives
LONGEST = 30.0  # s of a run that are simulated

DECIMALS = {1000.0: "a unit of a thousandth was declared whole (mA as A)", 100.0: "percent, or hundredths",
            10.0: "a decimal place", 1e6: "millionths"}  # fmt: skip
TURNS = {60 / (2 * np.pi): "rpm read as rad/s", 180 / np.pi: "degrees per second read as rad/s",
         1 / (2 * np.pi): "turns per second read as rad/s"}  # fmt: skip
ANGLES = {180 / np.pi: "degrees read as rad", 1 / (2 * np.pi): "turns read as rad"}


@dataclass(frozen=True)
class Match:
    """A recorded channel beside a simulated one: recorded = factor*simulated + offset, as far as they go together."""

    factor: float  # of the two standard deviations, with the correlation's sign
    correlation: float

    @property
    def fits(self) -> bool:
        """They are the same signal."""
        return self.correlation > SAME and 1 / FAR < self.factor < FAR


def beside_nominal(
    recordings: Sequence[Recording], simulate: Simulate, ratios: Mapping[str, float] | None = None
) -> list[Suspicion]:
    """What recordings say against their channels when the nominal system runs beside them.

    ratios: gear ratios of the system, by name. Recordings after one that shows something wrong are not looked at.
    """
    found: list[Suspicion] = []
    lags: dict[str, list[tuple[str, float]]] = {}
    shafts: dict[tuple[str, str], dict[str, Delay]] = {}
    for recording in recordings:
        if any(s.wrong for s in found):  # one is enough: nothing is fitted
            break
        r = _beginning(recording)
        simulated = simulate(r)
        wrong = list(_driven_by_nothing(r, simulated)) or list(_scales(r, simulated, simulate, ratios or {}))
        found += wrong or list(_free_drift(r, simulated))
        for angle, speed, delay in [] if wrong else of_one_shaft(r, simulated):
            shafts.setdefault((angle, speed), {})[r.name] = delay
        for name, m in _matches(r, simulated).items():
            if wrong or m.correlation < ALIKE:
                continue
            if name in r.believed and _is_odd(m) and name not in {s.channel for s in found if s.kind == "factor"}:
                found.append(_scale(r, name, m, ratios or {}, believed=True))
            at = timing(r.outputs[name], simulated[name], r.step)
            if at.by_rate > SHARE and abs(at.rate) * (r.time[-1] - r.time[0]) > 2 * r.step:
                words = (
                    f"its delay grows by {1e3 * at.rate:.3g} ms per s: its clock runs at another rate than the "
                    "inputs', or a value of the data sheet is off; the answer says if it is the clock"
                )
                found.append(Suspicion(r.name, name, "clock drifts", words))
            elif at.by_tau > SHARE and abs(at.tau) > r.step:
                lags.setdefault(name, []).append((r.name, at.tau))
    apart = list(_apart(shafts, max((r.step for r in recordings), default=0.0)))
    told = {s.channel for s in apart}
    lags = {n: seen for n, seen in lags.items() if n not in told}
    return found + apart + list(_skews(lags, {n: sum(n in r.outputs for r in recordings) for n in lags}))


def _beginning(r: Recording) -> Recording:
    """What is simulated of a run."""
    n = min(len(r.time), int(LONGEST / r.step) + 1)
    inputs, outputs = ({k: v[:n] for k, v in x.items()} for x in (r.inputs, r.outputs))
    return replace(r, time=r.time[:n], inputs=inputs, outputs=outputs)


def match(recorded: Vector, simulated: Vector) -> Match | None:
    """None: one of them does not move."""
    known = np.isfinite(recorded) & np.isfinite(simulated)
    if known.sum() < 3:
        return None
    a, b = (x[known] - np.mean(x[known]) for x in (recorded, simulated))
    if not (np.any(a) and np.any(b)):
        return None
    correlation = float(a @ b / np.sqrt((a @ a) * (b @ b)))
    return Match(float(np.copysign(np.sqrt((a @ a) / (b @ b)), correlation)), correlation)


def _matches(r: Recording, simulated: Mapping[str, Vector]) -> dict[str, Match]:
    return {n: m for n, x in r.outputs.items() if n in simulated and (m := match(x, simulated[n])) is not None}


def _driven_by_nothing(r: Recording, simulated: Mapping[str, Vector]) -> Iterator[Suspicion]:
    """Inputs of one value, with which the nominal system stands still while the machine moves."""
    both = {n: (x[np.isfinite(x)], simulated[n]) for n, x in r.outputs.items() if n in simulated}
    if any(np.std(s) > STILL * np.std(x) for x, s in both.values() if len(x)):
        return
    mover = next((n for n, (x, _) in both.items() if len(x) > 2 and np.std(x) > MOVES * noise_and_colour(x)[0]), "")
    for name, u in r.inputs.items():
        if mover and np.ptp(u) == 0 and name not in r.believed:
            column = r.columns.get(name, name)
            words = (
                f"one value, {u[0]:.4g}, in the whole recording, with which the nominal system stands still while "
                f"{mover} moves: is {column!r} the right column? If what drives the machine was not recorded, scale = 1"
            )
            yield Suspicion(r.name, name, "frozen", words, wrong=True)


def _scales(
    r: Recording, simulated: Mapping[str, Vector], simulate: Simulate, ratios: Mapping[str, float]
) -> Iterator[Suspicion]:
    """Factors, signs and swaps."""
    found = _matches(r, simulated)
    odd = {n: m for n, m in found.items() if n not in r.believed and _is_odd(m)}
    if odd and (swapped := _swapped(r, simulated, odd)):
        yield swapped
    elif any(_is_doubtful(m) for m in found.values()) and (cause := _input_at_fault(r, found, odd, simulate, ratios)):
        yield cause
    else:
        yield from (_scale(r, name, m, ratios) for name, m in odd.items() if abs(m.correlation) >= ALIKE)


def _is_odd(m: Match) -> bool:
    return abs(m.correlation) < ALIKE or not 1 / FAR < m.factor < FAR


def _is_doubtful(m: Match) -> bool:
    return m.correlation < DOUBT or not 1 / 1.6 < m.factor < 1.6


def _scale(r: Recording, name: str, m: Match, ratios: Mapping[str, float], *, believed: bool = False) -> Suspicion:
    """believed: somebody gave it a scale or a sign, so that it is said and no more."""
    size = abs(m.factor)
    column = r.columns.get(name, name)
    if 1 / FAR < size < FAR:
        evidence = f"it moves against the nominal system (correlation {m.correlation:.2f}): "
        return Suspicion(r.name, name, "sign", evidence + f"reversed? If so, sign = -1 for {column!r}", wrong=True)
    known = known_factors(size, r.units.get(name, ""), ratios)
    evidence = f"it moves {m.factor:.4g} times as much as the nominal system (correlation {m.correlation:.2f})"
    if believed:
        return Suspicion(r.name, name, "factor", f"{evidence}; the scale that [channels] gives {column!r} is believed")
    if not known:
        return Suspicion(r.name, name, "factor", f"{evidence}; no usual factor is near")
    factors = " or ".join(f"{value:.5g}, {words}" for value, words in known)
    remedy = "scale = " + " or ".join(f"{1 / value:.6g}" for value, _ in known)
    remedy += ", sign = -1" if m.factor < 0 else ""
    evidence += f": factor {factors}? If so, its unit or {remedy} for {column!r}; if not, scale = 1"
    return Suspicion(r.name, name, "factor", evidence, wrong=True)


def known_factors(size: float, unit: str, ratios: Mapping[str, float]) -> list[tuple[float, str]]:
    """Usual factors (or their inverses) near a size, with their words: at most the nearest of the unit's own and of all
    others, for rpm and a decimal place no nominal system tells apart. Empty: none is near."""
    own = {"rad/s": TURNS, "rad": ANGLES}.get(unit, {})
    gears = {abs(v): f"the gear ratio {name}: the other side of the gear" for name, v in ratios.items() if abs(v) > FAR}
    found = []
    for usual in (own, DECIMALS | gears):
        both = [(f, words) for f, words in usual.items()] + [
            (1 / f, f"{words}, inverted") for f, words in usual.items()
        ]
        found += sorted(both, key=lambda fw: abs(np.log(size / fw[0])))[:1]
    return [(value, words) for value, words in found if abs(np.log(size / value)) < np.log(NEAR)]


def _swapped(r: Recording, simulated: Mapping[str, Vector], odd: Mapping[str, Match]) -> Suspicion | None:
    for a, b in combinations([n for n in r.outputs if n in simulated], 2):
        if a not in odd and b not in odd:
            continue
        across = match(r.outputs[a], simulated[b]), match(r.outputs[b], simulated[a])
        if all(m is not None and m.fits for m in across):
            words = f"{r.columns.get(a, a)!r} looks like {b} and {r.columns.get(b, b)!r} like {a}: swapped"
            return Suspicion(r.name, f"{a}, {b}", "swapped", words, wrong=True)
    return None


def _input_at_fault(
    r: Recording,
    found: Mapping[str, Match],
    odd: Collection[str],
    simulate: Simulate,
    ratios: Mapping[str, float],
) -> Suspicion | None:
    """An input with whose sign or factor put right every output fits the nominal system, far better than as it is.

    A gear's ratio among the factors: a torque that is asked for behind a gear is so many times the motor's. One that
    somebody looked at is believed where no output is odd.
    """
    before = min(m.correlation for m in found.values())
    gears = {f for N in ratios.values() if abs(N) > FAR for f in (1 / abs(N), abs(N))}
    for name, x in r.inputs.items():
        if (name in r.believed and not odd) or not np.any(x):
            continue
        right = f"scale = 1 for {among(sorted(odd), 5)}" if name in r.believed else "scale = 1"
        for factor in (-1.0, 1e-3, 1e3, 0.1, 10.0, *gears):
            again = _matches(r, simulate(replace(r, inputs=r.inputs | {name: factor * x})))
            after = min((m.correlation for m in again.values()), default=-1.0)
            if len(again) < len(found) or any(map(_is_doubtful, again.values())) or 1 - after > (1 - before) / 4:
                continue
            what = "its sign reversed" if factor < 0 else f"a factor of {factor:.5g}"
            side = " (a gear's ratio: it belongs to the other side of that gear)" if factor in gears else ""
            remedy = (
                "sign = -1, or 1 where it is -1,"
                if factor < 0
                else f"scale = {factor:.6g}, or what scale has times that,"
            )
            evidence = (
                f"with {what}{side} every output fits the nominal system, as it is not (correlation {before:.2f}): "
                f"{remedy} for {r.columns.get(name, name)!r}, or its unit; if it is right, {right}"
            )
            return Suspicion(r.name, name, "sign" if factor < 0 else "factor", evidence, wrong=True)
    return None


@dataclass(frozen=True)
class Timing:
    """x(t) = gain*s(t - tau - rate*t) + offset, and the shares of the rest that tau, and then rate, explain."""

    tau: float  # s
    rate: float  # s per s
    by_tau: float
    by_rate: float


def timing(x: Vector, s: Vector, step: float) -> Timing:
    """Least squares, linearised about the last round's tau and rate. s is simulated: its slope has no noise."""
    tau, _, late = shifted(x, s, step, (0.0, 0.0), with_rate=False)
    both, rate, drifting = shifted(x, s, step, (tau, 0.0), with_rate=True)
    none = unlike(x, s)
    if abs(both) + abs(rate) * step * len(x) > 0.1 * step * len(x):  # it does not converge: no delay
        return Timing(0.0, 0.0, 0.0, 0.0)
    return Timing(tau, rate, 1 - late / none if none else 0.0, 1 - drifting / late if late else 0.0)


def shifted(
    x: Vector, s: Vector, step: float, start: tuple[float, float], *, with_rate: bool, rounds: int = 4
) -> tuple[float, float, float]:
    """(tau, rate, sum of squares left), linearised about `start` and then each time about what was found."""
    t, known = np.arange(len(x)) * step, np.isfinite(x)
    tau, rate = start
    for _ in range(rounds):
        moved = np.interp(t - tau - rate * t, t, s)
        slope = np.gradient(moved, step)
        columns = [np.ones_like(t), moved, slope, t * slope][: 4 if with_rate else 3]
        solution = np.linalg.lstsq(np.column_stack(columns)[known], x[known], rcond=None)[0]
        if solution[1] == 0:
            break
        tau -= float(solution[2] / solution[1])
        rate -= float(solution[3] / solution[1]) if with_rate else 0.0
    return tau, rate, unlike(x, np.interp(t - tau - rate * t, t, s))


def unlike(x: Vector, s: Vector) -> float:
    """Sum of squares of x that a constant and a multiple of s leave; NaN of x: not recorded."""
    known = np.isfinite(x)
    m = match(x, s)
    a = x[known] - np.mean(x[known])
    return float((1 - (m.correlation if m else 0.0) ** 2) * (a @ a))


def _apart(shafts: Mapping[tuple[str, str], Mapping[str, Delay]], step: float) -> Iterator[Suspicion]:
    """Speeds that are late beside the angle of their own shaft, or early."""
    for (angle, speed), seen in shafts.items():
        late = agreed(list(seen.values()), step)
        if late is not None:
            words = (
                f"it comes {1e3 * abs(late):.2g} ms {'after' if late > 0 else 'before'} {angle}, whose slope it is, in "
                f"every run that tells: one of them is stamped wrong, or filtered; stamps are put right with late"
            )
            yield Suspicion(", ".join(seen), speed, "late", words)


def _skews(lags: Mapping[str, Sequence[tuple[str, float]]], runs: Mapping[str, int]) -> Iterator[Suspicion]:
    """Channels that are late by the same time in every run that has them."""
    for name, seen in lags.items():
        delays = np.array([tau for _, tau in seen])
        if len(seen) < runs[name] or np.ptp(delays) > 0.3 * np.abs(delays).max():
            continue
        tau = float(np.median(delays))
        evidence = (
            f"it comes {1e3 * abs(tau):.2g} ms {'after' if tau > 0 else 'before'} the nominal system in every run: a "
            f"value of the data sheet, a lag of the machine, or late stamps; the answer says if it is the stamps"
        )
        yield Suspicion(", ".join(run for run, _ in seen), name, "late", evidence)


def _free_drift(r: Recording, simulated: Mapping[str, Vector]) -> Iterator[Suspicion]:
    """A free run whose changes fit while it drifts away: it integrates what friction is missing."""
    for name, x in r.outputs.items():
        if name not in simulated or r.units.get(name) not in ("rad", "rad/s", "m", "m/s"):
            continue
        s = simulated[name]
        whole, steps = match(x, s), match(_differences(x, r.step), _differences(s, r.step))
        rest = np.where(np.isfinite(x), x - s, 0.0)
        quarter = len(x) // 4
        early, late = (float(np.sqrt(np.mean(part**2))) for part in (rest[:quarter], rest[-quarter:]))
        if whole and steps and steps.correlation > SAME and whole.correlation < ALIKE and late > FAR * early:
            evidence = (
                f"its changes fit the nominal system (correlation {steps.correlation:.2f}) and it drifts away "
                f"(from {early:.3g} to {late:.3g}): a free run integrates what friction is missing; "
                f"drive the system with the motion and compare the torque"
            )
            yield Suspicion(r.name, name, "drift", evidence)


def _differences(x: Vector, step: float) -> Vector:
    reach = max(1, round(0.05 / step))
    return x[reach:] - x[:-reach]
