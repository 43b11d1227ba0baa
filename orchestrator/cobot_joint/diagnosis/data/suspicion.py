"""What may be wrong with a channel, as far as its recordings say, and which of its samples are no measurements then."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from cobot_joint.diagnosis.data.conditioning import RAIL, noise_and_colour, quantisation_step, runs
from cobot_joint.diagnosis.data.quantity import is_position
from cobot_joint.diagnosis.data.recording import LeftOut, Recording

Vector = NDArray[np.float64]
Mask = NDArray[np.bool_]
Kind = Literal[
    "factor", "sign", "swapped", "late", "clock drifts", "drift", "limit", "start", "lost",  # beside the nominal system
    # from the data alone
    "clipped", "frozen", "held", "bridged", "outlier", "not excited", "inertia differs", "duplicate",
]  # fmt: skip

CLIPPED = 0.002  # share of samples at an extreme, in runs that noise would break up
AT_REST = 0.3  # of the usual step, by which a profile that comes to rest at an extreme still moves just before
FROZEN = 0.25  # s of one value while others move
HELD = 0.1  # share of samples that repeat the one before in the middle of motion: 0.05 at most in 493 sound channels
PACE = 3.0  # steps, and sigma of the noise, per sample, from which on motion is no chance repeat (at 2: share 0.11)
SHAKES = 0.75  # steps of noise, rounding included, from which on leaving repeats out moves no mean by 0.01 steps
REACH = 10  # samples on either side, over which a channel's pace is taken
CAUGHT_UP = (1.75, 2.25)  # times its neighbours, that the step after a repeat is where a value was not renewed
IN_A_ROW = 8  # repeats at most: where 30 % are held, more come once in 15,000
ENOUGH = 30  # such steps, of which that can be told


@dataclass(frozen=True)
class Suspicion:
    """A channel that is not what the campaign takes it for. `wrong`: sure enough that nothing ought to be fitted."""

    recording: str
    channel: str  # connector; several: "a, b"
    kind: Kind
    evidence: str
    wrong: bool = False

    def __str__(self) -> str:
        return f"{self.recording}: {self.channel}: {self.evidence}"


@dataclass(frozen=True)
class Fault:
    """Samples of an output that are no measurements, (n,); none: it is seen, and which samples is not."""

    channel: str
    kind: Literal["clipped", "frozen", "held"]
    words: str
    at: Mask


def without_faults(recordings: Sequence[Recording]) -> list[Recording]:
    """With clipped, frozen and repeated samples taken as not recorded (NaN), and channels of one value left away; an
    input that was held is bridged.

    A channel that is held in one training run is held in all: slow motion does not show it. A column that somebody
    looked at is believed. What is left out is said in `left_out`.
    """
    recordings = _with_bridges(recordings)
    found = [list(faults(r)) for r in recordings]
    fitted = [of_run for r, of_run in zip(recordings, found, strict=True) if r.role == "train"]
    slow = {fault.channel: fault.words for of_run in fitted for fault in of_run if fault.kind == "held"}
    left = []
    for r, of_run in zip(recordings, found, strict=True):
        told = {fault.channel for fault in of_run}
        more = [Fault(n, "held", slow[n], repeated(r.outputs[n])) for n in slow if n in r.outputs and n not in told]
        left.append(_without(r, [*of_run, *more]))
    return left


def _with_bridges(recordings: Sequence[Recording]) -> list[Recording]:
    """Recordings whose held inputs go on in straight lines instead; not where the campaign says that they hold."""
    own = [{} if r.scatter else {n: w for n, x in r.inputs.items() if (w := not_renewed(x))} for r in recordings]
    fitted = {n: w for r, held in zip(recordings, own, strict=True) if r.role == "train" for n, w in held.items()}
    seen = [fitted | held for held in own]
    return [
        _bridged(r, {n: w for n, w in held.items() if n in r.inputs and n not in r.believed | r.held})
        for r, held in zip(recordings, seen, strict=True)
    ]


def _bridged(r: Recording, held: Mapping[str, str]) -> Recording:
    """held: input -> what is said of it."""
    inputs, left_out, at = dict(r.inputs), list(r.left_out), np.arange(len(r.time))
    for name, words in held.items():
        bridged, x = short_repeats(inputs[name]), inputs[name]
        if bridged.any():
            inputs[name] = np.interp(at, at[~bridged], x[~bridged])
            said = f"{words}: {int(bridged.sum())} of {len(x)} samples are bridged in a straight line"
            left_out.append(LeftOut(name, "bridged", int(bridged.sum()), said))
    return replace(r, inputs=inputs, left_out=left_out) if len(left_out) > len(r.left_out) else r


def _without(r: Recording, found: Sequence[Fault]) -> Recording:
    outputs, left_out = dict(r.outputs), list(r.left_out)
    for fault in found:
        name, x = fault.channel, outputs[fault.channel]
        count = int((fault.at & np.isfinite(x)).sum())
        if name in r.believed or not count:
            continue
        outputs[name] = np.where(fault.at, np.nan, x)
        what = f"{count} of {len(x)} samples are taken as not recorded"
        if not np.isfinite(outputs[name]).any():
            del outputs[name]
            what = "it is not compared; if it is right, scale = 1"
        left_out.append(LeftOut(name, fault.kind, count, f"{fault.words}: {what}"))
    return replace(r, outputs=outputs, left_out=left_out) if len(left_out) > len(r.left_out) else r


def faults(r: Recording) -> Iterator[Fault]:
    """Of a recording's outputs; at most one per channel. A commanded input may stand still and end at a limit."""
    at_none = np.zeros(len(r.time), dtype=bool)
    for name, x in r.outputs.items():
        if np.isfinite(x).sum() < 2 or name in r.scatter:  # rows of a table follow one another in no time
            continue
        words, at = ("", at_none) if _may_rest(r, name) else clipped(x)
        if words:
            yield Fault(name, "clipped", words, at)
            continue
        words, at = frozen(x, r, name)
        if words:
            yield Fault(name, "frozen", words, at)
            continue
        words, at = held(x)
        if words:
            yield Fault(name, "held", words, at)


