"""Logs that begin while the machine turns: where they begin is theirs, and no effect."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.orchestrator.diagnosis.test_newcomers import as_drafted, held
from tests.orchestrator.diagnosis.typed import Done

WHEEL = {"load.J": "1.6e-3 kg m2", "load.friction.tau_C": "0.9 mN.m", "load.friction.d": "4e-6 N.m.s/rad"}


def spun(folder: Path, name: str, w: float, seed: int, *, c: float = 0.0, driven: float = 1.0) -> None:
    """A reaction wheel at 4 Hz, J dw/dt = tau - d w - c w |w| - tau_C sgn(w), by the clock of its day."""
    J, tau_C, d, h, every = 1.6e-3, 0.9e-3, 4e-6, 0.01, 25
    rng = np.random.default_rng(seed)
    rows = ["UTC,TorqueCmd_mNm,WheelSpeed_rpm" if driven else "UTC,WheelSpeed_rpm"]
    for k in range(600 * 4):
        t = 0.25 * k
        tau = driven * float(f"{3e-3 * np.sin(2 * np.pi * t / 150 + seed):.7f}")
        stamp = f"2024-05-01T{23 + k // 14400:02d}:{int(t) // 60:02d}:{t % 60:05.2f}Z"
        torque = f"{1e3 * tau:.4f}," if driven else ""
        rows.append(f"{stamp},{torque}{(w + 0.02 * rng.standard_normal()) * 30 / np.pi:.2f}")
        for _ in range(every):
            w = held(w, w + h * (tau - d * w - c * w * abs(w)) / J, h * tau_C / J)
    (folder / name).write_text("\n".join(rows))


def test_a_wheel_that_is_logged_from_a_speed_on_lacks_nothing(tmp_path: Path, cobot_joint: Callable[..., Done]) -> None:
    """Simulated from rest it was 500 times its noise off; from one noisy sample it warmed up, 45 % sure."""
    for seed, w in enumerate((60.0, -40.0, 0.0)):
        spun(tmp_path, f"{seed}.csv", w, seed)
    words = [word for name, value in WHEEL.items() for word in ("--set", f"{name}={value}")]
    assert cobot_joint("new", "--chain", "load", *words, "--out", "machine").returncode == 0
    assert (
        cobot_joint("inspect", "0.csv", "1.csv", "2.csv", "--system", "machine/system.ssd", "--out", "f").returncode
        == 0
    )
    draft = Path("f/campaign.toml").read_text()
    assert '"load.x_w" = "first sample of w_load"' in draft
    Path("f/campaign.toml").write_text(
        draft.replace('"TorqueCmd_mNm [mN.m]" = "tau"', '"TorqueCmd_mNm [mN.m]" = { to = "tau", hold = true }')
    )
    done = cobot_joint("diagnose", "f/campaign.toml", "--out", "answer")
    assert done.returncode == 0, done.stderr
    assert "Nothing is missing: inside its tolerances the system explains" in done.stdout
    assert "next: Nothing has to be added." in done.stdout


def test_a_rotor_that_coasts_tells_its_windage(tmp_path: Path, cobot_joint: Callable[..., Done]) -> None:
    for seed, w in enumerate((310.0, 220.0, 280.0)):
        spun(tmp_path, f"{seed}.csv", w, seed, c=3e-8, driven=0.0)
    answer = as_drafted(cobot_joint, "load", WHEEL, ["0.csv", "1.csv", "2.csv"])
    (finding,) = answer["findings"]
    assert finding["term"] == "load.windage"
    # the inertia is known to 10 %, and without a torque no better: had been to 0.7 %, which left the true values out
    c, J = finding["parameters"]["c"], answer["repaired"]["load.body.J"]
    assert c["value"] == pytest.approx(3e-8, rel=0.12)
    for found, true in ((c, 3e-8), (J, 1.6e-3)):
        low, high = found["ci95"]
        assert low < true < high
        assert 0.1 * true < high - low < 0.6 * true
    rms = answer["channels"]["w_load"]["holdout"]
    assert rms["repaired"] < 1.1 * answer["channels"]["w_load"]["noise"] < rms["calibrated"]
