"""One regular clock for a recording: stamps in order, gaps, jitter and wild samples seen, channels put on it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from cobot_joint.diagnosis.data.formats import Channel, Log
from cobot_joint.diagnosis.data.quantity import split_header
from cobot_joint.errors import UserError, among

GAP = 2.5  # steps between two samples above which what lies between counts as not recorded
ROUNDED = 0.01  # steps by which the stamps of a regular clock may be off, by rounding
JITTERY = 0.5  # the same of one that jitters
FEWEST_STAMPS = 8  # of which it can be told that samples come evenly between them
FEWEST = 16  # samples of which anything can be said
SPARSEST = 10  # steps per sample above which a clock is not one
SLOWEST, LONG = 0.5, 3600.0  # s between samples, and in all, beyond which a log is no drive's unless it says so
JITTER = 1e-3  # steps by which a stamp may miss the regular clock before its samples are interpolated onto it
MEDIAN = 5  # samples of a running median: one or two in a row are wild, three are motion
FAR = 20.0  # times the range of all but a hundredth of the samples
WHOLE = 0.01  # of a turn, by which what jumps by one may miss it
SPIKE, SPIKES = 4.0, 5  # times what any other departs by, and how many single samples may stand out alone
ALONE = 0.1  # of the range, that they depart by: so far no corner of a computed signal does
LEAST = 50  # samples from which on a range is one


def regular_clock(
    path: Path, raw: dict[str, Channel], notes: list[str], *, confirmed: bool = False, fewest: int = FEWEST
) -> NDArray[np.float64]:
    """The fastest channel's median step, over the time that all channels share.

    Puts each channel's own clock in order first. confirmed: the campaign names the clock and its unit.
    """
    clocks = {id(channel.time): channel for channel in reversed(raw.values())}
    ordered = {}
    for key, channel in clocks.items():
        whose = "the clock" if len(clocks) == 1 else f"the clock of {channel.name}"
        spread = _spread(whose, channel.time, notes)
        ordered[key] = spread, _in_order(path, whose, spread, notes)
    for name, channel in list(raw.items()):
        time, keep = ordered[id(channel.time)]
        raw[name] = Channel(channel.name, channel.unit, time[keep], channel.values[keep])
    times = list({id(c.time): c.time for c in raw.values()}.values())
    if min(map(len, times)) < fewest:
        raise UserError(f"{path}: {min(map(len, times))} usable samples are given, {fewest} at least are needed")
    step = min(_step(t) for t in times)
    start, stop = max(t[0] for t in times), min(t[-1] for t in times)
    if stop - start < 2 * step:
        raise UserError(
            f"{path}: its channels share {max(stop - start, 0.0):g} s, 2 steps of {step:g} s at least are needed"
        )
    _check_clock(path, max(times, key=len), step, confirmed)
    return np.asarray(start + step * np.arange(int(np.floor((stop - start) / step + 1e-6)) + 1))


def _check_clock(path: Path, time: NDArray[np.float64], step: float, confirmed: bool) -> None:
    """UserError: stamps that leave most of the time unrecorded, or a step that is none of a drive's log."""
    span = time[-1] - time[0]
    if span / step > SPARSEST * len(time):
        k = int(np.argmax(np.diff(time)))
        raise UserError(
            f"{path}: its clock jumps from {time[k]:g} s to {time[k + 1]:g} s in steps of {step:g} s: {len(time)} "
            f"samples, {span / step:.3g} steps; leave the stray stamps out, or cut with begin and end"
        )
    if (step > SLOWEST or (span > LONG and step > SLOWEST / 10)) and not confirmed:
        raise UserError(
            f"{path}: its clock steps by {step:g} s and runs for {span:g} s; a drive's log is faster than "
            f"{SLOWEST:g} s: "
            f'if it counts ms (factor 1000), say time = "NAME [ms]"; if it is right, time = "NAME [s]"'
        )


