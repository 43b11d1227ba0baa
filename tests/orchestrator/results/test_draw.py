"""Pictures: the same from a process of its own, extremes kept where points are thinned, trouble said."""

from __future__ import annotations

import base64
import json
import re
from pathlib import Path

import numpy as np
import pytest

from cobot_joint.results.draw import Stills, draw
from cobot_joint.results.figures import Curve, Panel, Picture, write_html
from cobot_joint.results.png import COLUMNS, _seen


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
