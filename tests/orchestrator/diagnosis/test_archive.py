"""What a diagnosis keeps comes back as it was, and nothing else comes out of a file of unknown origin."""

from __future__ import annotations

import json
import pickle
from dataclasses import dataclass
from pathlib import Path

import joblib
import numpy as np
import pytest

from cobot_joint.diagnosis import archive
from cobot_joint.diagnosis.archive import DamagedError, fingerprint, load, save
from cobot_joint.diagnosis.estimation.effects import ActiveTerm, BaseParameter, LoadPulse, PortSignal, StepOffset
from cobot_joint.diagnosis.estimation.fit import Fit
from cobot_joint.diagnosis.estimation.hypothesis import Hypothesis
from cobot_joint.diagnosis.estimation.problem import Simulated
from cobot_joint.diagnosis.explanation.explanation import Explanation
from cobot_joint.diagnosis.findings import Candidate, Estimate
from cobot_joint.diagnosis.plant.plant import Parameter, Port, ScannedShape, TermCandidate
from cobot_joint.diagnosis.selection.selection import Selected, Selection

VALUES = [
    None, True, 7, -0.0, 1e-300, float("inf"), "Ω", [1, [2.5]], (1, ("a", None)), {"a": 1, (1, 2): [3]}, {"set", "of"},
    frozenset({("a", 1.0), ("b", 2.0)}), {}, (),
]  # fmt: skip


class Evil:
    """What a pickle could carry: creating a file when it is read."""

    def __init__(self, file: Path) -> None:
        self.file = file

    def __reduce__(self) -> tuple:
        return (Path.touch, (self.file,))


def explanation() -> Explanation:
    """A stage as the engine keeps it: nested, every kind of effect, one fit in several places."""
    shape = ScannedShape("m.cogging.n", (1.0, 2.0), 1.0, 8.0, whole=True)
    term = TermCandidate("m.cogging", "m.cogging.A", 0.0, -1.0, np.inf, "N.m", (shape,), "m.cogging.phi_0")
    port, time = Port("m.tau_add", "N.m", ("m.w",)), np.arange(4.0)
    effects = (
        ActiveTerm(term, {"m.cogging.A": 1e-3, "m.cogging.phi_0": 0.5, "m.cogging.n": 2.0}, 1.5),
        PortSignal(port, ("w^2",), ({"run": np.ones(4)},), (0.5,)),
        LoadPulse(port, "run", time, 1.0, (0.5, 1.0, 2.0, 2.5)),
        StepOffset(port, {"run": time}, 0.1, 1.5, 0.2),
    )
    base = BaseParameter(Parameter("m.R", 0.2, "Ohm", 0.0, np.inf), 0.1, 0.3)
    hypothesis = Hypothesis((base,), effects)
    x = hypothesis.start()
    fit = Fit(hypothesis, x, 3.0, np.full(4, np.nan), Simulated(({"w": time},), np.zeros(4)), np.ones((4, len(x))), 7)
    selection = Selection([fit], [Selected("m.cogging", 12.0, {"m.x": 1.0})], [[Candidate("a", 1.0, {}, None)]])
    return Explanation(fit, fit, selection, selection.selected)


@pytest.mark.parametrize("value", VALUES, ids=lambda value: type(value).__name__)
def test_a_plain_value_comes_back_in_its_type(tmp_path: Path, value: object) -> None:
    save(tmp_path / "a.npz", value)
    back = load(tmp_path / "a.npz")
    assert back == value
    assert type(back) is type(value)


@pytest.mark.parametrize("dtype", [float, np.float32, int, bool, complex, "U3", "datetime64[s]"])
@pytest.mark.parametrize("shape", [(), (0,), (3,), (2, 3)])
def test_an_array_comes_back_bit_for_bit(tmp_path: Path, dtype: object, shape: tuple[int, ...]) -> None:
    array = np.arange(12).astype(dtype)[: int(np.prod(shape))].reshape(shape)
    save(tmp_path / "a.npz", {"x": array, "scalar": np.float64(0.1)})
    back = load(tmp_path / "a.npz")
    assert back["x"].dtype == array.dtype
    assert back["x"].shape == array.shape
    assert back["x"].tobytes() == array.tobytes()
    assert type(back["scalar"]) is np.float64


def test_a_stage_of_nested_dataclasses_comes_back_with_what_it_shares(tmp_path: Path) -> None:
    given = explanation()
    save(tmp_path / "a.npz", given)
    back = load(tmp_path / "a.npz")
    assert fingerprint(back) == fingerprint(given)
    assert back.fit is back.calibrated is back.selection.history[0]
    assert back.fit.hypothesis.terms == given.fit.hypothesis.terms
    assert np.array_equal(back.fit.residual, given.fit.residual, equal_nan=True)
    assert back.fit.run.values == given.fit.run.values
    assert np.array_equal(back.fit.run.added["run"]["m.tau_add"], given.fit.run.added["run"]["m.tau_add"])


