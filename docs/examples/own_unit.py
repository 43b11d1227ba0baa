"""Another gear in the gearhead's place: `marimo edit docs/examples/own_unit.py`, or run it with python."""

import marimo

app = marimo.App()


@app.cell
def _():
    import marimo as mo
    import numpy as np

    import cobot_joint as cj
    from cobot_joint.system import with_units
    from cobot_joint.units import find_fmu

    return cj, find_fmu, mo, np, with_units


@app.cell
def _(mo):
    mo.md("""
    # A unit of yours in the bench

    Any FMU with the ports of a gear can take the gearhead's place; here it is the harmonic drive that comes with the
    project. For an FMU of your own give its file instead, and ask `cobot-joint check my_gear.fmu --as planetary_gear`
    what it lacks.
    """)


@app.cell
def _(cj, find_fmu, np, with_units):
    joint = cj.load_system("joint")
    gears = {"planetary": joint, "harmonic": with_units(joint, {"planetary_gear": find_fmu("harmonic_drive.fmu")})}
    inputs = cj.Inputs(np.array([0.0, 0.5, 2.0]), {"v_command": np.array([0.0, 12.0, 12.0])})
    results = {name: cj.run(system, cj.Experiment(inputs, 2.0)) for name, system in gears.items()}
    return (results,)


@app.cell
def _(mo, results):
    mo.vstack([result.plot("w_motor", "w_pulley", "tau_sensor") for result in results.values()])


@app.cell
def _(mo, results):
    mo.ui.table([{"gear": name, "motor's current at the end [A]": r["i_motor"][-1]} for name, r in results.items()])


if __name__ == "__main__":
    app.run()
