"""A unit that crashes, leaves, hangs or eats all memory takes its own process with it, and nothing else."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from cobot_joint import cli
from cobot_joint.cosim import Experiment, Simulation, SimulationError, isolation, simulate
from cobot_joint.errors import UserError
from cobot_joint.results.files import read_provenance
from cobot_joint.system import Component, Connection, Connector, Inputs, System, load_system, write_ssp
from cobot_joint.units import load_unit

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="units in processes of their own need POSIX")

SEGV, FPE, ABRT = "crashed (SIGSEGV: ", "crashed (SIGFPE: ", "crashed (SIGABRT: "
LATE = "did not return within 0.5 s (--time-limit)"
WAYS = {
    "segv": SEGV, "call": SEGV, "stack": SEGV, "fpe": FPE, "abort": ABRT, "assert": ABRT, "memory": ABRT,
    "kill": "crashed (SIGKILL: ", "term": "crashed (Terminated)", "exit": "ended its process: exit(0)",
    "quit": "ended its process: exit(3)", "loop": LATE, "sleep": LATE,
    "stop": LATE, "print": LATE,
}  # fmt: skip
CALLS = ("Instantiate", "SetupExperiment", "EnterInitializationMode", "ExitInitializationMode", "SetReal", "GetReal",
         "DoStep", "GetFMUstate", "FreeInstance")  # fmt: skip
RUN = Experiment(Inputs(np.array([0.0, 1.0]), {"u": np.array([1.0, 3.0])}), 0.2, output_step=1e-3, scheme="adaptive")

MakeComponent = Callable[..., Component]


@pytest.fixture(autouse=True)
def _limits(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(isolation.WHICH, "foreign")
    monkeypatch.setenv(isolation.TIME_LIMIT, "0.5")
    monkeypatch.setenv(isolation.MEMORY_LIMIT, "200")


def system_of(component: Component) -> System:
    name = component.name
    wires = (Connection(None, "u", name, "u"), Connection(name, "y", None, "y"))
    return System("crash", (component,), wires, {"u": Connector("u", "input")}, {"y": Connector("y", "output")})


def hosts(parent: int | None = None) -> list[str]:
    """Of that process, by default this one, or of one that is gone; tests may run beside each other."""
    lines = subprocess.run(["ps", "-ewwo", "ppid,args"], capture_output=True, text=True, check=True).stdout.splitlines()
    ours = [line for line in lines if line.split(maxsplit=1)[0] in (str(parent or os.getpid()), "1")]
    return [line for line in ours if "cosim_host" in line and "crash.so" in line]


def limit_time(way: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """To fill 200 MB takes a busy machine more than half a second."""
    if way == "memory":
        monkeypatch.setenv(isolation.TIME_LIMIT, "20")


@pytest.mark.parametrize(
    ("way", "call"),
    [
        pytest.param(way, call, marks=() if call == "DoStep" or way in ("segv", "exit") else pytest.mark.long)
        for way in WAYS
        for call in CALLS
    ],
)
def test_every_way_in_every_call_is_an_error_with_unit_call_and_time(
    make_component: MakeComponent, monkeypatch: pytest.MonkeyPatch, way: str, call: str
) -> None:
    limit_time(way, monkeypatch)
    name = f"{way}_in_{call}"
    with pytest.raises(SimulationError) as failed:
        simulate(system_of(make_component(name, "crash")), RUN)
    said = str(failed.value)
    assert said.startswith(f"{name}")
    assert f"fmi2{call} at t = " in said
    assert WAYS[way] in said
    assert hosts() == []


def write_crash_scenario(component: Component, folder: Path) -> None:
    write_ssp(system_of(component), folder / "crash.ssp")
    (folder / "crash.toml").write_text('system = "crash.ssp"\nstop_time = 0.2\n[inputs.u]\npoints = [[0, 1], [1, 3]]\n')


def on_the_command_line(
    component: Component, folder: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str], *more: str
) -> tuple[object, str]:
    """Status and stderr of `cobot-joint run`."""
    write_crash_scenario(component, folder)
    monkeypatch.setattr(
        sys, "argv", ["cobot-joint", "run", str(folder / "crash.toml"), "--out", str(folder / "out"), *more]
    )
    with pytest.raises(SystemExit) as left:
        cli.main()
    return left.value.code, capfd.readouterr().err


@pytest.mark.parametrize("way", WAYS)
def test_run_says_one_line_keeps_the_rows_until_then_and_exits_with_1(
    make_component: MakeComponent, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str],
    way: str,
) -> None:  # fmt: skip
    limit_time(way, monkeypatch)
    status, said = on_the_command_line(make_component(f"{way}_in_DoStep", "crash"), tmp_path, monkeypatch, capfd)
    assert status == 1
    assert said.count("\n") == 1
    assert said.startswith(f"cobot-joint: {way}_in_DoStep: fmi2DoStep at t = 0.0")
    assert WAYS[way] in said
    assert "; last inputs u = 1.1" in said
    assert [p.name for p in (tmp_path / "out").iterdir()] == ["signals.parquet"]
    table = pq.read_table(tmp_path / "out" / "signals.parquet")
    time, y = table["time [s]"].to_numpy(), table["y [1]"].to_numpy()
    assert f"signals.parquet has the {len(time)} rows until then" in said
    assert 0.04 < time[-1] < 0.08
    np.testing.assert_allclose(y, 2 * (1 + 2 * time), rtol=1e-12)
    assert WAYS[way] in read_provenance(tmp_path / "out" / "signals.parquet")["failure"]
    assert hosts() == []


def test_memory_beyond_the_limit_is_told(make_component: MakeComponent, tmp_path: Path) -> None:
    write_crash_scenario(make_component("memory_in_DoStep", "crash"), tmp_path)
    command = [sys.executable, "-m", "cobot_joint", "run", "crash.toml", "--memory-limit", "400", "--time-limit", "20"]
    ended = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert ended.returncode == 1
    assert re.search(r"; it held 3\d\d MB, 400 MB are allowed \(--memory-limit\)", ended.stderr), ended.stderr


def test_memory_of_the_process_that_simulates_is_not_told_as_the_units(make_component: MakeComponent) -> None:
    """Until a process has more than its parent had, its resource usage is its parent's."""
    held = np.ones(int(400e6) // 8)
    with pytest.raises(SimulationError) as failed:
        simulate(system_of(make_component("sleep_in_DoStep", "crash")), RUN)
    assert held.sum() == len(held)
    assert LATE in str(failed.value)
    assert "it held" not in str(failed.value)


def test_what_the_unit_printed_is_told(make_component: MakeComponent) -> None:
    with pytest.raises(SimulationError, match=r"; it printed: unit\.c:7: assertion x > 0 failed"):
        simulate(system_of(make_component("assert_in_DoStep", "crash")), RUN)


def test_limits_are_options(
    make_component: MakeComponent, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    begun = time.monotonic()
    status, said = on_the_command_line(
        make_component("sleep_in_DoStep", "crash"), tmp_path, monkeypatch, capfd, "--time-limit", "0.2"
    )
    assert (status, "within 0.2 s" in said, time.monotonic() - begun < 5) == (1, True, True)
    status, said = on_the_command_line(
        make_component("sleep_in_DoStep", "crash"), tmp_path, monkeypatch, capfd, "--time-limit", "-1"
    )
    assert (status, said) == (
        2, "cobot-joint: --time-limit '-1' is given, a positive number is allowed: seconds of one call of a unit\n"
    )  # fmt: skip


def test_a_unit_that_crashed_runs_again(make_component: MakeComponent) -> None:
    with Simulation(system_of(make_component("segv_in_DoStep", "crash"))) as simulation:
        for _ in range(3):
            with pytest.raises(SimulationError, match="SIGSEGV"):
                simulation.run(RUN)


def test_a_run_that_is_killed_leaves_no_process(make_component: MakeComponent, tmp_path: Path) -> None:
    write_ssp(system_of(make_component("sleep_in_DoStep", "crash")), tmp_path / "crash.ssp")
    command = [sys.executable, "-m", "cobot_joint", "run", "crash.ssp", "--time-limit", "60"]
    running = subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.PIPE)
    while not hosts(running.pid):
        assert running.poll() is None
        time.sleep(0.05)
    running.kill()
    running.communicate()
    deadline = time.monotonic() + 5
    while hosts() and time.monotonic() < deadline:
        time.sleep(0.05)
    assert hosts() == []


def test_ctrl_c_does_not_wait_for_a_unit_that_hangs(make_component: MakeComponent, tmp_path: Path) -> None:
    write_ssp(system_of(make_component("sleep_in_DoStep", "crash")), tmp_path / "crash.ssp")
    command = [sys.executable, "-m", "cobot_joint", "run", "crash.ssp", "--time-limit", "60"]
    running = subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.PIPE, text=True)
    while not hosts(running.pid):
        assert running.poll() is None
        time.sleep(0.05)
    time.sleep(0.5)
    running.send_signal(signal.SIGINT)
    _, said = running.communicate(timeout=20)
    assert (running.returncode, said) == (130, "cobot-joint: interrupted\n")
    assert hosts() == []


