"""What no model explains, as a signal: where it enters, how large it is, and what it depends on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cobot_joint.diagnosis.plant.plant import Port
from cobot_joint.diagnosis.state_estimation.estimator import Tracked
from cobot_joint.diagnosis.state_estimation.evidence import POINTS, Evidence, Tracking

Array = NDArray[np.float64]
BINS = 24  # of a curve over a variable
BLOCK = 0.5  # s that count as one independent look
LEAST = 20  # samples of a bin
VARIABLES = {"rad/s": "w", "m/s": "w", "rad": "phi", "m": "phi", "N.m": "load", "N": "load", "A": "load"}
ORDERS = 48.0  # periods per turn that an order spectrum goes up to, or as far as the sampling resolves
NYQUIST = 0.8 * np.pi  # rad per sample
TURNING, SLOW = (
    1e-3,
    0.05,
)  # of its highest speed, at which a shaft turns; share of the samples that an order is seen in
SHARPEST = 0.02  # periods per turn between two orders of a spectrum, at least
PEAKS = 3  # orders whose amplitudes are estimated


@dataclass(frozen=True)
class Curve:
    """The latent signal over a variable: bins' middles, means in them and their 1 sigma, all (bins,).

    share: of its variance that the means make out, less what as many bins of noise would; signal: `component.variable`
    or "time".
    """

    variable: str
    signal: str
    middle: Array
    mean: Array
    sigma: Array
    share: float


@dataclass(frozen=True)
class Peak:
    """A period over an angle: order per turn, amplitude and its 1 sigma in the port's unit, not smoothed away."""

    order: float
    amplitude: float
    sigma: float


@dataclass(frozen=True)
class Spectrum:
    """Of the smoothed signal over a shaft's angle: orders per turn and amplitudes, (orders,). peaks: the largest."""

    signal: str
    orders: Array
    amplitude: Array
    peaks: tuple[Peak, ...]


@dataclass(frozen=True)
class PortDiscrepancy:
    """A latent force of one recording. time: s, d and its 1 sigma: (n,), in the unit; alike: ports it may be at, too.

    rms, ci95: of the signal behind `d`, noise not counted. seen: share of what it might have been that the recording
    decides; near 0, `d` says nothing. curves: most telling variable first; spectra: one per angle of the unit.
    """

    recording: str
    port: str
    unit: str
    alike: tuple[str, ...]
    time: Array
    d: Array
    sigma: Array
    rms: float
    ci95: tuple[float, float]
    seen: float
    curves: tuple[Curve, ...]
    spectra: tuple[Spectrum, ...]

    def to_json(self) -> dict[str, Any]:
        """As an entry of diagnosis.json's `discrepancy`."""
        return {"port": self.port, "variable": self.curves[0].variable, "rms": self.rms, "ci95": list(self.ci95),
                "unit": self.unit, "recording": self.recording, "equivalent": list(self.alike)}  # fmt: skip


def discrepancies(
    tracking: Tracking, ports: Sequence[Port], alike: Mapping[str, tuple[str, ...]]
) -> list[PortDiscrepancy]:
    """Of one recording, one per latent, in the filter's order. ports: of the plant; alike: as in `Structure`."""
    estimator, tracked = tracking.estimator, tracking.tracked
    smoothed = estimator.smooth(tracked)
    evidence = Evidence([tracking], {})
    by_name = {port.name: port for port in ports}
    found = []
    for j, latent in enumerate(estimator.latents):
        d, sigma, port = smoothed.d[:, j], smoothed.d_sigma[:, j], by_name[latent.port]
        rms, ci95 = _size(d, sigma, tracked)
        curves = [_over_time(d, tracked)]
        for name in port.signals:
            if (x := estimator.sampled.own_signal(name, tracked.signals)) is not None and name not in port.angles:
                curves.append(_over(d, x, VARIABLES.get(_unit(estimator.sampled.system, name), "load"), name, tracked))
        spectra = [
            _spectrum(evidence, latent.port, latent.tau, d, x, name)
            for name in port.angles
            if (x := estimator.sampled.own_signal(name, tracked.signals)) is not None
        ]
        curves += [
            _over(d, np.mod(x, 2 * np.pi), "phi", name, tracked)
            for name in port.angles
            if (x := estimator.sampled.own_signal(name, tracked.signals)) is not None
        ]
        curves.sort(key=lambda curve: -curve.share)
        found.append(
            PortDiscrepancy(
                tracked.recording.name, latent.port, port.unit, alike.get(latent.port, ()), tracked.time, d, sigma, rms,
                ci95, float(np.mean(1 - np.minimum(sigma / latent.sigma, 1) ** 2)), tuple(curves), tuple(spectra),
            )
        )  # fmt: skip
    return found


