"""The fit's residual: recording - simulation, channels and recordings stacked, whitened with the noise's own colour."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter
from threadpoolctl import threadpool_limits

from cobot_joint.diagnosis import thresholds
from cobot_joint.diagnosis.budget import Budget
from cobot_joint.diagnosis.data.recording import Recording
from cobot_joint.diagnosis.estimation.noise import Gaps, Noise
from cobot_joint.diagnosis.plant.plant import Courses, Plant, Signals, SimulationError

Vector = NDArray[np.float64]
BLOCK = 16  # samples
STRETCHES = 16  # of a recording: of a second for one of 16 s, longer than what is left mostly remembers
FEW = 4  # recordings
ROUGH, SMOOTH = 0.15, 0.02  # impacts in a gap make single runs rough; amplitudes at a frequency are smooth


Key = tuple[frozenset[tuple[str, float]], frozenset[tuple[str, float]]]
Part = tuple[Signals, Vector]  # of one recording: outputs, and these whitened


@dataclass(frozen=True)
class Run:
    """What to simulate, in every recording of a problem."""

    values: Mapping[str, float] = field(default_factory=dict)
    onsets: Mapping[str, float] = field(default_factory=dict)
    added: Mapping[str, Mapping[str, Vector]] = field(default_factory=dict)  # recording -> port -> (n,)
    touches: tuple[str, ...] = ()  # components beside which nothing changes: recordings without them are not run again
    readings: Mapping[str, tuple[float, float]] = field(default_factory=dict)  # channel -> its log's gain and offset
    stamps: Mapping[str, tuple[float, float]] = field(default_factory=dict)  # channel -> s late, s per s that it grows
    courses: Mapping[str, Courses] = field(default_factory=dict)  # by recording

    def with_values(self, values: Mapping[str, float], onsets: Mapping[str, float] | None = None) -> Run:
        """The same with further parameters, and from which times on these hold."""
        return replace(self, values={**self.values, **values}, onsets={**self.onsets, **(onsets or {})})

    def with_signals(self, port: str, signals: Mapping[str, Vector]) -> Run:
        """The same with signals, recording -> (n,), on top of what enters at the port already."""
        added = {name: dict(ports) for name, ports in self.added.items()}
        for name, x in signals.items():
            there = added.setdefault(name, {})
            there[port] = there[port] + x if port in there else x
        return replace(self, added=added)

    def beside(self, *components: str) -> Run:
        """As a run that differs from a base only in these components."""
        return replace(self, touches=components)

    @property
    def is_plain(self) -> bool:
        """Whether its key tells all of it."""
        return not (self.added or self.readings or self.stamps or self.courses)

    @property
    def key(self) -> Key:
        """Same values and onsets, same run, where nothing else is added."""
        return frozenset(self.values.items()), frozenset(self.onsets.items())


@dataclass(frozen=True)
class Simulated:
    """Outputs per recording, and all of them stacked and whitened: (rows,)"""

    outputs: tuple[Signals, ...]
    white: Vector


@dataclass(frozen=True)
class Block:
    """Rows of the stacked residual that are one channel of one recording."""

    recording: int
    channel: str
    rows: slice
    weight: NDArray[np.float64]  # 0 where not recorded


def may_set_in(recordings: Sequence[Recording]) -> bool:
    """Whether an effect may set in at a time of the run: not at the same in each of many."""
    return len(recordings) <= FEW


def one_blas_thread() -> AbstractContextManager[object]:
    """Simulations fill the cores, and threads of BLAS spin while they wait for one."""
    return threadpool_limits(limits=1, user_api="blas")


class Problem:
    """Recordings to be explained by a plant.

    `whiten` is linear: differences of simulations are whitened the same way as residuals. Rows have unit variance when
    only noise is left. step: of difference quotients, in tolerances or amplitudes: as long as the simulation is rough.
    """

    def __init__(
        self,
        plant: Plant,
        recordings: Sequence[Recording],
        noise: Mapping[str, Noise],
        jobs: int = 2,
        step: float = ROUGH,
    ) -> None:
        self.plant = plant
        self.recordings = list(recordings)
        self.noise = dict(noise)
        self.jobs = jobs
        self.step = step
        self._runs = [0]  # which a part counts on
        self.watch: Callable[[int, int], None] | None = None  # told of simulations done, of how many asked for at once
        self.budget = Budget()
        self.may_set_in = True  # by the campaign
        self.drifting: Mapping[
            str, float
        ] = {}  # position -> what is left of it, times its noise: its drift counts less
        self._took = [0.0 for _ in self.recordings]  # s; that a simulation took the last time
        self.blocks: list[Block] = []
        self._of_recording: list[list[tuple[Block, Gaps]]] = [[] for _ in self.recordings]
        row = 0
        for number, recording in enumerate(self.recordings):
            for channel, recorded in recording.outputs.items():
                known = np.isfinite(recorded)
                rows = slice(row, row + len(recorded))
                self.blocks.append(Block(number, channel, rows, known.astype(float)))
                self._of_recording[number].append((self.blocks[-1], Gaps.of(known)))
                row = rows.stop
        self.rows = row
        self._strays = [
            _directions([self._white(n, stray) for stray in r.strays]) for n, r in enumerate(self.recordings)
        ]
        self.recorded = self.whiten([r.outputs for r in self.recordings])

    @property
    def runs(self) -> int:
        """Simulations so far, one per recording."""
        return self._runs[0]

    @property
    def samples(self) -> int:
        """Rows that carry data."""
        return int(sum(block.weight.sum() for block in self.blocks))

    def seen(self, rows: Vector) -> Vector:
        """What a fit sees of rows, (rows,) or (rows, k): all."""
        return rows

    @property
    def evidence(self) -> float:
        """Chi-square that a term must take."""
        return thresholds.EVIDENCE_IN_TABLE if self.is_table else thresholds.EVIDENCE

    @property
    def onsets(self) -> bool:
        """Whether an effect may set in at a time."""
        return self.may_set_in and may_set_in(self.recordings)

    @property
    def is_table(self) -> bool:
        """Whether rows are steady states, without a time that counts."""
        return all(recording.scatter for recording in self.recordings)

    def whiten(self, outputs: Sequence[Mapping[str, Vector]]) -> Vector:
        """Per recording, channel -> (n,): stacked as (rows,), divided by the innovation's sigma.

        In a gap stands what the noise's colour predicts from the sample before, recorded and simulated alike.
        """
        return np.concatenate([self.whiten_one(n, found) for n, found in enumerate(outputs)])

    def whiten_one(self, n: int, outputs: Mapping[str, Vector]) -> Vector:
        """Recording n's rows, less what it strays by because it does not begin quite where it is said to."""
        rows = self._white(n, outputs)
        if (strays := self._strays[n]) is None:
            return rows
        directions, shares = strays
        return rows - directions @ (shares * (directions.T @ rows))

    def _white(self, n: int, outputs: Mapping[str, Vector]) -> Vector:
        """Whitened by the noise alone."""
        parts = []
        for block, gaps in self._of_recording[n]:
            noise = self.noise[block.channel]
            rho, theta, sigma = noise.filter
            y = gaps.bridged(np.asarray(outputs[block.channel]), rho)
            white = lfilter([1.0, -rho], [1.0, theta], y) / sigma
            white[0] = y[0] / noise.sigma
            white[gaps.resumes] *= sigma / noise.sigma_after(1.0 + gaps.since[gaps.resumes - 1])
            parts.append(white * block.weight)
        return np.concatenate(parts)

    def simulate(
        self,
        runs: Sequence[Run],
        base: Simulated | None = None,
        only: Sequence[int | None] = (),
        known: Mapping[tuple[Key, int], Signals] | None = None,
    ) -> list[Simulated | None]:
        """Every run in every recording; None where a simulation failed.

        base: a run from which `runs` differ only in `touches`. only: with a base, per run the one recording that is
        simulated; the others stay as in the base. known: outputs of a run in a recording, simulated before.
        """
        jobs = [
            (k, n)
            for k, run in enumerate(runs)
            for n, recording in enumerate(self.recordings)
            if base is None or not run.touches or any(self.plant.has(t, recording) for t in run.touches)
            if not only or only[k] in (None, n)
        ]
        there: list[Part | None] = self._parts(base) if base else [None for _ in self.recordings]
        parts = [list(there) for _ in runs]
        keys, known = [run.key for run in runs] if known else [], known or {}
        for k, n in [job for job in jobs if known and (keys[job[0]], job[1]) in known]:
            found = known[keys[k], n]
            parts[k][n] = found, self.whiten_one(n, found)
            jobs.remove((k, n))
        jobs.sort(key=lambda job: -self._took[job[1]])  # what takes longest first, so that all end together
        with ThreadPoolExecutor(self.jobs) as pool:
            done = pool.map(lambda job: self._one(runs[job[0]], job[1]), jobs)
            for count, ((k, n), part) in enumerate(zip(jobs, done, strict=True), 1):
                parts[k][n] = part
                if self.watch:
                    self.watch(count, len(jobs))
        self._runs[0] += len(jobs)
        return [_complete(found) for found in parts]

    def _parts(self, whole: Simulated) -> list[Part | None]:
        begins = {block.recording: block.rows.start for block in reversed(self.blocks)}
        whites = np.split(whole.white, sorted(begins.values())[1:])
        return list(zip(whole.outputs, whites, strict=True))

    def outputs(self, run: Run, signals: Sequence[str] = ()) -> list[Signals]:
        """Per recording, outputs and `signals` of one run. Raises SimulationError."""
        with ThreadPoolExecutor(self.jobs) as pool:
            return list(pool.map(lambda n: self._simulate(run, n, signals), range(len(self.recordings))))

    def _one(self, run: Run, n: int) -> Part | None:
        """Whitened where it was simulated: beside the others."""
        self.budget.check()
        begun = time.perf_counter()
        try:
            found = self._simulate(run, n, ())
            return found, self.whiten_one(n, found)
        except SimulationError:
            return None
        finally:
            self._took[n] = time.perf_counter() - begun

    def _simulate(self, run: Run, n: int, signals: Sequence[str]) -> Signals:
        recording = _undone(self.recordings[n], run)
        there = {name: value for name, value in run.values.items() if self.plant.has(name, recording)}
        wanted = [name for name in signals if self.plant.has(name, recording)]
        added = {p: x for p, x in run.added.get(recording.name, {}).items() if self.plant.has(p, recording)}
        onsets = {name: t for name, t in run.onsets.items() if name in there}
        more = {"courses": courses} if (courses := run.courses.get(recording.name)) else {}
        found = self.plant.simulate(there, recording, onsets=onsets, added=added, signals=wanted, **more)
        if not all(np.isfinite(found[channel]).all() for channel in recording.outputs):
            raise SimulationError(f"{recording.name}: the simulation diverges")
        return _logged(found, recording, run)

    def excess_by_block(self, residual: Vector) -> list[Vector]:
        """Per block of rows: chi-square of means over `BLOCK` samples less its expectation, (n / BLOCK,).

        Slow structure stays in it, white noise goes; 1 sigma of an element that is recorded in full is sqrt(2) where
        only noise is left. What is not recorded adds nothing. residual: whitened, (rows,).
        """
        return [binned(residual[block.rows]) ** 2 / BLOCK - binned(block.weight) / BLOCK for block in self.blocks]

    def excess_times(self) -> list[Vector]:
        """Per block of rows: when its means begin, s, (n / BLOCK,)."""
        times = self.times()
        return [times[b.rows][: len(binned(b.weight)) * BLOCK : BLOCK] for b in self.blocks]

    def excess(self, residual: Vector) -> float:
        """`excess_by_block`, all of it."""
        return float(sum(part.sum() for part in self.excess_by_block(residual)))

    def above(self, residual: Vector) -> float:
        """Chi-square above noise, more than none: all of it, or `excess` where the noise that is said or estimated is
        larger than what is left."""
        return max(float(residual @ residual) - self.samples, self.excess(residual), 1e-9)

    @property
    def excess_scatter(self) -> float:
        """1 sigma of `excess` when only noise is left"""
        return float(np.sqrt(2 * sum(np.sum((binned(b.weight) / BLOCK) ** 2) for b in self.blocks)))

    def unexplained(self, residual: Vector) -> bool:
        """Whether more is left than noise leaves."""
        by_chance = thresholds.LEFT_SIGMA * np.sqrt(2 * self.samples)
        if float(residual @ residual) - self.samples > max(thresholds.LEFT_SHARE * self.samples, by_chance):
            return True
        return self.excess(residual) > thresholds.LEFT_SIGMA * self.excess_scatter

    def stands_out(self, residual: Vector) -> bool:
        """Whether what is left is, rms, so far above the noise that anyone would see it."""
        return self.above(residual) > thresholds.LEFT_SIGMA**2 * self.samples

    def stretches(self, residual: Vector) -> NDArray[np.intp] | None:
        """Of every row the number of its stretch, a `STRETCHES`th of a recording, all channels together: (rows,)

        Within one what is left may be correlated. None: no more is left than noise.
        """
        if not self.unexplained(residual):
            return None
        found = np.empty(self.rows, dtype=np.intp)
        for block in self.blocks:
            rows = block.rows.stop - block.rows.start
            found[block.rows] = STRETCHES * block.recording + np.arange(rows) * STRETCHES // rows
        return found

    def above_noise(self, residual: Vector) -> Vector:
        """Chi-square beyond the number of samples: (recordings,)"""
        above = np.zeros(len(self.recordings))
        for block in self.blocks:
            above[block.recording] += residual[block.rows] @ residual[block.rows] - block.weight.sum()
        return above

    def rows_of(self, recordings: Collection[int]) -> NDArray[np.intp]:
        """The rows that some recordings have, by number."""
        return np.concatenate([np.r_[b.rows] for b in self.blocks if b.recording in recordings])

    def part(self, recordings: Sequence[int]) -> Problem:
        """The same with some of the recordings, by number."""
        found = Problem(self.plant, [self.recordings[n] for n in recordings], self.noise, self.jobs, self.step)
        found.budget, found.watch, found._runs = self.budget, self.watch, self._runs
        found.may_set_in = self.may_set_in
        return found

    def times(self) -> Vector:
        """Time of every row since its run began, s: (rows,)"""
        stacked = np.empty(self.rows)
        for block in self.blocks:
            time = self.recordings[block.recording].time
            stacked[block.rows] = time - time[0]
        return stacked


