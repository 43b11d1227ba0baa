"""The position loop alone, against closed forms."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fmpy import extract, read_model_description, simulate_fmu
from fmpy.fmi2 import FMU2Slave

Run = Callable[..., Any]
RECORD = ["u_c", "tau", "e_phi", "w_f", "x_v"]


@pytest.fixture(scope="module")
def run(fmu: Callable[[str], Path]) -> Run:
    """run(stop_time, **start values, dots written as two underscores) -> all outputs."""
    path = str(fmu("position_loop"))

    def simulate(stop_time: float = 0.1, **start: Any) -> Any:
        values = {name.replace("__", "."): value for name, value in start.items()}
        return simulate_fmu(path, stop_time=stop_time, output_interval=1e-3, start_values=values, output=RECORD)

    return simulate


def test_voltage_is_the_gains_times_position_and_speed_error(run: Run) -> None:
    out = run(phi_ref=0.3, phi=0.1, w=4.0, gains__k_p=50.0, gains__k_v=0.2)
    np.testing.assert_allclose(out["u_c"], 0.2 * (50.0 * 0.2 - 4.0), rtol=1e-12)
    np.testing.assert_allclose(out["e_phi"], 0.2, rtol=1e-12)


def test_speed_feedback_can_be_left_out(run: Run) -> None:
    out = run(phi_ref=0.3, w=4.0, gains__k_p=50.0, gains__k_v=0.2, gains__k_w=0.0)
    np.testing.assert_allclose(out["u_c"], 0.2 * 50.0 * 0.3, rtol=1e-12)


def test_wanted_speed_is_fed_forward(run: Run) -> None:
    out = run(phi_ref=0.3, w_ref=2.0, w=4.0, gains__k_p=50.0, gains__k_v=0.2, feedforward__k_ff=0.5)
    np.testing.assert_allclose(out["u_c"], 0.2 * (50.0 * 0.3 + 0.5 * 2.0 - 4.0), rtol=1e-12)


def test_position_integrator_adds_a_ramp_of_wanted_speed(run: Run) -> None:
    out = run(phi_ref=0.1, gains__k_p=50.0, gains__k_v=0.2, integrator__k_i=300.0)
    np.testing.assert_allclose(out["u_c"], 0.2 * (50.0 * 0.1 + 300.0 * 0.1 * out["time"]), rtol=1e-9)


def test_speed_integrator_adds_a_ramp_of_voltage(run: Run) -> None:
    out = run(w_ref=3.0, w=1.0, gains__k_p=0.0, gains__k_v=0.2, integrator__k_iv=5.0)
    np.testing.assert_allclose(out["u_c"], 0.2 * 2.0 + 5.0 * 2.0 * out["time"], rtol=1e-9)


def test_torque_feedback_adds_what_the_measured_torque_is_short_of(run: Run) -> None:
    out = run(phi_ref=0.3, gains__k_p=50.0, gains__k_v=0.2, tau_s=1.5, torque_feedback__K=2.0, torque_feedback__k_t=2.5)
    np.testing.assert_allclose(out["u_c"], 3.0 + 2.0 * (3.0 - 1.5 / 2.5), rtol=1e-12)


def test_a_saturated_output_takes_the_integrator_back(run: Run) -> None:
    """Where k_iv e_w = (u - u_max)/T_t: 3 V beyond the saturation, whatever time has passed."""
    loop = {"w_ref": 2.0, "gains__k_p": 0.0, "gains__k_v": 0.2, "saturation__u_max": 1.0}
    out = run(1.0, **loop, integrator__k_iv=30.0, integrator__T_t=0.05)
    np.testing.assert_allclose(out["u_c"][-100:], 1.0, rtol=1e-12)
    np.testing.assert_allclose(out["x_v"][-100:] + 0.2 * 2.0, 1.0 + 30.0 * 2.0 * 0.05, rtol=1e-5)


def test_without_enable_the_integrators_run_down(run: Run) -> None:
    out = run(x_v=4.0, w_ref=2.0, enable=False, integrator__k_iv=30.0, integrator__T_t=0.05)
    np.testing.assert_allclose(out["x_v"], 4.0 * np.exp(-out["time"] / 0.05), atol=1e-3)
    assert np.all(out["u_c"] == 0)


def test_displacement_counts_as_angle_through_the_lead(run: Run) -> None:
    angle = run(phi_ref=0.3, phi=0.1, w=4.0)
    displacement = run(s_ref=0.3 * 0.02, s=0.1 * 0.02, v=4.0 * 0.02, gains__lead=0.02)
    np.testing.assert_allclose(displacement["u_c"], angle["u_c"], rtol=1e-12)


@pytest.mark.parametrize("sign", [1, -1])
def test_voltage_saturates_in_both_directions_before_the_added_one(run: Run, sign: int) -> None:
    out = run(phi_ref=sign * 100.0, saturation__u_max=10.0, u_add=5.0)
    np.testing.assert_allclose(out["u_c"], sign * 10.0 + 5.0, rtol=1e-12)


def test_output_follows_the_supply(run: Run) -> None:
    out = run(phi_ref=1.0, gains__k_p=1.0, gains__k_v=0.5, v_supply=6.0, saturation__v_nominal=7.5)
    np.testing.assert_allclose(out["u_c"], 0.5 * 6.0 / 7.5, rtol=1e-12)


def test_torque_mode_scales_the_voltage(run: Run) -> None:
    out = run(phi_ref=0.1, drive__k_tau=35.0)
    np.testing.assert_allclose(out["tau"], 35.0 * out["u_c"], rtol=1e-12)


def test_without_enable_there_is_no_voltage(run: Run) -> None:
    out = run(phi_ref=1.0, u_add=3.0, enable=False)
    assert np.all(out["u_c"] == 0)
    assert np.all(out["tau"] == 0)


def test_velocity_filter_is_a_first_order_lag(run: Run) -> None:
    out = run(w=2.0, velocity_filter__T=0.02, gains__k_v=1.0, saturation__u_max=100.0)
    expected = 2.0 * (1 - np.exp(-out["time"] / 0.02))
    np.testing.assert_allclose(out["w_f"], expected, atol=1e-3)
    np.testing.assert_allclose(out["u_c"], -out["w_f"], rtol=1e-12)


@pytest.mark.parametrize("step", [1e-3, 3.7e-4, 1e-4])
def test_sampled_loop_holds_its_voltage_whatever_the_communication_step(
    fmu: Callable[[str], Path], tmp_path: Path, step: float
) -> None:
    T_s, slope = 2e-3, 5.0
    path = fmu("position_loop")
    description = read_model_description(path)
    vr = {v.name: v.valueReference for v in description.modelVariables}
    loop = FMU2Slave(
        guid=description.guid,
        unzipDirectory=extract(path, str(tmp_path)),
        modelIdentifier=description.coSimulation.modelIdentifier,
        instanceName="loop",
    )
    loop.instantiate()
    loop.setupExperiment()
    loop.enterInitializationMode()
    loop.setReal([vr["sampling.T_s"], vr["gains.k_p"], vr["gains.k_v"]], [T_s, 1.0, 1.0])
    loop.exitInitializationMode()
    for k in range(50):
        loop.setReal([vr["phi_ref"]], [slope * k * step])
        loop.setRealInputDerivatives([vr["phi_ref"]], [1], [slope])
        loop.doStep(k * step, step)
        n = np.floor((k + 1) * step / T_s + 1e-6)
        assert loop.getReal([vr["u_c"]])[0] == pytest.approx(slope * n * T_s, abs=1e-9)
    loop.terminate()
    loop.freeInstance()


def test_sampled_loop_starts_with_the_voltage_of_its_first_sample(run: Run) -> None:
    out = run(phi_ref=0.2, sampling__T_s=0.01)
    continuous = run(phi_ref=0.2)
    np.testing.assert_allclose(out["u_c"], continuous["u_c"], rtol=1e-12)
