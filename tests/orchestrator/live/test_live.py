"""The live page: sliders do to the simulation what they say, what is saved is what was seen, and only who was told the
address may look.
"""

from __future__ import annotations

import copy
import json
import os
import signal
import subprocess
import sys
import threading
import tomllib
import urllib.error
import urllib.request
from collections.abc import Iterator
from http.cookiejar import CookieJar
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest

from cobot_joint import cli
from cobot_joint.cosim import Experiment, Simulation
from cobot_joint.diagnosis.data.campaign import load_campaign
from cobot_joint.diagnosis.data.recording import Recording
from cobot_joint.diagnosis.plant.simulator import Simulator
from cobot_joint.diagnosis.repair.repair import repair
from cobot_joint.diagnosis.repair.verify import write_json
from cobot_joint.errors import UserError
from cobot_joint.live.bench import LONGEST, LiveBench
from cobot_joint.live.save import save_campaign, save_system, toml
from cobot_joint.live.what_if import WhatIf, _rivals, campaign_of
from cobot_joint.system import load_system
from cobot_joint.system.model import Inputs

pytest.importorskip("dash", reason="the extra [live] is not installed")

from cobot_joint.live.bench_page import BenchPage
from cobot_joint.live.results_page import ResultsPage
from cobot_joint.live.server import Server

A, ONSET, NOISE = 4e-3, 1.0, {"i_motor": 4e-3, "w_motor": 0.3}
AMPLITUDE, R = "motor_bldc.cogging.A", "motor_bldc.winding.R"
UNITS = {"v_command": "V", "i_motor": "A", "w_motor": "rad/s"}


def estimate(value: float, unit: str) -> dict[str, Any]:
    return {"value": value, "unit": unit, "ci95": [0.9 * value, 1.1 * value]}


def finding(**further: Any) -> dict[str, Any]:
    return {
        "term": "motor_bldc.cogging", "equivalent": [], "component": "motor_bldc", "confidence": 0.95, "onset": ONSET,
        "parameters": {}, "where": {}, "shape": None,
    } | further  # fmt: skip


def diagnosed(folder: Path, found: dict[str, Any], repaired: dict[str, Any]) -> Path:
    """A campaign with two runs in which cogging sets in, and a folder as `diagnose` leaves it."""
    text = 'title = "Cogging"\nsystem = "joint"\n[tolerances]\n"motor_bldc.winding.R" = "5 %"\n'
    t = np.arange(2001) * 1e-3
    for seed, role in enumerate(("train", "holdout")):
        inputs = {"v_command": np.interp(t, [0.2, 0.5], [0.0, 6.0 + seed])}
        outputs = {name: np.zeros(len(t)) for name in NOISE}
        with Simulator({"no_load": load_system("joint_no_load_logged")}, {AMPLITUDE: A}, {AMPLITUDE: ONSET}) as bench:
            signals = bench(Recording(role, "train", "no_load", t, inputs, outputs, UNITS))
        rng = np.random.default_rng(seed)
        noisy = {n: x + NOISE[n] * rng.standard_normal(len(t)) for n, x in signals.items()}
        columns = {"time [s]": t} | {f"{n} [{UNITS[n]}]": x for n, x in (inputs | noisy).items()}
        pa.parquet.write_table(pa.table(columns), folder / f"{role}.parquet")
        text += f'[[recording]]\nfile = "{role}.parquet"\nsetup = "no_load"\nrole = "{role}"\n'
    (folder / "campaign.toml").write_text(text)
    calibrated = {R: estimate(0.209, "Ohm")}
    channels = {name: {"noise": sigma} for name, sigma in NOISE.items()}
    d = {
        "verdict": "explained", "findings": [found], "calibrated": calibrated, "repaired": calibrated | repaired,
        "channels": channels, "campaign": "../campaign.toml",
    }  # fmt: skip
    repair(d, load_campaign(folder / "campaign.toml").systems(), folder / "results")
    write_json(folder / "results" / "diagnosis.json", d)
    return folder / "results"


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Iterator[WhatIf]:
    folder = diagnosed(tmp_path_factory.mktemp("named"), finding(), {AMPLITUDE: estimate(A, "N.m")})
    with WhatIf(folder, load_campaign(campaign_of(folder, None))) as found:
        yield found


@pytest.fixture(scope="module")
def unlisted(tmp_path_factory: pytest.TempPathFactory) -> Iterator[WhatIf]:
    n = float(load_system("joint").component("motor_bldc").unit.variables["cogging.n"].start)
    feature = {"form": f"sin({n:g}*phi)", "coefficient": estimate(-A, "N.m")}
    shape = {
        "port": "motor_bldc.tau_add", "unit": "N.m", "signals": ["phi"], "formula": "A*sin", "features": [feature]
    }  # fmt: skip
    found = finding(term="motor_bldc.unlisted", shape=shape)
    folder = diagnosed(tmp_path_factory.mktemp("unlisted"), found, {})
    with WhatIf(folder, load_campaign(campaign_of(folder, None))) as loaded:
        yield loaded


