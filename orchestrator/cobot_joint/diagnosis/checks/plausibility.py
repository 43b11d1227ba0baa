"""Checks before anything is fitted: each channel against itself, the other runs and the nominal system, in seconds."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cobot_joint.diagnosis.checks.beside_nominal import beside_nominal
from cobot_joint.diagnosis.checks.limits import beyond_limits
from cobot_joint.diagnosis.checks.starts import begin_elsewhere
from cobot_joint.diagnosis.checks.suspicions import suspicions
from cobot_joint.diagnosis.data.campaign import Campaign
from cobot_joint.diagnosis.data.recording import Recording
from cobot_joint.diagnosis.data.suspicion import Suspicion
from cobot_joint.diagnosis.plant.lost import lost
from cobot_joint.diagnosis.plant.simulator import Simulator
from cobot_joint.errors import UserError, among
from cobot_joint.system.wiring import driving

RATIO = ".ratio.N"  # how a gear's ratio is named in every unit that has one

MOVES = 0.01  # of what an output does in the recording, that it does by itself: an arm settles on its springs


def plausible(campaign: Campaign) -> list[Suspicion]:
    """What the training recordings say against their channels; kept in `campaign.suspicions`.

    UserError: a channel is read wrongly for all that can be seen (factor, sign, swapped); whoever knows better gives
    the column a scale or a sign in [channels]. Or a drive's limit holds the simulation, or nothing drives it.
    """
    systems = campaign.systems()
    ratios = {
        f"{c.name}{RATIO}": float(c.parameters.get(RATIO[1:], c.unit.variables[RATIO[1:]].start))
        for system in systems.values()
        for c in system.components
        if RATIO[1:] in c.unit.variables
    }
    runs = [r for r in campaign.train if not r.scatter]  # a table has no time to look at
    found = suspicions(runs)
    with Simulator(systems) as simulate:
        _driven(campaign, simulate)
        found += begin_elsewhere(runs, simulate, systems)
        found += beyond_limits(runs, simulate, systems)
        found += beside_nominal(runs, simulate, ratios)
        found += [] if any(s.wrong for s in found) else _lost(runs, simulate)
    campaign.suspicions = found
    for suspicion in found:
        if suspicion.wrong:
            raise UserError(f"{campaign.path}: {suspicion}")
    return found


def _lost(runs: Sequence[Recording], simulate: Simulator) -> list[Suspicion]:
    """Runs in which the nominal system goes its own way: a value of its data sheet is far off, or what holds it where
    it is lies in no column."""
    return [
        Suspicion(
            one.recording,
            one.channel,
            "lost",
            f"from {one.since:.3g} s on the free run with nominal values goes its own way, up to {one.off:.3g} "
            f"off where the recordings span {one.span:.3g}: a value of the data sheet may be far off (a mass, a ratio, "
            "a torque constant), or the motion is unstable there, as beyond the top; if so, drive the system with the "
            "recorded motion and compare the torque",
        )
        for one in lost(runs, [simulate(r) for r in runs])
    ]


def _driven(campaign: Campaign, simulate: Simulator) -> None:
    """UserError: no recording has an input, and nothing moves by itself; or where the system has an input of its own,
    nothing as it was recorded: a hoist without its voltage falls."""
    if any(r.inputs for r in campaign.train):
        return
    inputs = any(system.inputs for system in campaign.systems().values())
    for r in campaign.train:
        simulated = simulate(r)
        for n, y in r.outputs.items():
            moves = np.ptp(simulated[n]) > MOVES * np.nanmax(y) - MOVES * np.nanmin(y)
            follows = np.nanmean((simulated[n] - y) ** 2) < np.nanvar(y)
            if moves and (follows or not inputs):
                return
    systems = campaign.systems().values()
    offered = sorted({name for system in systems for name in system.inputs or driving(system)})
    raise UserError(
        f"{campaign.path}: no column drives the system, and by itself it does not move as recorded; one of its inputs "
        "is needed in [channels]: "
        f"{among(offered) if offered else 'it has none, `component.variable` names one of a component'}; "
        'a machine that coasts down has its speed in [initial], as "load.x_w" = "first sample of w_load"'
    )
