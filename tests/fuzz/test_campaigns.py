"""Whatever a campaign says, it is taken or refused in one line; so is every file of the corpus."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cobot_joint.diagnosis.data.campaign import load_campaign

Refusal = Callable[..., str]
CORPUS = sorted((Path(__file__).parent / "corpus" / "campaigns").iterdir())
VALUES = st.one_of(
    st.none(), st.booleans(), st.integers(-(2**63), 2**63 - 1), st.floats(), st.text(max_size=12),
    st.sampled_from(["5 %", "0 %", "9**9**9**9", "first sample", "first sample of zz", "no_load", "zz", "rad/s",
                     "run.csv", "../run.csv", "*.csv", "motor_bldc.winding.R", "\x1b[31m"]),
    st.lists(st.floats(), max_size=3),
)  # fmt: skip
NAMES = st.sampled_from(["motor_bldc.winding.R", "motor_bldc.nix", "w_motor", "w_motor [rpm]", "zz", "", "a.b"])
TOP = {
    "title": VALUES, "system": VALUES, "terms": VALUES, "nix": VALUES,
    "tolerances": st.dictionaries(NAMES, VALUES, max_size=2), "parameters": st.dictionaries(NAMES, VALUES, max_size=2),
    "channels": st.dictionaries(NAMES, VALUES, max_size=2), "initial": st.dictionaries(NAMES, VALUES, max_size=2),
    "logged": st.dictionaries(NAMES, st.fixed_dictionaries(
        {"unit": VALUES, "causality": st.sampled_from(["input", "output", "zz"])},
        optional=dict.fromkeys(("noise", "colour", "step", "range", "setups"), VALUES)), max_size=2),
    "setups": st.dictionaries(NAMES, VALUES, max_size=1),
}  # fmt: skip
OF_RECORDING = ("file", "setup", "role", "initial", "parameters", "time", "begin", "end", "late", "without", "table",
                "skip", "separator", "encoding", "decimal")  # fmt: skip


@st.composite
def campaigns(draw: st.DrawFn) -> dict[str, Any]:
    """The plain campaign with one to three fields that are something else."""
    content: dict[str, Any] = {"system": "joint"}
    recording: dict[str, Any] = {"file": "run.csv", "setup": "no_load"}
    for _ in range(draw(st.integers(1, 3))):
        if draw(st.booleans()):
            key = draw(st.sampled_from(sorted(TOP)))
            content[key] = draw(TOP[key])
        else:
            recording[draw(st.sampled_from(OF_RECORDING))] = draw(VALUES)
    return content | {"recording": [recording] * draw(st.integers(1, 2))}


def toml(value: Any) -> str:
    """As an inline value."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{json.dumps(k)} = {toml(v)}" for k, v in value.items() if v is not None) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(toml, value)) + "]"
    return str(value) if isinstance(value, float) else json.dumps(value)


def loaded_or_refused(refusal: Refusal, text: bytes) -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        t = np.arange(200) * 1e-3
        rows = np.column_stack([t, np.sin(9 * t), np.cos(9 * t), 20 * t])
        header = "time [s],v_command [V],i_motor [A],w_motor [rad/s]"
        np.savetxt(folder / "run.csv", rows, fmt="%.6g", delimiter=",", header=header, comments="")
        (folder / "campaign.toml").write_bytes(text)
        said = refusal(load_campaign, folder / "campaign.toml")
        assert "\n" not in said
        assert "\x1b" not in said


@given(content=campaigns())
def test_any_campaign_is_taken_or_refused(refusal: Refusal, content: dict[str, Any]) -> None:
    lines = [f"{key} = {toml(value)}" for key, value in content.items() if value is not None]
    loaded_or_refused(refusal, "\n".join(lines).encode("utf-8", "replace"))


@given(content=st.binary(max_size=300))
def test_any_bytes_are_refused(refusal: Refusal, content: bytes) -> None:
    loaded_or_refused(refusal, content)


@pytest.mark.parametrize("path", CORPUS, ids=lambda p: p.name)
def test_campaigns_that_once_were_trouble_are_taken_or_refused(refusal: Refusal, path: Path) -> None:
    loaded_or_refused(refusal, path.read_bytes())