def test_a_terms_slider_reaches_from_neutral_to_twice_what_was_found(results: WhatIf) -> None:
    sliders = {s.name: s for s in results.sliders}
    assert (sliders[AMPLITUDE].low, sliders[AMPLITUDE].high, sliders[AMPLITUDE].found) == (0.0, 2 * A, A)
    assert sliders[R].low < 0.95 * 0.209 < 1.05 * 0.209 < sliders[R].high


def test_a_parameter_that_its_unit_allows_one_value_has_no_slider(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = diagnosed(tmp_path, finding(), {})
    monkeypatch.setattr("cobot_joint.live.what_if._within", lambda bounds, low, high: (low, low))
    with WhatIf(folder, load_campaign(campaign_of(folder, None))) as loaded:
        assert loaded.sliders == []


def test_unmoved_sliders_leave_noise_and_neutral_ones_the_calibrated_error(results: WhatIf) -> None:
    names = results.first_shown
    assert names == ["train", "holdout"]
    for channel, error in results.rms(results.simulate({}, names)).items():
        assert error == pytest.approx(NOISE[channel], rel=0.06)
    neutral = results.rms(results.simulate({AMPLITUDE: 0.0}, names))
    calibrated = results.rms({name: results.calibrated(name) for name in names})
    assert neutral["w_motor"] == pytest.approx(calibrated["w_motor"], rel=1e-3)
    assert neutral["w_motor"] > 1.15 * NOISE["w_motor"]


def test_a_term_that_sets_in_during_the_run_still_does_with_another_amplitude(results: WhatIf) -> None:
    without, twice = (results.simulate({AMPLITUDE: x}, ["train"])["train"]["w_motor"] for x in (0.0, 2 * A))
    at = int(ONSET / 1e-3)
    assert np.abs(twice - without)[:at].max() < 1e-6
    assert np.abs(twice - without)[at:].max() > 1.0


def test_an_effect_without_a_name_has_a_slider_from_none_of_it_to_twice_of_it(unlisted: WhatIf) -> None:
    term = "motor_bldc.unlisted"
    (slider,) = (s for s in unlisted.sliders if s.kind == "share")
    assert (slider.name, slider.low, slider.found, slider.high) == (term, 0.0, 1.0, 2.0)
    none = unlisted.simulate({term: 0.0}, ["train"])["train"]["w_motor"]
    assert none == pytest.approx(unlisted.calibrated("train")["w_motor"], abs=1e-3)
    assert np.abs(unlisted.simulate({}, ["train"])["train"]["w_motor"] - none).max() > 0.5


def test_a_rival_starts_switched_off_and_takes_the_shape_of_what_was_found(results: WhatIf) -> None:
    d = copy.deepcopy(results.diagnosis)
    d["findings"] = [finding(term="motor_bldc.stribeck", equivalent=["planetary_gear.stribeck"], parameters={
        "tau_S": estimate(2e-3, "N.m"), "w_S": estimate(12.0, "rad/s")
    })]  # fmt: skip
    d["repaired"]["motor_bldc.stribeck.tau_S"] = estimate(2e-3, "N.m")
    (rival,) = _rivals(d, results.nominal)
    assert (rival.name, rival.found, rival.low, rival.high) == ("planetary_gear.stribeck.tau_S", 0.0, 0.0, 4e-3)
    assert rival.beside["planetary_gear.stribeck.w_S"] == 12.0


def test_a_saved_system_runs_as_the_sliders_stood(results: WhatIf) -> None:
    moved = {AMPLITUDE: 1.5 * A, R: 0.2}
    file = next(f for f in save_system(results, moved) if "no_load" in f.name)
    recording = results.recording("train")
    with Simulator({"no_load": load_system(file)}) as saved:
        alone = saved(recording)["w_motor"]
    moved_here = results.simulate(moved, ["train"])["train"]["w_motor"]  # rad/s; of another scheme, noise is 0.3
    assert alone == pytest.approx(moved_here, abs=1e-2)


def test_a_saved_campaign_starts_from_the_sliders_and_says_what_it_cannot_hold(results: WhatIf) -> None:
    path, without = save_campaign(results, {R: 0.2})
    campaign = load_campaign(path)
    assert campaign.systems()["no_load"].component("motor_bldc").parameters["winding.R"] == 0.2
    assert [r.name for r in campaign.recordings] == ["train", "holdout"]
    assert without == ["motor_bldc.cogging's onset"]


def test_toml_that_is_written_reads_back() -> None:
    content = {
        "title": 'a "b" \\ ü\n', "n": 3, "x": 1e-7, "yes": True, "list": ["a", 1.5],
        "channels": {"w [rad/s]": {"to": "w", "sign": -1}}, "recording": [{"file": ["a", "b"]}, {"file": "c"}],
    }  # fmt: skip
    assert tomllib.loads(toml(content)) == content


@pytest.mark.parametrize(
    ("content", "why"),
    [
        ({}, "it does not name its campaign; say where it is with --campaign"),
        ({"campaign": "gone.toml"}, "its campaign gone.toml is not there"),
        ({"readings": []}, "a frequency response is given, results of runs over time are allowed"),
    ],
)
def test_results_without_recordings_are_refused_in_words(tmp_path: Path, content: dict, why: str) -> None:
    needed = {key: {} for key in ("verdict", "findings", "calibrated", "repaired", "channels")}
    write_json(tmp_path / "diagnosis.json", needed | content)
    with pytest.raises(UserError, match=why):
        campaign_of(tmp_path, None)


class Browser:
    """What a browser does with a Dash page: it keeps cookies, reads what there is to call, and calls it."""

    def __init__(self, server: Server) -> None:
        self.origin = server.address.split("/?")[0]
        self._opener = urllib.request.build_opener(urllib.request.HTTPCookieProcessor(CookieJar()))
        self.page = self.get(server.address.removeprefix(self.origin))

    def get(self, path: str) -> str:
        with self._opener.open(self.origin + path, timeout=20) as answer:
            return answer.read().decode()

    def call(self, output: str, inputs: list[Any], states: list[Any]) -> dict[str, Any]:
        """The first callback with that output. inputs, states: values; of a pattern, one per component."""
        of = next(
            d for d in json.loads(self.get("/_dash-dependencies")) if output in d["output"] and self._fits(d, inputs)
        )
        names = [part.rpartition(".") for part in of["output"].strip(".").split("...")]
        outputs = [{"id": _id(name), "property": prop} for name, _, prop in names]
        body = {
            "output": of["output"],
            "outputs": outputs if of["output"].startswith("..") else outputs[0],
            "inputs": _filled(of["inputs"], inputs),
            "state": _filled(of["state"], states),
            "changedPropIds": [],
        }
        request = urllib.request.Request(
            f"{self.origin}/_dash-update-component", json.dumps(body).encode(), {"Content-Type": "application/json"}
        )
        with self._opener.open(request, timeout=20) as answer:
            return json.loads(answer.read())["response"]

    @staticmethod
    def _fits(dependency: dict[str, Any], inputs: list[Any]) -> bool:
        patterns = ["{" in i["id"] for i in dependency["inputs"]]
        return patterns == [isinstance(x, list) and not isinstance(x[0], str) for x in inputs]


def _id(name: str) -> Any:
    return json.loads(name) if name.startswith("{") else name


def _filled(wanted: list[dict[str, Any]], values: list[Any]) -> list[Any]:
    found = []
    for one, value in zip(wanted, values, strict=True):
        if "{" in one["id"]:
            kind = json.loads(one["id"])["slider"]
            found.append(
                [{"id": {"n": n, "slider": kind}, "property": "value", "value": x} for n, x in enumerate(value)]
            )
        else:
            found.append({"id": one["id"], "property": one["property"], "value": value})
    return found


@pytest.fixture(scope="module")
def served(results: WhatIf) -> Iterator[tuple[ResultsPage, Server]]:
    page = ResultsPage(results)
    server = Server(page.app)
    thread = threading.Thread(target=server.serve, daemon=True)
    thread.start()
    yield page, server
    server.close()
    thread.join(timeout=10)


@pytest.mark.parametrize(
    ("path", "host"),
    [("/", None), ("/?token=guessed", None), ("/_dash-layout", None), ("TOKEN", "evil.example")],
)
def test_who_lacks_the_token_or_comes_by_another_name_is_refused(
    served: tuple[ResultsPage, Server], path: str, host: str | None
) -> None:
    address = served[1].address
    origin = address.split("/?")[0]
    url = address if path == "TOKEN" else origin + path
    request = urllib.request.Request(url, headers={"Host": host} if host else {})
    with pytest.raises(urllib.error.HTTPError) as refused:
        urllib.request.urlopen(request, timeout=20)
    assert refused.value.code == 403
    assert address.startswith("http://127.0.0.1:")


def test_the_page_loads_nothing_from_elsewhere(served: tuple[ResultsPage, Server]) -> None:
    page = Browser(served[1]).page
    assert "//" not in page.replace("http://127.0.0.1", "").split("<style>")[0]
    assert 'src="http' not in page


def test_a_moved_slider_changes_the_picture_and_the_rms_of_the_page(served: tuple[ResultsPage, Server]) -> None:
    page, server = served
    browser = Browser(server)
    layout = browser.get("/_dash-layout")
    assert layout.count('"Slider"') == len(page.sliders) == 2
    found = [s.found for s in page.sliders]
    drawn = browser.call("figure.figure", [["train"]], [found])
    names = [trace["name"] for trace in drawn["figure"]["figure"]["data"]]
    assert names.count("repaired") == names.count("calibrated") == 2 * names.count("recorded")
    moved = browser.call("figure.figure", [[0.0, found[1]]], [["train"]])
    changed = {int(o["location"][1]) for o in moved["figure"]["figure"]["operations"]}
    assert changed == {n for n, name in enumerate(names) if name == "repaired"}
    assert json.dumps(drawn["rms"]) != json.dumps(moved["rms"])


def test_the_button_saves_what_the_sliders_say(served: tuple[ResultsPage, Server]) -> None:
    page, server = served
    said = Browser(server).call("saved.children", [1], [[s.found for s in page.sliders]])
    assert "repaired.ssp" in json.dumps(said)


def test_of_moves_that_wait_only_the_latest_is_simulated(results: WhatIf, monkeypatch: pytest.MonkeyPatch) -> None:
    page = ResultsPage(results)
    begun, go_on, runs = threading.Event(), threading.Event(), []

    def simulate(moved: dict[str, float], names: list[str]) -> Any:
        runs.append(moved.get(AMPLITUDE))
        begun.set()
        go_on.wait(10)
        return {name: results.calibrated(name) for name in names}

    monkeypatch.setattr(results, "simulate", simulate)
    threads = []
    for n, x in enumerate((0.001, 0.002, 0.003)):
        threads.append(threading.Thread(target=page.move, args=([x, 0.209], ["train"])))
        threads[-1].start()
        assert begun.wait(10)
        while page._latest < n + 1:
            threading.Event().wait(0.01)
    go_on.set()
    for thread in threads:
        thread.join(10)
    assert runs == [0.001, 0.003]


def test_the_bench_runs_as_its_sliders_were_moved() -> None:
    with LiveBench(load_system("joint")) as bench:
        assert bench.advance(0.5, {"v_command": 0.0}) is not None
        result = bench.advance(2.0, {"v_command": 9.0})
        assert result is not None
        assert np.abs(result["w_motor"][result.time < 0.5]).max() < 1e-9
        assert result["w_motor"][-1] > 300
        assert bench.advance(1.0, {}) is None
        inputs = Inputs(np.array([0.0, 0.5, 0.55, 2.0]), {"v_command": np.array([0.0, 0.0, 9.0, 9.0])})
        with Simulation(load_system("joint")) as one:
            whole = one.run(Experiment(inputs, 2.0, output_step=5e-3))
        assert result["w_motor"] == pytest.approx(whole["w_motor"])
        bench.restart()
        assert bench.now == 0.0


def test_the_page_of_the_bench_says_when_its_time_is_over(monkeypatch: pytest.MonkeyPatch) -> None:
    with LiveBench(load_system("joint")) as bench:
        page = BenchPage(bench)
        page.again(None)
        monkeypatch.setattr("cobot_joint.live.bench_page.time.monotonic", lambda: page.begun + LONGEST + 1)
        figure, said = page.tick(1, [12.0, 0.0, 0.0])
        assert said.startswith("60.0 s: i_motor")
        assert len(figure.data) == 4
        assert page.tick(2, [12.0, 0.0, 0.0])[1] == "60 s are over. Begin again."


def test_without_the_extra_one_line_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "dash", None)
    assert cli._status(["open", "somewhere"]) == 2
    said = capsys.readouterr().err
    assert said == "cobot-joint: open: dash is not installed, `pip install cobot-joint[live]` brings it\n"


@pytest.mark.skipif(os.name != "posix", reason="signals are POSIX's")
def test_the_command_says_one_address_serves_it_and_ends_with_ctrl_c(results: WhatIf) -> None:
    program = "from cobot_joint.cli import main; main()"
    command = [sys.executable, "-c", program, "open", str(results.folder), "--no-browser"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            address = process.stdout.readline().strip()
            with urllib.request.urlopen(address, timeout=20) as answer:
                assert answer.status == 200
            process.send_signal(signal.SIGINT)
            _, said = process.communicate(timeout=20)
        finally:
            process.kill()
    assert process.returncode == 130
    assert said.strip() == "cobot-joint: interrupted"
