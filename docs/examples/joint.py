"""The joint while its brake takes hold: `marimo edit docs/examples/joint.py`, or `python docs/examples/joint.py`."""

import marimo

app = marimo.App()


@app.cell
def _():
    import marimo as mo
    import numpy as np

    import cobot_joint as cj

    return cj, mo, np


@app.cell
def _(mo):
    mo.md("""
    # The joint, its brake, and a parameter

    Motor, gearhead, torque sensor and brake are four FMUs. Move a slider: the bench runs again.
    """)


@app.cell
def _(mo):
    voltage = mo.ui.slider(2.0, 24.0, value=12.0, step=1.0, label="voltage [V]", show_value=True)
    brake = mo.ui.slider(0.0, 1.0, value=0.4, step=0.1, label="brake's current [A]", show_value=True)
    mo.hstack([voltage, brake])
    return brake, voltage


@app.cell
def _(brake, cj, np, voltage):
    time = np.array([0.0, 0.5, 2.0, 2.5, 4.0])
    inputs = cj.Inputs(
        time,
        {
            "v_command": voltage.value * np.array([0, 1, 1, 1, 1]),
            "i_brake": brake.value * np.array([0, 0, 0, 1, 1]),
        },
    )
    experiment = cj.Experiment(inputs, 4.0)
    result = cj.run("joint", experiment)
    result.plot("i_motor", "w_motor", "tau_sensor")
    return experiment, result


@app.cell
def _(mo, result):
    mo.md(f"""
    Energy that one unit gives and the next does not take, as a share of what flows:

    {chr(10).join(f"- {wire}: {result.energy_residual(wire):.1e}" for wire in result.energy)}
    """)


@app.cell
def _(cj, experiment):
    found = cj.sweep("joint", experiment, {"motor_bldc.winding.R": [0.16, 0.2, 0.24]}, jobs=1)
    found.plot("w_motor")
    return (found,)


if __name__ == "__main__":
    app.run()
