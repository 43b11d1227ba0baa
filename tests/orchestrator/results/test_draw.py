"""Pictures: the same from a process of its own, extremes kept where points are thinned, trouble said."""

from __future__ import annotations

import base64
import json
import re
from pathlib import Path

import numpy as np
import pytest

from cobot_joint.results.draw import Stills, draw
from cobot_joint.results.figures import COLOUR, Curve, Panel, Picture, _figure, over_time, write_html
from cobot_joint.results.png import COLUMNS, _seen, still


def make(stem: Path, y: np.ndarray) -> Picture:
    return Picture(stem, "waves", "A </script> title", "time [s]", [Panel("[A]", [Curve("i", np.arange(5.0), y)])])


def test_a_picture_from_the_process_is_the_one_drawn_here(tmp_path: Path) -> None:
    y = np.array([0.0, 1.0, 0.0, -1.0, 0.0])
    draw(make(tmp_path / "here", y))
    with Stills() as stills:
        path = stills.draw(make(tmp_path / "there", y))
    assert path.read_bytes() == (tmp_path / "here.png").read_bytes()


def test_a_picture_that_cannot_be_drawn_is_said(tmp_path: Path) -> None:
    with pytest.raises(RuntimeError, match=r"pictures were not drawn: (.|\n)*ValueError"), Stills() as stills:
        stills.draw(make(tmp_path / "odd", np.zeros(4)))


def test_thinned_lines_keep_their_extremes_and_ends() -> None:
    rng = np.random.default_rng(1)
    x, y = np.arange(20 * COLUMNS, dtype=float), rng.normal(size=20 * COLUMNS)
    at, seen = _seen(Curve("i", x, y))
    assert len(seen) <= 2 * COLUMNS + 2
    assert (seen.min(), seen.max(), at[0], at[-1]) == (y.min(), y.max(), x[0], x[-1])
    assert np.all(np.diff(at) > 0)
    np.testing.assert_array_equal(seen, y[at.astype(int)])


def test_a_page_holds_the_samples_and_its_title_ends_no_script(tmp_path: Path) -> None:
    y = np.array([0.0, 0.1, np.pi, -1.0, 0.0])
    page = write_html(make(tmp_path / "page", y)).read_text(encoding="utf-8")
    found = re.search(r'Plotly\.newPlot\("figure", (\{.*\})\);</script></body>', page)
    assert found
    assert "</script" not in found[1]
    figure = json.loads(found[1])
    np.testing.assert_array_equal(np.frombuffer(base64.b64decode(figure["data"][0]["y"]["bdata"])), y)
    assert figure["layout"]["title"]["text"] == "A </script> title"


def test_what_would_be_flat_has_a_panel_with_its_like_and_what_is_zero_has_none() -> None:
    t = np.arange(100.0)
    signals = {"w_motor": 5 * t, "w_pulley": t / 20, "w_brake": t / 5, "w_off": 0 * t, "i": t}
    panels = over_time(t, signals, dict.fromkeys(signals, "rad/s") | {"i": "A"})
    assert [[c.label for c in p.curves] for p in panels] == [["w_motor", "w_off"], ["w_pulley", "w_brake"], ["i"]]
    assert [p.y_label for p in panels] == ["speed [rad/s]", "speed [rad/s]", "current [A]"]


def test_a_curve_that_would_hide_another_is_dashed() -> None:
    t = np.arange(100.0)
    (panel,) = over_time(t, {"tau_gear": t, "tau_sensor": t + 0.1, "tau_belt": t / 2}, {})
    assert [c.style for c in panel.curves] == ["line", "dashed", "line"]


def test_a_name_has_one_colour_and_one_entry_in_all_panels(tmp_path: Path) -> None:
    t = np.arange(3.0)
    curves = [Curve("fit", t, t), Curve("", t, t), Curve("recorded", t, t)]
    picture = Picture(tmp_path / "p", "", "", "", [Panel("a", curves), Panel("b", [Curve("other", t, t), *curves[:1]])])
    traces = _figure(picture)["data"]
    fits = [trace for trace in traces if trace["name"] == "fit"]
    assert len({trace["line"]["color"] for trace in fits}) == 1
    assert [trace["showlegend"] for trace in traces] == [True, False, True, True, False]
    assert traces[2]["line"]["color"] == COLOUR["recorded"]
    axes = still(picture).axes
    assert [[text.get_text() for text in axis.get_legend().get_texts()] for axis in axes] == [
        ["fit", "recorded"], ["other", "fit"]
    ]  # fmt: skip
    assert axes[0].lines[0].get_color() == axes[1].lines[1].get_color() == fits[0]["line"]["color"]


@pytest.mark.filterwarnings("error")
def test_a_gap_hides_nothing() -> None:
    """Two curves that coincide, each with a gap: the second is dashed, so that both are seen."""
    time = np.linspace(0, 1, 100)
    one, other = np.sin(time), np.sin(time)
    one[10:15] = other[30:35] = np.nan
    (panel,) = over_time(time, {"one": one, "other": other}, {})
    assert [curve.style for curve in panel.curves] == ["line", "dashed"]
    (panel,) = over_time(time, {"one": one, "none": np.full(100, np.nan)}, {})
    assert [curve.style for curve in panel.curves] == ["line", "line"]
