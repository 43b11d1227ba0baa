"""Whatever a recording holds, it is read or refused in one line; so is every file of the corpus."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from cobot_joint.diagnosis.checks.inspection import inspect_log
from cobot_joint.diagnosis.data.formats import read_log

Refusal = Callable[..., str]
CORPUS = sorted((Path(__file__).parent / "corpus" / "recordings").iterdir())
NAMES = st.sampled_from(
    [
        "time [s]",
        "t",
        "w [rad/s]",
        "w [rpm]",
        "i [A]",
        "w [9**9**9**9]",
        "[w [0 rad/s]]",
        "",
        "\x1b[31mx",
        "a" * 300,
        "µ",
    ]
)
CELLS = st.one_of(
    st.floats().map(repr),
    st.integers().map(str),
    st.sampled_from(["", "ERR", "nan", "-inf", "1e400", "1,5", "0x1f", "12:30:01", "\x00", '"', "−1", "1e12", "TRUE"]),
)


@st.composite
def logs(draw: st.DrawFn) -> str:
    """A table as loggers write it, some of its cells as none should."""
    width, separator = draw(st.integers(1, 5)), draw(st.sampled_from([",", ";", "\t", " ", "|"]))
    lines = draw(st.lists(st.text(max_size=30), max_size=2))
    lines.append(separator.join(draw(st.lists(NAMES, min_size=width, max_size=width))))
    for k in range(draw(st.integers(0, 40))):
        row = [f"{0.001 * k:.3f}", *(f"{(k * n) % 7}" for n in range(1, width))]
        if draw(st.integers(0, 9)) == 0:
            row[draw(st.integers(0, width - 1))] = draw(CELLS)
        if draw(st.integers(0, 30)) == 0:
            row = row[: draw(st.integers(0, width))]
        lines.append(separator.join(row))
    return draw(st.sampled_from(["\n", "\r\n", "\r"])).join(lines)


def read_or_refused(refusal: Refusal, content: bytes, suffix: str) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"run{suffix}"
        path.write_bytes(content)
        for read in (read_log, inspect_log):
            said = refusal(read, path)
            assert "\n" not in said
            assert "\x1b" not in said


@given(text=logs())
def test_any_table_is_read_or_refused(refusal, text: str) -> None:
    read_or_refused(refusal, text.encode("utf-8", "surrogatepass"), ".csv")


@pytest.mark.parametrize("suffix", [".csv", ".parquet", ".mat", ".tsv"])
@given(content=st.binary(max_size=400))
@example(content=b"PAR1" + bytes(8) + b"PAR1")
@example(content=b"\x89HDF\r\n\x1a\n" + bytes(64))
@example(content=b"MATLAB 5.0 MAT-file" + bytes(200))
def test_any_bytes_are_read_or_refused(refusal: Refusal, suffix: str, content: bytes) -> None:
    read_or_refused(refusal, content, suffix)


@pytest.mark.parametrize("path", CORPUS, ids=lambda p: p.name)
def test_recordings_that_once_were_trouble_are_read_or_refused(refusal, path: Path) -> None:
    read_or_refused(refusal, path.read_bytes(), path.suffix)
