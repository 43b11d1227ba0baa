"""From a log to a repaired system: `marimo edit docs/examples/own_log.py`, or run it with python (about a minute)."""

import marimo

app = marimo.App()


@app.cell
def _():
    from pathlib import Path
    from tempfile import mkdtemp

    import marimo as mo
    import numpy as np

    import cobot_joint as cj

    return Path, cj, mkdtemp, mo, np


@app.cell
def _(mo):
    mo.md("""
    # What does the model lack?

    These logs are **simulated**: a motor with its gearhead that has Stribeck friction, which the model does not have,
    and noise. Put the files of your own machine in their place.
    """)


@app.cell
def _(Path, cj, mkdtemp, np):
    folder = Path(mkdtemp(prefix="cobot-joint-"))
    machine = {"planetary_gear.stribeck.tau_S": 1.5e-3, "planetary_gear.stribeck.w_S": 20.0}
    rng = np.random.default_rng(1)
    time = np.arange(0, 6.0, 1e-3)
    for name, voltage in {
        "sine": 6 * np.sin(2 * np.pi * 0.5 * time),
        "steps": np.select([time < 1, time < 2, time < 3, time < 4.5], [1.0, 8.0, -2.0, -8.0], 3.0),
        "held_out": 4 * np.sin(2 * np.pi * 0.8 * time) + 2,
    }.items():
        inputs = cj.Inputs(time, {"v_command": voltage})
        run = cj.run("joint_no_load", cj.Experiment(inputs, time[-1], output_step=1e-3), parameters=machine)
        current = run["i_motor"] + rng.normal(0, 0.02, len(time))
        speed = run["w_motor"] + rng.normal(0, 0.3, len(time))
        np.savetxt(
            folder / f"{name}.csv",
            np.column_stack([time, voltage, current, speed]),
            delimiter=",",
            header="t [s],u [V],i [A],w [rad/s]",
            comments="",
        )
    (folder / "campaign.toml").write_text("""
    system = "joint_no_load"
    [channels]
    "u [V]" = "v_command"
    "i [A]" = "i_motor"
    "w [rad/s]" = "w_motor"
    [tolerances]
    "motor_bldc.winding.R" = "10 %"
    "motor_bldc.winding.k" = "5 %"
    "motor_bldc.friction.d" = "20 %"
    "planetary_gear.friction.tau_C" = "20 %"
    [[recording]]
    file = "sine.csv"
    [[recording]]
    file = "steps.csv"
    [[recording]]
    file = "held_out.csv"
    role = "holdout"
    """)
    return (folder,)


@app.cell
def _(cj, folder, mo):
    answer = cj.diagnose(folder)
    mo.as_html(answer)
    return (answer,)


@app.cell
def _(answer):
    answer.plot()


@app.cell
def _(answer, mo):
    mo.md(f"The report is `{answer.report}`, the repaired system `{answer.repaired}`: any simulator that reads SSP.")


if __name__ == "__main__":
    app.run()