def test_a_fingerprint_is_of_the_content_and_not_of_the_objects() -> None:
    x = np.arange(3.0)
    assert fingerprint((x, x)) == fingerprint((x.copy(), np.arange(6.0)[::2] / 2))
    assert len({fingerprint(v) for v in ([x], (x,), (x + 1e-300,), (x.astype(np.float32),), (x.reshape(3, 1),))}) == 5


@dataclass
class Elsewhere:
    """A dataclass that is not of the diagnosis."""

    x: int


@pytest.mark.parametrize("value", [Elsewhere(1), Path("a"), np.array([None]), len, 1 + 2j], ids=repr)
def test_what_is_no_plain_value_is_not_kept(tmp_path: Path, value: object) -> None:
    with pytest.raises(TypeError, match="cannot be kept"):
        save(tmp_path / "a.npz", value)


def rewritten(file: Path, old: str, new: str) -> None:
    """The file with its JSON changed and its checksum put right, as someone would who knows the format."""
    with np.load(file) as kept:
        arrays = {name: kept[name] for name in kept.files if name != "sha256"}
    text = arrays["content"].tobytes().decode()
    assert old in text
    arrays["content"] = np.frombuffer(text.replace(old, new).encode(), dtype=np.uint8)
    with file.open("wb") as stream:
        np.savez(stream, sha256=np.frombuffer(archive._digest(arrays), dtype=np.uint8), **arrays)


@pytest.mark.parametrize(
    "name",
    ["subprocess:Popen", "pathlib:Path", "cobot_joint.diagnosis.store:Store", "cobot_joint.units:Unit",
     "cobot_joint.diagnosis.findings:np", "cobot_joint.diagnosis.none:None", "cobot_joint.diagnosis.store:Any.x"],
)  # fmt: skip
def test_no_class_is_made_but_a_dataclass_of_the_diagnosis(tmp_path: Path, name: str) -> None:
    save(tmp_path / "a.npz", Estimate(1.0, "1", (0.9, 1.1)))
    rewritten(tmp_path / "a.npz", "cobot_joint.diagnosis.findings:Estimate", name)
    with pytest.raises(DamagedError):
        load(tmp_path / "a.npz")


def test_a_dataclass_that_has_got_other_fields_is_not_made(tmp_path: Path) -> None:
    save(tmp_path / "a.npz", Estimate(1.0, "1", (0.9, 1.1)))
    rewritten(tmp_path / "a.npz", '"unit"', '"units"')
    with pytest.raises(DamagedError, match="other fields"):
        load(tmp_path / "a.npz")


def test_no_pickle_is_executed(tmp_path: Path) -> None:
    harm = tmp_path / "harm"
    evil = np.array([Evil(harm)], dtype=object)
    joblib.dump(Evil(harm), tmp_path / "joblib.npz")
    (tmp_path / "pickle.npz").write_bytes(pickle.dumps(Evil(harm)))
    np.savez(tmp_path / "objects.npz", content=evil, sha256=evil)
    with (tmp_path / "npy.npz").open("wb") as stream:
        np.save(stream, evil)
    for file in tmp_path.glob("*.npz"):
        with pytest.raises(DamagedError):
            load(file)
    assert not harm.exists()


def test_another_name_and_every_single_changed_byte_is_noticed(tmp_path: Path) -> None:
    file = tmp_path / "a.npz"
    save(file, {"x": np.arange(8.0), "y": "text"}, "fit-1")
    with pytest.raises(DamagedError, match="another name"):
        load(file, "fit-2")
    whole = file.read_bytes()
    expected = fingerprint(load(file, "fit-1"))
    believed = []
    for position in range(len(whole)):
        file.write_bytes(whole[:position] + bytes([whole[position] ^ 0x55]) + whole[position + 1 :])
        try:
            if fingerprint(load(file, "fit-1")) != expected:
                believed.append(position)
        except DamagedError:
            pass
    assert believed == []  # a date in the zip's directory may change without changing what is read


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04", b"\x93NUMPY", b"{}", b"[" * 100_000])
def test_what_is_no_archive_is_damaged(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "a.npz").write_bytes(content)
    with pytest.raises(DamagedError):
        load(tmp_path / "a.npz")


def test_json_that_nests_without_end_is_damaged(tmp_path: Path) -> None:
    save(tmp_path / "a.npz", "here")
    rewritten(tmp_path / "a.npz", json.dumps("here"), "[" * 100_000 + "]" * 100_000)
    with pytest.raises(DamagedError):
        load(tmp_path / "a.npz")
