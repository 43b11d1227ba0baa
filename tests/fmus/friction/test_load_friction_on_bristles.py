"""Load friction and presliding together, against the bristle's closed form."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from fmpy import simulate_fmu


@pytest.mark.parametrize("share", [0.0, 0.4, 1.0])
def test_load_friction_builds_up_with_the_way_for_the_share_that_bristles_carry(
    fmu: Callable[[str], Path], share: float
) -> None:
    mu, N, tau_g, w, phi_s = 0.1, 9.0, 5.0, 0.5, 0.2
    start = {
        "ratio.N": N,
        "mesh.eta": 1.0,
        "mesh.b": 0.0,
        "mesh.c": 100.0,
        "mesh.d_g": 0.0,
        "output.J_o": 1e3,  # the output stays where it is
        "friction.tau_C": 0.0,
        "friction.d": 0.0,
        "friction.w_C": 1e-3,
        "load_friction.mu": mu,
        "presliding.share": share,
        "presliding.phi_s": phi_s,
        "phi": N * tau_g / 100.0,
        "w": w,
        "tau_s": tau_g,
    }
    out = simulate_fmu(str(fmu("planetary_gear")), stop_time=1.0, output_interval=0.01, start_values=start)
    out = out[1:]  # the flanks touch in the first step
    z = 1 - np.exp(-w * out["time"] / phi_s)  # dz/dt = (w - |w| z)/phi_s
    loss = out["tau"] - out["tau_g"] / N
    np.testing.assert_allclose(loss, mu * tau_g / N * (1 - share + share * z), rtol=1e-3)
