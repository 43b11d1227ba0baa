"""Figures are those that anyone recomputes from the published signals."""

from __future__ import annotations

import numpy as np
import pytest

from cobot_joint.cosim import SimulationError
from cobot_joint.diagnosis.data.recording import Recording
from cobot_joint.diagnosis.repair.compare import Comparison, channel_figures, compare, strongest_window, table

T = np.arange(2000) * 1e-3


def recording(name: str, **outputs: np.ndarray) -> Recording:
    units = {"w": "rad/s", "i": "A"}
    return Recording(name, "holdout", "default", T, {}, outputs, {n: units[n] for n in outputs})


def compared() -> list[Comparison]:
    rng = np.random.default_rng(3)
    gap = rng.standard_normal(2000)
    gap[100:150] = np.nan
    runs = [recording("a", w=rng.standard_normal(2000), i=gap), recording("b", w=rng.standard_normal(2000))]
    bump = np.exp(-(((T - 1.2) / 0.05) ** 2))
    return compare(
        runs,
        {
            "nominal": lambda r: {n: np.zeros(2000) for n in r.outputs},
            "calibrated": lambda r: {n: 0.5 * x - 3 * bump for n, x in r.outputs.items()},
            "repaired": lambda r: {n: 0.9 * x for n, x in r.outputs.items()},
        },
    )


def test_figures_are_root_mean_squares_over_all_recordings_that_have_the_channel() -> None:
    runs = compared()
    figures = channel_figures(runs)
    w = np.concatenate([c.recording.outputs["w"] for c in runs])
    i = runs[0].recording.outputs["i"]
    assert figures["w"]["nominal"] == pytest.approx(np.sqrt(np.mean(w**2)))
    assert figures["i"]["repaired"] == pytest.approx(0.1 * np.sqrt(np.nanmean(i**2)))


def test_the_published_table_recomputes_the_figures() -> None:
    runs = compared()
    t = table(runs)
    assert t.column_names[:4] == ["recording", "time [s]", "w.recorded [rad/s]", "w.nominal [rad/s]"]
    for channel, unit in (("w", "rad/s"), ("i", "A")):
        recorded = t[f"{channel}.recorded [{unit}]"].to_numpy()
        for variant, expected in channel_figures(runs)[channel].items():
            simulated = t[f"{channel}.{variant} [{unit}]"].to_numpy()
            assert np.sqrt(np.nanmean((recorded - simulated) ** 2)) == pytest.approx(expected)


def test_a_simulation_that_ends_in_nan_is_not_hidden() -> None:
    runs = compare([recording("a", w=T)], {"nominal": lambda r: {"w": np.where(T > 1, np.nan, T)}})
    assert np.isnan(channel_figures(runs, ["nominal"])["w"]["nominal"])  # type: ignore[arg-type]


def test_a_simulation_that_fails_costs_its_figures_and_no_other() -> None:
    """One recording in which one variant failed lost the whole diagnosis."""

    def fails(r: Recording) -> dict[str, np.ndarray]:
        if r.name == "b":
            raise SimulationError("gear: fmi2DoStep at 0.3 s gives fmi2Error")
        return {n: np.zeros(2000) for n in r.outputs}

    runs = [recording("a", w=T, i=T), recording("b", w=T)]
    found = compare(runs, {"nominal": lambda r: dict(r.outputs), "repaired": fails})
    assert found[1].failed == {"repaired": "gear: fmi2DoStep at 0.3 s gives fmi2Error"}
    figures = channel_figures(found, ["nominal", "repaired"])
    assert figures["w"] == {"nominal": 0.0, "repaired": None}
    assert figures["i"]["repaired"] == pytest.approx(np.sqrt(np.mean(T**2)))


def test_the_closer_look_is_where_the_repair_gains_most() -> None:
    start, stop = strongest_window(compared()[0], "w", 0.2)
    assert start < 1.2 < stop
    assert stop - start == pytest.approx(0.2, abs=2e-3)
