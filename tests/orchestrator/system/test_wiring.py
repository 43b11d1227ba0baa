"""Wires of a system: what is refused, what is converted."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import pi

import pytest

from cobot_joint.errors import UserError
from cobot_joint.system import Connection, System, check, load_system
from cobot_joint.system.wiring import unconnected, warn_of_unconnected

Pair = Callable[..., System]
Wire = Callable[..., str]
IN_RPM = '<ssd:Connector name="speed" kind="output"><ssc:Real unit="rpm"/></ssd:Connector>'
RPM = '<ssc:Unit name="rpm"><ssc:BaseUnit rad="1" s="-1" factor="0.10471975511965977"/></ssc:Unit>'


def test_convertible_units_are_converted(pair: Pair, wire: Wire) -> None:
    (connection,) = pair(wire("motor.w", "meter.w")).connections
    assert connection.factor * 100 * pi == pytest.approx(3000)  # rad/s to rpm
    assert connection.offset == 0


def test_offset_of_a_unit_is_converted(pair: Pair, wire: Wire) -> None:
    (connection,) = pair(wire("motor.T", "meter.T")).connections
    assert connection.factor * 25 + connection.offset == pytest.approx(298.15)  # degC to K


def test_transformation_acts_in_the_sinks_unit(pair: Pair, wire: Wire, line: str) -> None:
    (connection,) = pair(wire("motor.w", "meter.w", line)).connections
    assert connection.factor * 100 * pi + connection.offset == pytest.approx(2 * 3000 + 5)


def test_suppressed_conversion_leaves_the_transformation_alone(pair: Pair, wire: Wire, line: str) -> None:
    (connection,) = pair(wire("motor.w", "meter.w", line, suppressUnitConversion="true")).connections
    assert (connection.factor, connection.offset) == (2, 5)


def test_suppressed_conversion_takes_units_that_do_not_convert(pair: Pair, wire: Wire) -> None:
    (connection,) = pair(wire("motor.w", "meter.tau", suppressUnitConversion="true")).connections
    assert (connection.factor, connection.offset) == (1, 0)


def test_ends_without_unit_are_passed_on(pair: Pair, wire: Wire) -> None:
    (connection,) = pair(wire("motor.free", "meter.tau")).connections
    assert (connection.factor, connection.offset) == (1, 0)


def test_systems_own_connector_is_converted(pair: Pair, wire: Wire) -> None:
    system = pair(wire("motor.w", "speed"), connectors=IN_RPM, units=RPM)
    assert system.connections[0].factor * 100 * pi == pytest.approx(3000)
    assert system.outputs["speed"].unit == "rpm"


def test_systems_own_connector_takes_type_and_unit_from_what_it_is_wired_to(pair: Pair, wire: Wire) -> None:
    bare = '<ssd:Connector name="count" kind="output"/><ssd:Connector name="speed" kind="output"/>'
    system = pair(wire("motor.n", "count") + wire("motor.w", "speed"), connectors=bare)
    assert (system.outputs["count"].type, system.outputs["speed"].unit) == ("Integer", "rad/s")


def test_direction_comes_from_the_ends_not_from_their_order(pair: Pair, wire: Wire) -> None:
    assert pair(wire("meter.w", "motor.w")).connections == pair(wire("motor.w", "meter.w")).connections


@pytest.mark.parametrize(
    ("start", "end", "words"),
    [
        ("motor.w", "meter.tau", ["motor.w [rad/s]", "meter.tau [N.m]", "s-1.rad does not convert to kg.m2.s-2"]),
        ("motor.w", "meter.d", ["[furlong] is given no BaseUnit"]),
        ("motor.n", "meter.w", ["motor.n (Integer)", "meter.w (Real)"]),
        ("motor.w", "meter.on", ["motor.w (Real)", "meter.on (Boolean)"]),
        ("motor.x", "meter.w", ["motor.x is no variable of motor.fmu", "w, T, n, tau, free"]),
        ("motor.R", "meter.w", ["motor.R is a parameter of motor.fmu"]),
        ("rotor.w", "meter.w", ["there is no component 'rotor'", "there are motor, meter"]),
        ("motor.w", "meter.y", ["motor.w and meter.y", "both give a value"]),
        ("motor.tau", "meter.w", ["both take a value"]),
        ("motor.w", "speed", ["the system has no connector 'speed'"]),
    ],
)
def test_wire_that_does_not_fit_is_refused_with_both_ends_and_what_is_allowed(
    pair: Pair, wire: Wire, start: str, end: str, words: list[str]
) -> None:
    with pytest.raises(UserError) as refused:
        pair(wire(start, end))
    for word in words:
        assert word in str(refused.value)
    assert "system.ssd" in str(refused.value)


def test_sink_with_two_sources_is_refused(pair: Pair, wire: Wire) -> None:
    with pytest.raises(
        UserError, match=r"two sources feed one sink.*: motor\.free -> meter\.free and motor\.T -> meter\.free"
    ):
        pair(wire("motor.free", "meter.free") + wire("motor.w", "meter.w") + wire("motor.T", "meter.free"))


def test_output_of_the_system_that_nothing_feeds_is_refused(pair: Pair) -> None:
    with pytest.raises(UserError, match="output speed of the system is not connected"):
        pair("", connectors=IN_RPM, units=RPM)


def test_system_that_is_put_together_in_python_is_checked_too(pair: Pair, wire: Wire) -> None:
    system = pair(wire("motor.w", "meter.w"))
    check(system)
    wrong = replace(system, connections=(*system.connections, Connection("motor", "n", "meter", "tau")))
    with pytest.raises(UserError, match=r"motor\.n \(Integer\) is connected to meter\.tau \(Real\)"):
        check(wrong)


def test_torques_that_nothing_gives_are_warned_of(pair: Pair, wire: Wire, caplog: pytest.LogCaptureFixture) -> None:
    system = pair(wire("motor.w", "meter.w"))
    assert unconnected(system) == [("motor.tau", 0.0, "N.m"), ("meter.tau", 0.0, "N.m")]
    warn_of_unconnected(system)
    assert f"{system.path}: meter.tau is not connected and stays at 0 N.m" in caplog.text


def test_shipped_systems_run_without_a_word(caplog: pytest.LogCaptureFixture) -> None:
    """Without load, the gearhead's shaft end is free: that is the test."""
    system = load_system("joint_no_load")
    assert unconnected(system) == [("planetary_gear.tau_s", 0.0, "N.m")]
    warn_of_unconnected(system)
    assert caplog.text == ""