def _size(d: Array, sigma: Array, tracked: Tracked) -> tuple[float, tuple[float, float]]:
    """Root mean square, given all samples, and its 95 % interval from the scatter between blocks."""
    blocks = _blocks(len(d), tracked)
    means = np.array([np.mean(d[b] ** 2 + sigma[b] ** 2) for b in blocks])
    middle, error = float(np.mean(means)), float(np.std(means, ddof=1) / np.sqrt(len(means))) if len(means) > 1 else 0.0
    low, high = max(middle - 1.96 * error, 0.0), middle + 1.96 * error
    return float(np.sqrt(middle)), (float(np.sqrt(low)), float(np.sqrt(high)))


def _over_time(d: Array, tracked: Tracked) -> Curve:
    return _over(d, tracked.time, "time", "time", tracked)


def _over(d: Array, x: Array, variable: str, name: str, tracked: Tracked) -> Curve:
    """Means in bins; their scatter from means over blocks of time, since neighbours say the same."""
    edges = np.linspace(x.min(), x.max() + 1e-12, BINS + 1)
    which = np.clip(np.digitize(x, edges) - 1, 0, BINS - 1)
    block = np.concatenate([np.full(b.stop - b.start, k) for k, b in enumerate(_blocks(len(d), tracked))])
    middle, mean, sigma = [], [], []
    explained, looks = 0.0, 0
    for k in range(BINS):
        inside = which == k
        if inside.sum() < LEAST:
            continue
        of_blocks = [np.mean(d[inside & (block == b)]) for b in np.unique(block[inside])]
        middle.append((edges[k] + edges[k + 1]) / 2)
        mean.append(float(np.mean(d[inside])))
        spread = np.std(of_blocks, ddof=1) if len(of_blocks) > 1 else np.std(d)
        sigma.append(float(spread / np.sqrt(len(of_blocks))))
        explained += inside.sum() * (mean[-1] - d.mean()) ** 2
        looks += 1
    total, independent = float(np.sum((d - d.mean()) ** 2)), max(int(block.max()) + 1, looks + 1)
    share = explained / total if total else 0.0
    share = 1 - (1 - share) * (independent - 1) / max(independent - looks, 1)  # as many bins of noise explain some, too
    return Curve(variable, name, np.array(middle), np.array(mean), np.array(sigma), float(np.clip(share, 0, 1)))


def _spectrum(evidence: Evidence, port: str, tau: float, d: Array, phi: Array, name: str) -> Spectrum:
    """Orders from once per turn on: what is slower is not told from a change over time or speed.

    A sample counts by the angle that it turns, so that standstill says nothing, less where the signal of that order is
    quicker than the latent's tau, s, and the smoother has taken it away, and not where it is beyond the sampling. The
    peaks' amplitudes are fitted to the recording.
    """
    step = evidence.trackings[0].tracked.recording.step
    moving = np.abs(np.gradient(phi))
    turns = float(np.ptp(phi)) / (2 * np.pi)
    turning = moving[moving > moving.max(initial=0.0) * TURNING]
    top = min(ORDERS, NYQUIST / float(np.quantile(turning, SLOW))) if len(turning) else 0.0
    spacing = max(SHARPEST, 0.5 / max(turns, 1e-9))
    orders = 1 + np.arange(max(int((top - 1) / spacing) + 1, 0)) * spacing
    amplitude = np.empty(len(orders))
    for k, n in enumerate(orders):
        weight = np.where(n * moving < NYQUIST, moving / (1 + (n * moving / step * tau) ** 2), 0.0)
        weight /= max(float(weight.sum()), 1e-300)
        amplitude[k] = 2 * abs(np.sum(weight * (d - np.sum(weight * d)) * np.exp(-1j * n * phi)))
    peaks: list[Peak] = []
    left = amplitude.copy()
    while len(peaks) < PEAKS and left.max(initial=0.0) > 0:
        n = float(orders[np.argmax(left)])
        left[np.abs(orders - n) < max(3 / max(turns, 1e-9), 3 * spacing)] = 0
        peaks.append(_peak(evidence, port, phi, n))
    return Spectrum(
        name, np.asarray(orders, dtype=np.float64), amplitude, tuple(sorted(peaks, key=lambda p: -abs(p.amplitude)))
    )


def _peak(evidence: Evidence, port: str, phi: Array, order: float) -> Peak:
    share = (np.arange(POINTS) + 0.5) / POINTS
    between = (phi[:-1, None] + share * np.diff(phi)[:, None]).ravel()
    waves = np.column_stack([np.sin(order * between), np.cos(order * between)])
    theta, covariance, _ = evidence.gls(evidence.signal(port, [waves]))[0]
    return Peak(order, float(np.hypot(*theta)), float(np.sqrt(np.trace(covariance) / 2)))


def _blocks(n: int, tracked: Tracked) -> list[slice]:
    length = max(1, round(BLOCK / tracked.recording.step))
    return [slice(k, min(k + length, n)) for k in range(0, n, length)]


def _unit(system: Any, name: str) -> str:
    component, variable = name.split(".", 1)
    return system.component(component).unit.unit_of(variable) or ""
