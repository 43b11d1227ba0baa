"""What is not known is left out of a report, which is written all the same."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cobot_joint.diagnosis.data.recording import Recording
from cobot_joint.diagnosis.repair.compare import Comparison
from cobot_joint.diagnosis.report.headline import how_large
from cobot_joint.diagnosis.report.localization_pictures import parts_picture, time_picture
from cobot_joint.diagnosis.report.words import remedy
from cobot_joint.results.diagnosed import Diagnosed

ESTIMATE = {"value": 2.0, "unit": "N.m", "ci95": [None, None]}


def test_a_part_that_diverges_has_no_bar() -> None:
    channels = {name: {"refitted": x, "healthy": x, "off": True} for name, x in (("w", None), ("i", 2.0))}
    part = {"units": ["motor"], "driven_by": [], "setup": "loaded", "channels": channels}
    assert "motor" in parts_picture([part]).html


def test_a_channel_whose_noise_is_not_known_has_no_chi_square_over_time_and_no_bar() -> None:
    time = np.arange(4000) * 1e-3
    outputs = {name: np.ones(4000) for name in ("w", "i")}
    run = Recording("run", "train", "default", time, {}, outputs, {"w": "rad/s", "i": "A"})
    compared = Comparison(run, {"calibrated": {name: np.zeros(4000) for name in outputs}})
    html = time_picture(compared, [], {"w": 0.1, "i": None}).html  # type: ignore[dict-item]
    assert ("w\\u003cbr\\u003e" in html, "i\\u003cbr\\u003e" in html) == (True, False)
    figures = dict.fromkeys(("nominal", "calibrated", "repaired"), 1.0)
    channels = {"w": {"noise": 0.1, "train": figures}, "i": {"noise": None, "train": figures}}
    (axis,) = Diagnosed(Path(), {"channels": channels}).plot().axes
    assert [label.get_text() for label in axis.get_yticklabels()] == ["w, training"]


def test_an_interval_that_is_not_known_is_not_said() -> None:
    (said,) = how_large({"term": "motor.cogging", "parameters": {"motor.cogging.A": ESTIMATE}}, {})
    assert said == "motor.cogging.A: 2 N.m"
    off = {"value": 1.1, "unit": "1", "ci95": [None, None]}
    told = remedy({"column": "w", "gain": off, "offset": ESTIMATE})
    assert told is not None
    assert "scale = 0.90909" in told