def clipped(x: Vector) -> tuple[str, Mask]:
    """Runs of one value at an extreme, of a channel that is never as still anywhere else and does not slow down to it.

    Samples beside one at the extreme go with it: of those near the limit only what noise leaves below would be kept.
    None go where the converter's steps hide the noise: a smooth peak is as still then.
    """
    known = np.isfinite(x)
    still = np.concatenate([[False], np.diff(x[known]) == 0])
    said, out = [], np.zeros(len(x), dtype=bool)
    for what, extreme in (("top", x[known].max()), ("bottom", x[known].min())):
        at = x[known] == extreme
        long = [run for run in runs(at) if run[1] - run[0] >= RAIL]
        count = sum(stop - start for start, stop in long)
        elsewhere = still[~at].mean() if (~at).any() else 1.0
        rests = elsewhere >= 0.6 or _comes_to_rest(x[known], long)
        if count >= max(CLIPPED * len(at), RAIL) and extreme != 0 and not rests:
            said.append(f"clipped at the {what}, {extreme:.4g}: {count} of {len(at)} samples in runs of one value")
            out |= binary_dilation(x == extreme, iterations=RAIL)
    return "; ".join(said), out & (not _hides_noise(np.where(out, np.nan, x)))


def _comes_to_rest(x: Vector, long: Sequence[tuple[int, int]]) -> bool:
    """Whether a channel slows down to stretches of one value, as a command without noise does at a profile's end."""
    steps = np.diff(x)
    moving = np.abs(steps[np.abs(steps) > 0])
    if not len(moving):
        return False
    slow = max(AT_REST * float(np.median(moving)), 1.01 * quantisation_step(x[np.isfinite(x)]))
    before = [steps[start - 4 : start - 1] for start, _ in long if start > 4]
    after = [steps[stop : stop + 3] for _, stop in long if stop + 3 < len(x)]
    slowing = [np.abs(edge).max() <= slow and not edge.min() < 0 < edge.max() for edge in before + after]
    return bool(slowing) and sum(slowing) > 0.5 * len(slowing)


def frozen(x: Vector, r: Recording, name: str) -> tuple[str, Mask]:
    """One value for long, of a channel with noise, or that has left rest while other channels move: without slowing
    down to it.

    A drive that is switched off may log nothing but zeros: these are frozen only while another channel moves.
    """
    nowhere = np.zeros(len(x), dtype=bool)
    if np.nanmax(x) == np.nanmin(x):
        words = f"one value, {np.nanmax(x):.4g}, in the whole recording"
        mover = _mover(r, name, slice(0, len(x)))
        return (f"{words}, while {mover} moves", ~nowhere) if mover in r.outputs else (words, nowhere)
    same = _again(x)
    long = [run for run in runs(same) if (run[1] - run[0] + 1) * r.step >= FROZEN and run[1] - run[0] >= 4 * RAIL]
    within = nowhere.copy()
    for start, stop in long:
        within[start:stop] = True
    elsewhere = np.where(within, np.nan, x)
    if not long or _hides_noise(elsewhere):
        return "", nowhere
    noisy, rests = same[~within].mean() < 0.5, _may_rest(r, name)
    found = {}
    for start, stop in long:
        mover = _mover(r, name, slice(max(start - 1, 0), stop))
        if _comes_to_rest(x, [(start - 1, stop)]):
            continue
        if (mover and noisy) or (x[start] != 0 and (mover or (noisy and not rests))):
            found[start, stop] = f"while {mover} moves" if mover else "without its noise"
            nowhere[start:stop] = True
    if not found:
        return "", nowhere
    start, stop = max(found, key=lambda run: run[1] - run[0])
    since, span = r.time[start] - r.time[0], (stop - start) * r.step
    return f"frozen at {x[start]:.4g} for {span:.3g} s from {since:.4g} s on, {found[start, stop]}", nowhere