def _step(time: NDArray[np.float64]) -> float:
    """That of a clock whose stamps are off by rounding or jitter, gaps between or not; the median of any other.

    The median of differences that jitter is off by a ten-thousandth, half a sample at the end of a run.
    """
    steps = np.diff(time)
    mean, median = float(np.mean(steps)), float(np.median(steps))
    if np.abs(time - time[0] - mean * np.arange(len(time))).max() < ROUNDED * mean:
        return _nice(mean)
    ticks = np.concatenate([[0.0], np.cumsum(np.maximum(np.rint(steps / median), 1.0))])
    step, first = np.polyfit(ticks, time, 1)
    regular = np.abs(time - first - step * ticks).max() < JITTERY * median
    return _nice(float(step) if regular else median)


def _nice(step: float) -> float:
    """Differences carry rounding, 0.0009999999999994: the nearest number of four digits, if it is that."""
    rounded = float(f"{step:.4g}")
    return rounded if abs(rounded - step) < 1e-6 * step else step


def _spread(whose: str, time: NDArray[np.float64], notes: list[str]) -> NDArray[np.float64]:
    """Stamps that were cut to whole seconds, or to any step, while samples came several times as often: evenly apart.

    Themselves where any sample would then lie outside of the step that it is stamped with: they came at no even pace.
    """
    begins = np.flatnonzero(np.diff(time, prepend=-np.inf) > 0)  # of each stamp the first sample
    if len(begins) < FEWEST_STAMPS or len(time) < 2 * len(begins) or not (np.diff(time) >= 0).all():
        return time
    step, even = float(np.median(np.diff(time[begins]))), time.copy()
    gaps = np.flatnonzero(np.diff(time[begins]) > GAP * step) + 1
    for own, end in zip(np.split(begins, gaps), [*begins[gaps], len(time)], strict=True):
        if len(own) < 3:  # two of them whole at least
            return time
        pace = (time[own[-1]] - time[own[1]]) / (own[-1] - own[1])  # the first may have begun before the log
        even[own[0] : end] = time[own[1]] + pace * (np.arange(own[0], end) - own[1])
    if np.any(even - time < -pace) or np.any(even - time > step + pace):
        return time
    count = f"{step / pace:.4g} samples in each: taken {pace:.4g} s apart"
    notes.append(f"{whose} counts in steps of {step:g} s and has {count}")
    return even