def _directions(strays: Sequence[Vector]) -> tuple[Vector, Vector] | None:
    """Orthonormal directions of what one sigma of a start value makes of a recording, whitened, (rows, k), and what
    further whitening takes of each: of a covariance I + S S' with S = U s V' it is I - U (1 - 1/sqrt(1 + s^2)) U'. The
    same as start values that are fitted (Rasmussen, C. E., Williams, C. K. I. (2006), Gaussian Processes for Machine
    Learning, section 2.7). None: there is nothing of the kind."""
    if not strays:
        return None
    U, s, _ = np.linalg.svd(np.stack(strays, axis=1), full_matrices=False)
    return U, 1 - 1 / np.sqrt(1 + s**2)


def _complete(parts: Sequence[Part | None]) -> Simulated | None:
    found = [part for part in parts if part is not None]
    if len(found) < len(parts):
        return None
    return Simulated(tuple(outputs for outputs, _ in found), np.concatenate([white for _, white in found]))


def _undone(recording: Recording, run: Run) -> Recording:
    """With its inputs as they were, where these are recorded as gain*there + offset, or there(t - late - rate*t).

    Stairs that are stamped wrong jump between two samples: drawn as lines, half a sample behind (Franklin, G. F.,
    Powell, J. D., Workman, M. (1998), Digital Control of Dynamic Systems, 3rd ed., section 4.3).
    """
    inputs, t = dict(recording.inputs), recording.time - recording.time[0]
    for name, (gain, offset) in run.readings.items():
        if name in inputs:
            inputs[name] = (inputs[name] - offset) / gain
    for name, (late, rate) in run.stamps.items():
        if name in inputs:
            behind = recording.step / 2 if name in recording.held else 0.0
            inputs[name] = np.interp((t + late) / (1 - rate) - behind, t, inputs[name])
    held = recording.held - run.stamps.keys()
    return replace(recording, inputs=inputs, held=held) if run.readings or run.stamps else recording


def _logged(found: Signals, recording: Recording, run: Run) -> Signals:
    """With outputs as they are recorded."""
    t = recording.time - recording.time[0]
    read = {c: k * found[c] + b for c, (k, b) in run.readings.items() if c in recording.outputs}
    stamped = {
        c: np.interp(t - late - rate * t, t, read.get(c, found[c]))
        for c, (late, rate) in run.stamps.items()
        if c in recording.outputs
    }
    return {**found, **read, **stamped}


def binned(x: Vector) -> Vector:
    """Sums over `BLOCK` samples; a rest that fills no bin is left out: (len(x) // BLOCK,)"""
    return np.asarray(x[: len(x) // BLOCK * BLOCK].reshape(-1, BLOCK).sum(axis=1))
