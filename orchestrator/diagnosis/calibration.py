"""How often the score test is wrong, over noise colour and effect size, counted on healthy and faulty draws.

    python -m orchestrator.diagnosis.calibration CAMPAIGN.toml [--healthy 400] [--faulty 200] [--seed 0]

The campaign lends its inputs, channels and tolerances; its outputs are not used. Healthy runs are simulated once, with
parameters drawn inside the tolerances; every draw adds noise of another colour, rounded to the converter's step, and
what `condition` estimates from that recording whitens it: so errors of that estimate count. Effects are added in their
linear response, as large as the size asked for (root of the chi-square that a re-fit leaves). The tables are Markdown.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.signal import lfilter

from orchestrator.diagnosis.campaign import Campaign, load_campaign
from orchestrator.diagnosis.engine import noises
from orchestrator.diagnosis.fit import Fit, Hypothesis, difference, tolerances
from orchestrator.diagnosis.fmus import FmuPlant
from orchestrator.diagnosis.name import EVIDENCE
from orchestrator.diagnosis.plant import Plant, Signals
from orchestrator.diagnosis.problem import Noise, Problem, Vector
from orchestrator.diagnosis.scan import Column, Scan, ScoreTest
from orchestrator.system.read import load_system

COLOURS = (0.0, 0.3, 0.5, 0.8)  # of the torque channel; the others are white
SIZES = (5.0, 10.0, 20.0, 40.0, 80.0, 160.0)  # root of the chi-square that the re-fit leaves of the effect
COARSE, WHITE = (
    0.02,
    0.1,
)  # estimated colours are rounded, small ones to none: whitened sensitivities are kept by colour


@dataclass(frozen=True)
class Draw:
    """One campaign that was never recorded: what the score test says of it."""

    colour: float
    truth: str | None
    size: float
    gain: float  # of the leading term
    leader: str
    second: float


class Bench:
    """A system at drawn parameters, its sensitivities, and noise by the draw."""

    def __init__(self, campaign: Campaign, plant: Plant, rng: np.random.Generator) -> None:
        self.campaign, self.plant, self.rng = campaign, plant, rng
        clean = {name: Noise(*_noise(campaign, name)) for name in campaign.outputs}
        self.problem = Problem(plant, campaign.train, clean)
        bounds = {name: t.bounds(plant.parameters[name].nominal) for name, t in campaign.tolerances.items()}
        hypothesis = Hypothesis(tolerances(self.problem, bounds))
        x = np.clip(rng.normal(0, 0.5, len(hypothesis.coordinates)), -1, 1)
        base = self.problem.simulate([hypothesis.run(x)])[0]
        if base is None:
            raise RuntimeError("the system cannot be simulated at the parameters drawn")
        self.outputs = base.outputs
        # raw sensitivities: whitening with unit, white noise divides by 1
        self.raw = Problem(plant, campaign.train, {name: Noise(1.0) for name in campaign.outputs})
        raw_base = self.raw.simulate([hypothesis.run(x)])[0]
        assert raw_base is not None
        raw_J = difference(self.raw, hypothesis, x, raw_base)
        assert raw_J is not None
        self.at = Fit(hypothesis, x, 0.0, self.problem.recorded - base.white, base, raw_J, True, 0)
        raw_fit = replace(self.at, residual=np.zeros(self.raw.rows), simulated=raw_base, jacobian=raw_J)
        self.scan = Scan(self.raw, plant.terms)
        self.scan.probe = Scan(self.problem, plant.terms).probes(self.at)
        self.columns = self.scan.columns(raw_fit)
        self.raw_J = raw_J
        self._tests: dict[tuple[float, ...], tuple[Problem, ScoreTest]] = {}

    def draw(self, colour: float, column: Column | None = None, size: float = 0.0) -> Draw:
        """One campaign: noise of that colour, and, if a column is given, its effect in that size."""
        effect = np.zeros(self.raw.rows)
        if column is not None:
            turn = self.rng.normal(size=len(column.vectors))
            effect = np.sum([t * v for t, v in zip(turn, column.vectors, strict=True)], axis=0)
            effect *= self.rng.choice([-1.0, 1.0]) if column.term.lower < 0 or column.term.phase else np.sign(turn[0])
            problem, test = self._test(
                {name: Noise(*_noise(self.campaign, name, colour)) for name in self.campaign.outputs}
            )
            effect *= size / max(_left(problem, test, self._white(problem, effect)), 1e-12)
        recorded = self._noisy(colour, effect)
        seen = replace(
            self.campaign,
            recordings=[replace(r, outputs=o) for r, o in zip(self.campaign.train, recorded, strict=True)],
        )
        problem, test = self._test(noises(seen))
        residual = problem.whiten(recorded) - problem.whiten(self.outputs)
        ranked = test.rank(residual)
        return Draw(
            colour, column.term.name if column else None, size, ranked[0].gain, ranked[0].term.name, ranked[1].gain
        )

    def _noisy(self, colour: float, effect: Vector) -> list[Signals]:
        recorded: list[Signals] = [{} for _ in self.outputs]
        for block in self.raw.blocks:
            sigma, rho, step = _noise(self.campaign, block.channel, colour)
            white = np.sqrt(max(sigma**2 - step**2 / 12, 0.0))
            n = block.rows.stop - block.rows.start
            y = self.outputs[block.recording][block.channel] + effect[block.rows]
            y = y + lfilter([np.sqrt(1 - rho**2)], [1, -rho], self.rng.normal(0, white, n))
            recorded[block.recording][block.channel] = step * np.round(y / step) if step else y
        return recorded

    def _test(self, noise: Mapping[str, Noise]) -> tuple[Problem, ScoreTest]:
        """The score test whitened with noise of these colours, rounded: few are made."""
        colours = {n: 0.0 if v.colour < WHITE else COARSE * round(v.colour / COARSE) for n, v in noise.items()}
        kept = {n: Noise(_noise(self.campaign, n)[0], colours[n], v.step) for n, v in noise.items()}
        key = tuple(v.colour for v in kept.values())
        if key not in self._tests:
            problem = Problem(self.plant, self.campaign.train, kept)
            columns = [replace(c, vectors=tuple(self._white(problem, v) for v in c.vectors)) for c in self.columns]
            J = np.column_stack([self._white(problem, v) for v in self.raw_J.T])
            self._tests[key] = (
                problem,
                ScoreTest(problem, replace(self.at, jacobian=J, x=np.zeros(J.shape[1])), columns),
            )
        return self._tests[key]

    def _white(self, problem: Problem, stacked: Vector) -> Vector:
        outputs: list[Signals] = [{} for _ in self.outputs]
        for block in self.raw.blocks:
            outputs[block.recording][block.channel] = stacked[block.rows]
        return problem.whiten(outputs)

    def alike(self, name: str) -> set[str]:
        """A term and its twin in another unit."""
        twins = self.scan.twins
        return {name, twins.get(name, name), *(t for t, leader in twins.items() if leader == name)}


def _noise(campaign: Campaign, name: str, colour: float = 0.0) -> tuple[float, float, float]:
    """(sigma with rounding, colour, step) of the logger; coloured is what is said to be: the torque."""
    logged = campaign.logged[name]
    step = logged.step or 0.0
    return float(np.hypot(logged.noise or 1.0, step / np.sqrt(12))), colour if logged.unit == "N.m" else 0.0, step


def _left(problem: Problem, test: ScoreTest, effect: Vector) -> float:
    """Root of the chi-square of an effect that the re-fit cannot hide."""
    J = np.vstack([part[:, : len(test.x)] for part in test.parts])
    order = np.concatenate(test.rows)
    rest = effect[order] - J @ np.linalg.lstsq(J, effect[order], rcond=1e-9)[0]
    return float(np.sqrt(rest @ rest))


def healthy(bench: Bench, count: int) -> Iterator[Draw]:
    """Nothing concealed."""
    for k in range(count):
        yield bench.draw(COLOURS[k % len(COLOURS)])


def faulty(bench: Bench, count: int) -> Iterator[Draw]:
    """A term, a size and a colour by the draw."""
    for k in range(count):
        column = bench.columns[bench.rng.integers(len(bench.columns))]
        yield bench.draw(float(bench.rng.choice(COLOURS)), column, SIZES[k % len(SIZES)])


def tables(bench: Bench, well: Sequence[Draw], ill: Sequence[Draw]) -> str:
    """Markdown."""
    lines = [
        "| colour | healthy draws | largest score, median | largest score, 99 % | above evidence |",
        "|---|---|---|---|---|",
    ]
    for colour in COLOURS:
        gains = np.array([d.gain for d in well if d.colour == colour])
        if len(gains):
            false = int(np.sum(gains > EVIDENCE))
            lines.append(
                f"| {colour} | {len(gains)} | {np.median(gains):.1f} | {np.quantile(gains, 0.99):.1f} | {false} |"
            )
    lines += [
        "",
        "| size | draws | above evidence | named at first rank | term or twin at first rank, of those above evidence |",
        "|---|---|---|---|---|",
    ]
    for size in SIZES:
        draws = [d for d in ill if d.size == size]
        seen = [d for d in draws if d.gain > EVIDENCE]
        right = [d for d in draws if d.truth and d.leader in bench.alike(d.truth)]
        both = [d for d in seen if d in right]
        if draws:
            lines.append(f"| {size:g} | {len(draws)} | {len(seen)} | {len(right)} | {len(both)} of {len(seen)} |")
    return "\n".join(lines)


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("campaign", type=Path)
    parser.add_argument("--healthy", type=int, default=400)
    parser.add_argument("--faulty", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    campaign = load_campaign(given.campaign, roles=("train",))
    rng = np.random.default_rng(given.seed)
    with FmuPlant({setup: load_system(path) for setup, path in campaign.setups.items()}) as plant:
        bench = Bench(campaign, plant, rng)
        well, ill = list(healthy(bench, given.healthy)), list(faulty(bench, given.faulty))
        print(f"seed {given.seed}, {len(plant.terms)} terms in {len(bench.columns)} shapes, evidence {EVIDENCE:g}\n")
        print(tables(bench, well, ill))


if __name__ == "__main__":
    main()
