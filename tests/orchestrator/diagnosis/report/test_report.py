"""The report stands alone, says the answer first, and says no more than the diagnosis does."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from dataclasses import replace
from datetime import date
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from lxml import html

from cobot_joint.diagnosis.data.conditioning import assess
from cobot_joint.diagnosis.data.recording import Recording
from cobot_joint.diagnosis.findings import Ground
from cobot_joint.diagnosis.repair.compare import VARIANTS, compare
from cobot_joint.diagnosis.report.chain import chain_of
from cobot_joint.diagnosis.report.headline import NOT_COUNTED, TermText, how_large, how_sure
from cobot_joint.diagnosis.report.overlays import LEVELS, binned, over_signals
from cobot_joint.diagnosis.report.pictures import of_panels
from cobot_joint.diagnosis.report.report import ReportData, render, write_report
from cobot_joint.diagnosis.report.words import remedy
from cobot_joint.diagnosis.selection.confidence import COUNTED, COUNTED_BESIDE, COUNTED_TERMS
from cobot_joint.mathml import typeset
from cobot_joint.results.figures import COLOUR, Curve, Panel
from cobot_joint.system import load_system

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
PARAMETER = FINDING | {"term": "load.body.J", "component": "load"}
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


STRIBECK = "Stribeck friction in planetary_gear or motor_bldc"


@pytest.mark.parametrize(
    ("verdict", "findings", "sentence"),
    [
        ("nothing_missing", [], "Nothing is missing: inside its tolerances the system explains these recordings"),
        ("explained", [FINDING], f"The model lacks {STRIBECK} (97 % sure); modelling it removes 100 % of"),
        ("unlisted", [UNLISTED], "lacks an effect that is on no list, at mr_brake_belt (97 % sure)"),
        ("explained", [FINDING | {"confidence": 0.3}], f"reaches 50 % confidence; the closest is {STRIBECK} (30 %"),
        (
            "explained",
            [FINDING | {"confidence": 0.45, "equivalent": ["motor_bldc.unlisted"]}],
            "closest is Stribeck friction in planetary_gear, or an effect that is on no list at motor_bldc (45 % sure)",
        ),
        (
            "explained",
            [PARAMETER],
            "body.J of load is outside its tolerance (97 % sure); a value that fits removes",
        ),
        ("explained", [FINDING | {"confidence": 0.7}, PARAMETER], "(97 % sure), and the model lacks Stribeck friction"),
        (
            "explained",
            [PARAMETER | {"equivalent": ["gear.body.J", "motor.rotor.J"]}],
            "body.J of load or gear is outside",
        ),
        (
            "explained",
            [FINDING, PARAMETER],
            f"lacks {STRIBECK} (97 % sure), and body.J of load is outside its tolerance",
        ),
        (
            "explained",
            [FINDING, PARAMETER | {"confidence": 0.06}],
            "above the noise. No claim, though the repaired system has it: body.J outside its tolerance in load (6 %",
        ),
        ("undecided", [], "no explanation stands out; farthest off is w, 2 times its noise (rms)."),
    ],
)
def test_the_verdict_is_one_sentence_at_the_top(verdict: str, findings: list[dict], sentence: str) -> None:
    assert sentence in words(render(data(verdict, findings)))[:600]


@pytest.mark.parametrize(("repair", "column"), [("offered", "repaired"), ("withheld", "withheld")])
def test_the_column_of_a_repair_that_is_withheld_says_so(repair: str, column: str) -> None:
    report = data("explained", [FINDING])
    text = words(render(replace(report, diagnosis={**report.diagnosis, "repair": repair})))
    assert f"nominalcalibrated{column}" in text.replace(" ", "")


def test_a_misread_channel_is_the_verdict_and_what_undoes_it_the_next_step() -> None:
    misread = {
        "column": "current",
        "gain": {"value": 1.1, "ci95": [1.099, 1.101]},
        "offset": {"value": 0.0, "unit": "A", "ci95": [-1e-3, 1e-3]},
        "takes": 0.9997,
        "alike": None,
    }
    report = data("undecided", [])
    told = {**report.diagnosis, "misreading": misread, "next_experiment": remedy(misread)}
    text = words(render(replace(report, diagnosis=told)))
    assert "Undecided: current is logged 1.1 times what is there, which alone explains 99.9 % of the difference" in text
    assert "say scale = 0.90909 for it in [channels]" in text


def test_a_channel_that_lags_is_the_verdict_where_nothing_else_was_found() -> None:
    report, lags = data("undecided", []), "w lags the re-fitted system by 15 ms in every run that shows it"
    told = {**report.diagnosis, "mistimed": [f"{lags}; possible causes: w stamped late"]}
    said = words(render(replace(report, diagnosis=told)))
    assert f"Undecided: {lags}, or the machine lacks something." in said


def test_the_report_says_where_what_how_sure_and_what_else() -> None:
    text = words(render(data("explained", [FINDING])))
    parts = ("97 %", "reversals; creep", "0.0021 N.m", "0.0019 to 0.0023", "motor_bldc.stribeck", "2.5 s into the run")
    for part in (*parts, "motor_bldc.winding.R", "0.209", "0.2123", "0.2145", "0.212 to 0.217", "w: 1 gaps"):
        assert part in text


def test_an_added_term_s_equation_is_typeset() -> None:
    assert f">{typeset(TEXTS['planetary_gear.stribeck'].equation)}</dd>" in render(data("explained", [FINDING]))


def test_an_unlisted_effect_has_its_formula_and_its_picture() -> None:
    text = render(data("unlisted", [UNLISTED]))
    assert f"mr_brake_belt.tau_b_add = {typeset('0.03*sin(24*phi_b)')}, of phi_b; takes away 93 % of the" in text
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


def test_the_head_of_the_report_has_its_date_and_version_and_leads_to_its_files() -> None:
    facts = {"tool": "cobot-joint 1.2.3", "recordings": "a.csv (SHA-256 0123456789ab)"}
    made = replace(data("explained", [FINDING]), created=date(2026, 3, 1), provenance=facts)
    (head,) = html.fromstring(render(made)).iter("header")
    assert "2026-03-01 · cobot-joint 1.2.3" in head.text_content()
    link, words = head.iter("a")
    assert html.fromstring(render(made)).get_element_by_id(words.get("href")[1:]).tag == "dl"
    (place,) = html.fromstring(render(made)).xpath(f"//*[@id='{link.get('href')[1:]}']")
    assert "a.csv (SHA-256 0123456789ab)" in place.text_content()


def test_words_of_a_campaign_are_text_and_never_markup() -> None:
    assert "<script>alert" not in render(data("undecided", [], title="<script>alert(1)</script>"))


@pytest.mark.parametrize(
    ("verdict", "findings"),
    [("nothing_missing", []), ("explained", [FINDING]), ("unlisted", [UNLISTED]), ("undecided", [])],
)
def test_the_chain_of_units_and_an_overlay_stand_before_what_is_folded(verdict: str, findings: list[dict]) -> None:
    given = replace(data(verdict, findings), system=load_system("joint_logged"))
    root = html.fromstring(render(given))
    assert len(root.xpath("//svg[not(ancestor::details)]")) == 2  # in a row and upright
    assert len(root.xpath("//*[@class='plot'][not(ancestor::details)]")) == 1
    marked = {g.xpath("string(.//text[@class='name'])") for g in root.xpath("//g[@class='found']")}
    assert marked == {f["component"] for f in findings}


def test_units_on_one_shaft_are_joined_by_it_and_the_logger_stands_apart() -> None:
    links = {place.name: place.link for place in chain_of(load_system("joint_logged"), ["w_motor"])}
    shafts = ("motor_bldc", "planetary_gear", "torque_sensor")
    assert links == dict.fromkeys(shafts, "shaft") | {"mr_brake_belt": "", "acquisition": ""}


def test_a_twin_in_another_unit_is_marked_as_possible() -> None:
    given = replace(data("explained", [FINDING]), system=load_system("joint_logged"))
    root = html.fromstring(render(given))
    assert {g.xpath("string(.//text[@class='name'])") for g in root.xpath("//g[@class='possible']")} == {"motor_bldc"}


def sure(given: float, ground: str | None, **further: object) -> str:
    finding = FINDING | {"confidence": given, "confidence_from": ground}
    return how_sure(finding, data("explained", [finding]).diagnosis | further)


def test_a_counted_confidence_comes_with_its_count() -> None:
    said = "95 %; of 118 findings given 95 to 98 % on drawn machines with known answers 116 were right"
    assert sure(0.95, "drawn machines") == said


@pytest.mark.parametrize(
    ("said", "why"),
    [
        *((sure(0.4, ground), why) for ground, why in NOT_COUNTED.items()),
        (sure(0.7, None), "not on record"),
        (sure(0.45, "drawn machines", repair="withheld"), "less than even"),
        (how_sure(FINDING | {"confidence": 0.65, "limited_by": "x"}, {}), "65 %: no more, since x"),
    ],
)
def test_a_confidence_that_was_not_counted_says_so(said: str, why: str) -> None:
    assert why in said
    assert "were right" not in said


@pytest.mark.parametrize("ground", ["background", "recorded motion"])
def test_a_claim_beside_a_background_says_how_many_such_were_right(ground: str) -> None:
    assert all(f" {count} " in sure(0.7, ground) for count in COUNTED_BESIDE)


def test_counts_are_those_of_the_documentation(root: Path) -> None:
    text = (root / "docs" / "diagnosis-calibration.md").read_text(encoding="utf-8")
    rows = text.split("| confidence given |")[1].split("\n\n")[0].splitlines()[2:]
    table = [[cell.strip() for cell in row.strip("|").split("|")] for row in rows]
    assert [(f"{low:g} to {min(high, 1):g}", str(n), str(right)) for (low, high), n, right in COUNTED] == [
        tuple(row[:3]) for row in table
    ]


def test_a_term_is_counted_of_which_two_large_effects_were_drawn(root: Path) -> None:
    text = (root / "docs" / "diagnosis-calibration.md").read_text(encoding="utf-8")
    rows = text.split("| term, size above 40 |")[1].split("\n\n")[0].splitlines()[2:]
    table = [[cell.strip() for cell in row.strip("|").split("|")] for row in rows]
    assert {name for name, drawn, *_ in table if int(drawn) >= 2} == COUNTED_TERMS


def test_what_stands_behind_a_confidence_has_words_for_every_ground() -> None:
    assert {*NOT_COUNTED, "drawn machines"} == set(get_args(Ground))


def test_amplitudes_over_frequency_are_reported_without_runs_over_time() -> None:
    omega = np.array([1.0, 10.0, 100.0])
    curves = [Curve("recorded", omega, omega, "markers"), Curve("repaired", omega, omega)]
    drawn = of_panels([Panel("amplitude [dB]", curves)], "omega [rad/s]", "Before and after", "")
    given = data("explained", [FINDING])
    reading = {"name": "as given", "nominal": 0.1, "calibrated": 0.05, "repaired": 0.01, "terms": ["a.b"]}
    d = given.diagnosis | {"readings": [reading]}
    text = render(replace(given, diagnosis=d, compared=[], quality={}, own_pictures=[drawn]))
    first = html.fromstring(text).xpath("//*[@class='plot'][not(ancestor::details)]")
    assert [json.loads(place.getnext().text)["layout"]["yaxis"]["title"]["text"] for place in first] == [
        "amplitude<br>[dB]"
    ]
    rows = [[cell.text_content() for cell in row] for row in html.fromstring(text).iter("tr")]
    assert ["as given", "0.1", "0.05", "0.01", "a.b"] in rows


def test_rows_of_a_table_are_drawn_over_rows_and_not_over_time() -> None:
    given = data("explained", [FINDING])
    given.compared[0].recording.scatter = {"w": 1.0}
    text = render(given)
    assert "row of the table" in text
    assert "time [s]" not in text.split("Where the recordings")[0].split("plotly.js v")[0]


def test_figures_that_are_drawn_can_be_read_from_the_page() -> None:
    root = html.fromstring(render(data("unlisted", [UNLISTED])))
    places = root.xpath("//*[@class='plot']")
    figures = [json.loads(place.getnext().text) for place in places]
    assert len(places) == 5  # before and after, the recording, over signals, errors over noise, the table
    assert all(figure["data"] for figure in figures)
    recorded = [t for f in figures for t in f["data"] if t.get("name") == "recorded"]
    assert {t["line"]["color"] for t in recorded} == {COLOUR["recorded"]}


def test_friction_that_is_missing_shows_over_speed() -> None:
    speed = np.sin(20 * T)
    r = Recording("run", "train", "loaded", T, {"v": speed}, {"i": 0.1 * np.sign(speed)}, {"v": "rad/s", "i": "A"})
    (c,) = compare(
        [r], {v: lambda r, k=k: {"i": k * r.outputs["i"]} for v, k in zip(VARIANTS, (0.0, 0.0, 1.0), strict=True)}
    )
    drawn = json.loads(html.fragments_fromstring(over_signals([c], {"i": 0.01}, {"i": "A"}).html)[1].text)
    over_speed = {t["name"]: t for t in drawn["data"] if t.get("xaxis", "x") == "x"}
    assert drawn["layout"]["xaxis"]["title"]["text"] == "v [rad/s]"
    assert drawn["layout"]["yaxis"]["title"]["text"] == "left of i<br>[A]"
    assert set(over_speed) == {"calibrated", "repaired"}


def test_means_by_level_follow_a_dependence() -> None:
    x = np.random.default_rng(0).uniform(-1, 1, 10_000)
    middle, mean = binned(x, np.sign(x))
    assert len(middle) == LEVELS
    assert mean[[0, 5, -5, -1]].tolist() == [-1, -1, 1, 1]
    assert binned(np.zeros(5), np.ones(5))[1].tolist() == [1.0]


@pytest.mark.long
@pytest.mark.skipif(shutil.which("chromium") is None, reason="chromium is not installed")
def test_the_report_prints_on_ten_pages_at_most(tmp_path: Path) -> None:
    write_report(tmp_path / "report.html", data("unlisted", [UNLISTED]))
    options = [
        "--headless=new",
        "--no-sandbox",
        f"--user-data-dir={tmp_path / 'profile'}",
        "--virtual-time-budget=8000",
    ]
    target = tmp_path / "report.pdf"
    subprocess.run(
        ["chromium", *options, f"--print-to-pdf={target}", (tmp_path / "report.html").as_uri()], check=True, timeout=120
    )
    assert 2 <= len(re.findall(rb"/Type\s*/Page\b", target.read_bytes())) <= 10


def luminance(colour: str) -> float:
    """Relative luminance, WCAG 2.1."""
    digits = colour[1:] if len(colour) == 7 else "".join(2 * digit for digit in colour[1:])
    share = np.array([int(digits[k : k + 2], 16) / 255 for k in (0, 2, 4)])
    linear = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    return float(linear @ [0.2126, 0.7152, 0.0722])


def contrast(one: str, other: str) -> float:
    """Of two colours, from 1 to 21, WCAG 2.1."""
    dark, light = sorted(map(luminance, (one, other)))
    return (light + 0.05) / (dark + 0.05)


@pytest.mark.parametrize("scheme", ["light", "dark", "print"])
def test_text_and_curves_stand_out_from_the_paper(scheme: str) -> None:
    schemes = re.findall(r":root \{(.+?)\}", render(data("explained", [FINDING])), flags=re.S)
    colours = dict(re.findall(r"--(\w+): (#\w+)", schemes[("light", "dark", "print").index(scheme)]))
    for text in ("ink", "soft", "mark"):
        assert contrast(colours[text], colours["paper"]) >= 4.5
    for shape in (colours["found"], colours["unsure"], colours["good"], *COLOUR.values()):
        assert contrast(shape, colours["paper"]) >= 3.0


def test_a_channel_without_noise_is_reported() -> None:
    given = data("undecided", [])
    given.diagnosis["channels"]["w"]["noise"] = 0.0
    assert "reversals" in words(render(given))


@pytest.mark.parametrize(
    ("ci95", "said"),
    [([1.9e-3, 2.3e-3], "0.0019 to 0.0023"), ([9e-14, 7e12], "not determined by these recordings")],
)
def test_an_interval_that_says_nothing_is_not_spelled_out(ci95: list[float], said: str) -> None:
    finding = {"term": "a.b", "parameters": {"tau_S": {"value": 2.1e-3, "unit": "N.m", "ci95": ci95}}}
    assert how_large(finding, {}) == [f"tau_S: 0.0021 N.m ({said})"]
    given = data("explained", [FINDING | {"parameters": {"tau_S": {"value": 2.1e-3, "unit": "N.m", "ci95": ci95}}}])
    assert f"(95 %: {said})" in words(render(given))
