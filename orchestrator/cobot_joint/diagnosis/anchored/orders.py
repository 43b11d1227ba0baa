"""Orders of a wave as the innovations show them, which may be beyond those that its unit scans."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cobot_joint.diagnosis.estimation.order_spectrum import order_spectrum, whole_orders
from cobot_joint.diagnosis.plant.plant import ANY_ORDER, Port, ScannedShape, TermCandidate
from cobot_joint.diagnosis.state_estimation.evidence import Tracking, combinations

FEW = 3  # orders, of those that stand out


@dataclass(frozen=True)
class _Rows:
    """Of one channel of one recording, in what is asked for orders."""

    recording: int
    rows: slice


@dataclass(frozen=True)
class _Innovations:
    blocks: Sequence[_Rows]


def clearest_orders(
    term: TermCandidate, trackings: Sequence[Tracking], ports: Sequence[Port], e: Sequence[NDArray[np.float64]]
) -> list[dict[str, float]]:
    """Shapes of a wave that may have many orders: those that stand out most, up to what the samples resolve, or inside
    the range that a campaign gives. e: per recording, innovations (n, channels)."""
    shape = next((s for s in term.shapes if s.whole and len(s.values) >= ANY_ORDER), None)
    if term.angle is None or shape is None:
        return []
    angles = list(dict.fromkeys(angle for port in ports for angle in port.angles))
    signals = [{a: phi for a in angles if (phi := _followed(t, a)) is not None} for t in trackings]
    orders = list(shape.values) if shape.given else whole_orders(signals, angles).get(term.angle, [])
    ends = np.cumsum([0, *(channel.size for one in e for channel in one.T)])
    owners = [n for n, one in enumerate(e) for _ in one.T]
    blocks = [_Rows(n, slice(int(ends[k]), int(ends[k + 1]))) for k, n in enumerate(owners)]
    residual = np.concatenate([one.T.ravel() for one in e])
    power, _ = order_spectrum(_Innovations(blocks), residual, term.angle, signals, orders)
    clearest = [orders[k] for k in np.argsort(-power)[:FEW] if power[k] > 0]
    return [{**others, shape.name: n} for n in clearest for others in combinations(_without(term, shape))]


def _without(term: TermCandidate, shape: ScannedShape) -> TermCandidate:
    return replace(term, shapes=tuple(s for s in term.shapes if s is not shape))


def _followed(t: Tracking, angle: str) -> NDArray[np.float64] | None:
    """The angle in the motion that the filter followed; None: the recording has no such shaft."""
    here = any(c.name == angle.split(".")[0] for c in t.estimator.sampled.system.components)
    return t.estimator.sampled.own_signal(angle, t.tracked.signals) if here else None