def _in_order(path: Path, whose: str, time: NDArray[np.float64], notes: list[str]) -> NDArray[np.intp]:
    """Indices of samples whose stamps ascend: unreadable and repeated ones dropped, strays sorted, restarts cut."""
    keep = np.flatnonzero(np.isfinite(time))
    if len(keep) < len(time):
        notes.append(f"{whose} has {len(time) - len(keep)} unreadable time stamps, dropped")
    back = np.flatnonzero(np.diff(time[keep]) < 0)
    if len(back):
        order = keep[np.argsort(time[keep], kind="stable")]
        moved = int(np.max(np.abs(np.argsort(order, kind="stable") - np.arange(len(order)))))
        if moved <= max(10, len(keep) // 1000):
            notes.append(f"{whose} runs backward {len(back)} times, by at most {moved} samples, sorted")
            keep = order
        else:  # the clock restarts: two runs in one file cannot be told to be one
            pieces = np.split(keep, back + 1)
            longest = max(pieces, key=len)
            notes.append(
                f"{whose} restarts {len(back)} times (first at {time[keep[back[0]]]:g} s); the longest piece is used, "
                f"{time[longest[0]]:g} to {time[longest[-1]]:g} s, "
                f"and {len(keep) - len(longest)} of {len(keep)} samples are not"
            )
            keep = longest
    fresh = np.concatenate([[True], np.diff(time[keep]) > 0]) if len(keep) else np.zeros(0, dtype=bool)
    if not fresh.all():
        notes.append(f"{whose} repeats {int((~fresh).sum())} time stamps, the first sample of each is used")
    return keep[fresh]


def resample(
    name: str, time: NDArray[np.float64], values: NDArray[np.float64], clock: NDArray[np.float64], notes: list[str]
) -> NDArray[np.float64]:
    """Values on the regular clock, linear in between; NaN where the recording has a gap or no value."""
    step = clock[1] - clock[0]
    valid = np.isfinite(values)
    if not valid.any():
        notes.append(f"{name} has no values")
        return np.full(len(clock), np.nan)
    if not valid.all():
        notes.append(f"{name} has no value in {int((~valid).sum())} of {len(values)} samples, left out")
    t, x = time[valid], values[valid]
    inside = np.clip(np.searchsorted(t, clock, side="right") - 1, 0, max(len(t) - 2, 0))
    nearest = np.where(
        np.abs(t[inside] - clock) <= np.abs(t[np.minimum(inside + 1, len(t) - 1)] - clock),
        inside,
        np.minimum(inside + 1, len(t) - 1),
    )
    miss = np.abs(t[nearest] - clock)
    own = float(np.median(np.diff(t))) if len(t) > 1 else step
    between = np.interp(clock, t, x)
    series = np.where(miss <= JITTER * step, x[nearest], between)
    # a gap: further apart than the channel's own steps, and not a sample of the channel itself
    width = np.diff(t)[inside] if len(t) > 1 else np.zeros(len(clock))
    lost = (
        (miss > JITTER * step) & (width > GAP * max(own, step))
        | (clock < t[0] - JITTER * step)
        | (clock > t[-1] + JITTER * step)
    )
    between_two = (miss > JITTER * step) & ~lost
    singly = between_two & (width > (GAP - 1) * max(own, step))
    moved = between_two & ~singly
    if singly.any():
        notes.append(f"{name}: {int(singly.sum())} of {len(clock)} samples are missing singly, bridged")
    if moved.any():
        notes.append(
            f"{name}: {int(moved.sum())} of {len(clock)} samples are off the regular clock of {step:g} s "
            f"(by up to {miss[moved].max():.2g} s), interpolated"
        )
    if lost.any():
        gaps = int(np.sum(np.diff(np.concatenate([[0], lost.astype(int)])) == 1))
        notes.append(
            f"{name}: {gaps} gaps, {int(lost.sum())} of {len(clock)} samples, first at {clock[np.argmax(lost)]:g} s"
        )
    return np.where(lost, np.nan, series)


def without_wild(x: NDArray[np.float64], measured: bool = False) -> tuple[NDArray[np.float64], int, str]:
    """The series with NaN (not recorded) for wild samples, (n,), and what was taken out: how many, and in words.

    Samples that no machine makes, a bit that fell over on the way: one of them outweighs all others in a fit. Told by a
    running median (Hampel 1974, J. Am. Stat. Assoc. 69(346)), since that of five follows whatever lasts for three.
    measured: not commanded; then a few single samples, too, that stand out alone.
    """
    known = np.flatnonzero(np.isfinite(x))
    if len(known) < LEAST:
        return x, 0, ""
    y = x[known]
    low, high = np.quantile(y, [0.005, 0.995])
    wild = known[np.abs(y - median_filter(y, MEDIAN, mode="nearest")) > FAR * (high - low)]
    where = f"far outside, first {{:.4g}} among {low:.4g} to {high:.4g}"
    if measured and high > low and not len(wild) and len(at := alone(y, high - low)):
        wild, where = known[at], f"apart from those before and after, first {{:.4g}} after {y[at[0] - 1]:.4g}"
    if high <= low or not len(wild):
        return x, 0, ""
    left = x.copy()
    left[wild] = np.nan
    count = "1 sample lies" if len(wild) == 1 else f"{len(wild)} samples lie"
    return left, len(wild), f"{count} {where.format(x[wild[0]])}: taken as not recorded"


def alone(y: NDArray[np.float64], reach: float) -> NDArray[np.intp]:
    """Which single samples, a few at most, depart from the mean of both neighbours by far more than any other does, and
    by much of what the signal goes through, while the neighbours agree: an impact or an edge goes on."""
    apart = np.zeros(len(y))
    apart[1:-1] = np.abs(y[1:-1] - (y[:-2] + y[2:]) / 2)
    agree = np.zeros(len(y), dtype=bool)
    agree[1:-1] = np.abs(y[2:] - y[:-2]) < apart[1:-1] / SPIKE
    others, found = apart.copy(), list[int]()
    for _ in range(SPIKES):
        k = int(np.argmax(others))
        if not agree[k] or apart[k] < ALONE * reach:
            break
        found.append(k)
        others[max(k - 1, 0) : k + 2] = 0.0  # what its neighbours depart by is its own
        if apart[k] > SPIKE * others.max():
            return np.array(sorted(found), dtype=np.intp)
    return np.array([], dtype=np.intp)


def unwrapped(x: NDArray[np.float64], turn: float) -> tuple[NDArray[np.float64], int]:
    """An angle that begins anew after every turn, as a single-turn encoder's, going on instead, (n,), and how often it
    began anew; 0: it stays within no turn, or what jumps is something else."""
    known = np.flatnonzero(np.isfinite(x))
    steps = np.diff(x[known])
    jumps = np.abs(steps) > turn / 2
    if not jumps.any() or np.ptp(x[known]) > (1 + WHOLE) * turn:
        return x, 0
    usual = float(np.quantile(np.abs(steps[~jumps]), 0.999)) if (~jumps).any() else 0.0
    beyond = np.abs(np.abs(steps[jumps]) - turn)
    if np.any(beyond > max(3 * usual, WHOLE * turn)):
        return x, 0
    on = x.copy()
    on[known] = np.unwrap(x[known], period=turn)
    return on, int(jumps.sum())


def fill(
    path: Path, name: str, time: NDArray[np.float64], series: NDArray[np.float64], notes: list[str]
) -> NDArray[np.float64]:
    """An input must be known throughout: bridged in a straight line where it was not recorded."""
    lost = ~np.isfinite(series)
    if lost.mean() > 0.5:
        raise UserError(
            f"{path}: input {name!r} is recorded {100 * (1 - lost.mean()):.0f} % of the time, half at least is needed"
        )
    if lost.any():
        notes.append(
            f"{name} drives the system: {int(lost.sum())} samples that were not recorded are bridged in a straight line"
        )
        series = np.interp(time, time[~lost], series[~lost])
    return series


def windowed(log: Log, window: tuple[float | None, float | None], late: Mapping[str, float]) -> list[Channel]:
    """Channels with the stamps of late ones put right, cut to the window; those that share a clock go on sharing it."""
    shifts = {name if name in log.names else split_header(name)[0]: shift for name, shift in late.items()}
    begin, end = (-np.inf if window[0] is None else window[0]), (np.inf if window[1] is None else window[1])
    clocks: dict[tuple[int, float], tuple[NDArray[np.float64], NDArray[np.bool_]]] = {}
    found = []
    for channel in log.channels:
        shift = shifts.pop(channel.name, 0.0)
        key = (id(channel.time), shift)
        if key not in clocks:
            time = channel.time - shift
            inside = ~((time < begin) | (time > end))
            if len(time) and not inside.any():
                low, high = np.nanmin(time), np.nanmax(time)
                raise UserError(
                    f"{log.path}: begin = {begin:g}, end = {end:g} s is given, the clock runs {low:g} to {high:g} s"
                )
            clocks[key] = (time[inside], inside)
        time, inside = clocks[key]
        found.append(replace(channel, time=time, values=channel.values[inside]))
    if shifts:
        raise UserError(f"{log.path}: late: column {next(iter(shifts))!r} is given, {among(log.names)} are there")
    return found