def _hides_noise(x: Vector) -> bool:
    """Whether the converter's steps are so wide that noise does not move the channel from one to the next."""
    return bool(np.nan_to_num(noise_and_colour(x)[0]) < 0.5 * quantisation_step(x[np.isfinite(x)]))


FOLLOWS = 3  # samples by which a machine moves after it was asked to


def _mover(r: Recording, name: str, span: slice) -> str:
    """Another channel that moves meanwhile; "": none. Beside a shaft's position a speed. Not only at the end: what a
    step starts follows it by a few samples."""
    span = slice(span.start, span.stop - max(FOLLOWS, (span.stop - span.start) // 10))
    moves = {n: y for n, y in (r.outputs | r.inputs).items() if not _may_rest(r, name) or _is_speed(r, n)}
    return next((n for n, y in moves.items() if n != name and _moves(y, span)), "")


def _may_rest(r: Recording, name: str) -> bool:
    """A shaft may stand still anywhere."""
    return is_position(r.units.get(name))


def _is_speed(r: Recording, name: str) -> bool:
    return r.units.get(name) in ("rad/s", "m/s") and name in r.outputs


def _moves(y: Vector, span: slice) -> bool:
    part, whole = y[span][np.isfinite(y[span])], y[np.isfinite(y)]
    return len(part) > 1 and bool(np.ptp(part) > 0.2 * np.ptp(whole) > 0)


def held(x: Vector) -> tuple[str, Mask]:
    """Samples that repeat the one before while the channel moves on by more than its step and noise per sample."""
    nowhere, moving = np.zeros(len(x), dtype=bool), _moving(x)
    if moving.sum() < 100:
        return "", nowhere
    share = float(np.mean(_again(x)[moving]))
    if share <= HELD:
        return "", nowhere
    words = f"{100 * share:.0f} % of its samples repeat the one before while it moves: held, or slower than the clock"
    return words, repeated(x)


def not_renewed(x: Vector) -> str:
    """Whether an input repeats samples for want of new ones, in words: the step after a repeat makes up for it.

    What a command really does in stairs, or in a converter's steps, is followed by a step like any other.
    """
    again, moving = _again(x), _moving(x)
    fresh = ~again
    k = np.arange(2, len(x) - 2)
    alone = k[again[k] & moving[k] & fresh[k - 1] & fresh[k - 2] & fresh[k + 1] & fresh[k + 2]]
    before, after, later = (np.abs(x[alone + j] - x[alone + j - 1]) for j in (-1, 1, 2))
    low, high = CAUGHT_UP
    if len(alone) < ENOUGH or not low < float(np.median(2 * after / (before + later))) < high:
        return ""
    share = 100 * again[moving].mean()
    return f"{share:.0f} % of its samples repeat the one before while it moves, and the next step makes up for it: held"


def short_repeats(x: Vector) -> Mask:
    """Of a held input, what repeats a few times in a row; in long rows it stands still."""
    found = np.zeros(len(x), dtype=bool)
    for start, stop in runs(_again(x)):
        found[start:stop] = stop - start <= IN_A_ROW
    return found


def _moving(x: Vector) -> Mask:
    noise, step, pace = _noise_step_pace(x)
    return np.asarray(pace > PACE * max(step, noise))


def repeated(x: Vector) -> Mask:
    """Samples of a held channel that are the one before; where steps hide noise and motion, it may just stand still."""
    noise, step, pace = _noise_step_pace(x)
    return np.asarray(_again(x) & ((noise > SHAKES * step) | (pace > step)))


def _again(x: Vector) -> Mask:
    return np.concatenate([[False], np.diff(x) == 0])


def _noise_step_pace(x: Vector) -> tuple[float, float, Vector]:
    """1 sigma, the converter's step, and the change per sample over ten of them, on the side where it is less, (n,): at
    the edge of a step it stands still on one."""
    pace = np.zeros(len(x))
    if len(x) > 2 * REACH:
        change = np.nan_to_num(np.abs(x[REACH:] - x[:-REACH])) / REACH
        pace[REACH:-REACH] = np.minimum(change[:-REACH], change[REACH:])
    return float(np.nan_to_num(noise_and_colour(x)[0])), quantisation_step(x[np.isfinite(x)]), pace
