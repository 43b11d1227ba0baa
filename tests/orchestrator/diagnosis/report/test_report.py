"""The report stands alone, says the answer first, and says no more than the diagnosis does."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from lxml import html

from cobot_joint.diagnosis.data.conditioning import assess
from cobot_joint.diagnosis.data.recording import Recording
from cobot_joint.diagnosis.repair.compare import VARIANTS, compare
from cobot_joint.diagnosis.report.headline import TermText, number, percent
from cobot_joint.diagnosis.report.report import ReportData, render, write_report

T = np.arange(3000) * 1e-3
FINDING = {
    "term": "planetary_gear.stribeck",
    "equivalent": ["motor_bldc.stribeck"],
    "component": "planetary_gear",
    "confidence": 0.97,
    "onset": 2.5,
    "parameters": {"tau_S": {"value": 2.1e-3, "unit": "N.m", "ci95": [1.9e-3, 2.3e-3]}},
    "where": {"recording": "reversals", "regime": "creep"},
    "shape": None,
}
UNLISTED = FINDING | {
    "term": "mr_brake_belt.unlisted",
    "component": "mr_brake_belt",
    "equivalent": [],
    "shape": {
        "port": "mr_brake_belt.tau_b_add",
        "unit": "N.m",
        "signals": ["phi_b"],
        "formula": "0.03*sin(24*phi_b)",
        "explains": 0.93,
        "table": {"phi_b": [0.0, 1.0, 2.0], "value": [0.0, 0.03, 0.01]},
    },
}
TEXTS = {"planetary_gear.stribeck": TermText("Stribeck friction", "tau = tau_S*exp(-(w/w_S)^2)", "Armstrong 1991")}


def data(verdict: str, findings: list[dict], title: str = "Case 07") -> ReportData:
    rng = np.random.default_rng(0)
    r = Recording(
        "reversals", "train", "loaded", T, {}, {"w": rng.standard_normal(3000)}, {"w": "rad/s"}, notes=["w: 1 gaps"]
    )
    scale = dict(zip(VARIANTS, (-2.0, -1.0, 0.0), strict=True))
    compared = compare([r], {v: lambda r, k=k: {"w": k * r.outputs["w"]} for v, k in scale.items()})
    channels = {"w": {"noise": 1.0, "train": {"nominal": 3.0, "calibrated": 2.0, "repaired": 1.0}}}
    calibrated = {"motor_bldc.winding.R": {"value": 0.2123, "unit": "Ohm", "ci95": [0.21, 0.214]}}
    d = {
        "verdict": verdict,
        "findings": findings,
        "channels": channels,
        "calibrated": calibrated,
        "repaired": {"motor_bldc.winding.R": {"value": 0.2145, "unit": "Ohm", "ci95": [0.212, 0.217]}},
        "next_experiment": None,
    }
    bounds = {"motor_bldc.winding.R": (0.19855, 0.21945)}
    return ReportData(
        title, d, compared, {"w": assess(T)}, {"w": "rad/s"}, {"motor_bldc.winding.R": 0.209}, bounds, TEXTS
    )


def words(text: str) -> str:
    root = html.fromstring(text)
    for script in root.iter("script", "style"):
        script.text = ""
    return re.sub(r"\s+", " ", root.text_content())


@pytest.mark.parametrize(
    ("verdict", "findings", "sentence"),
    [
        ("nothing_missing", [], "Nothing is missing: inside its tolerances the system explains these recordings"),
        (
            "explained",
            [FINDING],
            "The model lacks Stribeck friction in planetary_gear (97 % sure); modelling it removes 100 % of",
        ),
        ("unlisted", [UNLISTED], "lacks an effect that is on no list, at mr_brake_belt (97 % sure)"),
        ("undecided", [], "no explanation stands out"),
    ],
)
def test_the_verdict_is_one_sentence_at_the_top(verdict: str, findings: list[dict], sentence: str) -> None:
    assert sentence in words(render(data(verdict, findings)))[:600]


def test_the_report_says_where_what_how_sure_and_what_else() -> None:
    text = words(render(data("explained", [FINDING])))
    for part in (
        "97 %",
        "reversals; creep",
        "tau = tau_S*exp",
        "0.0021 N.m",
        "0.0019 to 0.0023",
        "motor_bldc.stribeck",
        "2.5 s into the run",
    ):
        assert part in text
    for part in ("motor_bldc.winding.R", "0.209", "0.2123", "0.2145", "0.212 to 0.217", "w: 1 gaps"):
        assert part in text


def test_an_unlisted_effect_has_its_formula_and_its_picture() -> None:
    text = render(data("unlisted", [UNLISTED]))
    assert "mr_brake_belt.tau_b_add = 0.03*sin(24*phi_b), of phi_b; takes away 93 % of the structure" in words(text)
    assert "The shape of mr_brake_belt.unlisted" in words(text)


def test_what_acted_while_a_recording_was_made_is_told_with_its_times_and_its_picture() -> None:
    history = {
        "port": "mr_brake_belt.tau_h",
        "unit": "N.m",
        "recordings": {"reversals": {"t": [1, 1.1, 1.4, 1.5, 2, 2.1, 2.2, 2.3], "value": [0, 4, 4, 0, 0, 1.5, 1.5, 0]}},
    }
    touched = FINDING | {"term": "mr_brake_belt.external_torque", "component": "mr_brake_belt", "load_history": history}
    text = words(render(data("explained", [touched])))
    assert "at mr_brake_belt.tau_h: in reversals from 1.00 to 1.50 s 4, 2.00 to 2.30 s 1.5 N.m" in text
    assert "at times of its own" in text
    assert "Loads of mr_brake_belt.external_torque" in text


def test_the_report_loads_nothing_from_elsewhere(tmp_path: Path) -> None:
    write_report(tmp_path / "report.html", data("explained", [FINDING]))
    root = html.fromstring((tmp_path / "report.html").read_text(encoding="utf-8"))
    assert not root.xpath("//*[@src]")
    assert not root.xpath("//link")
    assert [p.name for p in tmp_path.iterdir()] == ["report.html"]


def test_words_of_a_campaign_are_text_and_never_markup() -> None:
    assert "<script>alert" not in render(data("undecided", [], title="<script>alert(1)</script>"))


def test_numbers_read_as_people_write_them() -> None:
    assert number(2.1e-7) == "2.1·10⁻⁷"
    assert number(-0.5) == "−0.5"
    assert number(None) == "–"
    assert percent(0.9996) == "99.9 %"
    assert percent(1.0) == "100 %"


def test_a_channel_without_noise_is_reported() -> None:
    given = data("undecided", [])
    given.diagnosis["channels"]["w"]["noise"] = 0.0
    assert "reversals" in words(render(given))
