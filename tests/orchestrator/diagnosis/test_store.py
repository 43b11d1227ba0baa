"""What was finished is found again; what was not, or what changed, is computed."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from cobot_joint.diagnosis.store import Store, plain


def test_a_finished_stage_is_not_computed_again_by_a_later_store(tmp_path: Path) -> None:
    calls = []

    def compute() -> np.ndarray:
        calls.append(1)
        return np.arange(3.0)

    for _ in range(2):
        kept = Store(tmp_path / ".work", {"version": 1}).remember("calibrate", {"x": np.ones(3)}, compute)
        assert np.array_equal(kept, np.arange(3.0))
    assert len(calls) == 1


@pytest.mark.parametrize(("basis", "stage", "inputs"), [(2, "fit", 0.0), (1, "rank", 0.0), (1, "fit", 1e-300)])
def test_another_basis_stage_or_input_is_computed(tmp_path: Path, basis: int, stage: str, inputs: float) -> None:
    Store(tmp_path, 1).remember("fit", 0.0, lambda: "old")
    assert Store(tmp_path, basis).remember(stage, inputs, lambda: "new") == "new"


def test_a_stage_that_is_interrupted_leaves_nothing_behind(tmp_path: Path) -> None:
    def interrupted() -> str:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        Store(tmp_path, 1).remember("fit", 0.0, interrupted)
    assert list(tmp_path.iterdir()) == []
    assert Store(tmp_path, 1).remember("fit", 0.0, lambda: "whole") == "whole"


@pytest.mark.parametrize("change", [lambda b: b[:100], lambda b: b.replace(b"old", b"new"), lambda b: b"\x80\x04."])
def test_a_damaged_or_tampered_file_is_computed_again_with_a_message(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, change: Callable[[bytes], bytes]
) -> None:
    Store(tmp_path, 1).remember("fit", 0.0, lambda: "old")
    (file,) = tmp_path.iterdir()
    file.write_bytes(change(file.read_bytes()))
    assert Store(tmp_path, 1).remember("fit", 0.0, lambda: "whole") == "whole"
    assert f"{file}: it cannot be read" in caplog.text or "its checksum does not match" in caplog.text
    assert "'fit' is computed again" in caplog.text
    assert Store(tmp_path, 1).remember("fit", 0.0, lambda: "not called") == "whole"


def test_a_store_without_a_folder_keeps_nothing() -> None:
    count = iter(range(2))
    assert [Store(None).remember("fit", 0, lambda: next(count)) for _ in range(2)] == [0, 1]


def test_numbers_become_plain_json() -> None:
    assert plain({"a": np.float64(1.5), "b": np.array([1, 2]), "c": np.nan, "d": np.bool_(True)}) == {
        "a": 1.5,
        "b": [1, 2],
        "c": None,
        "d": True,
    }