def test_a_truncated_library_is_refused_before_it_is_in_this_process(
    make_component: MakeComponent, tmp_path: Path
) -> None:
    whole = make_component("whole", "crash").unit
    library = isolation.library_of(whole)
    name = library.relative_to(whole.directory).as_posix()
    for size in (0, 100, 4096, library.stat().st_size // 2):
        with zipfile.ZipFile(tmp_path / f"{size}.fmu", "w") as archive:
            archive.writestr("modelDescription.xml", (whole.directory / "modelDescription.xml").read_bytes())
            archive.writestr(name, library.read_bytes()[:size])
        with pytest.raises(UserError, match="its library cannot be opened"):
            Simulation(system_of(Component("cut", "cut.fmu", load_unit(tmp_path / f"{size}.fmu"))))


def test_shipped_units_are_known_by_their_bytes() -> None:
    system = load_system("joint")
    assert all(isolation.is_shipped(c.unit) for c in system.components)
    assert not any(isolation.is_isolated(c.unit) for c in system.components)


def test_an_isolated_run_gives_the_same_bits(monkeypatch: pytest.MonkeyPatch) -> None:
    system = load_system("joint_no_load_logged")
    step = Inputs(np.array([0.0, 0.1, 0.5]), {"v_command": np.array([0.0, 12.0, 12.0])})
    experiment = Experiment(step, 0.6, parameter_events=[(0.3, {"motor_bldc.winding.R": 0.3})])
    here = simulate(system, experiment)
    monkeypatch.setenv(isolation.WHICH, "all")
    there = simulate(system, experiment)
    assert all(np.array_equal(here[name], there[name]) for name in here.signals)
    assert here.energy == there.energy
