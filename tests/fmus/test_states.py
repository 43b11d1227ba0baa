"""FMU states as bytes: damage is found, and what a state restores."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from fmpy.fmi1 import FMICallException

Make = Callable[..., Any]


def serialized(slave: Any) -> bytes:
    state = slave.fmu.getFMUstate()
    data = bytes(slave.fmu.serializeFMUstate(state))
    slave.fmu.freeFMUstate(state)
    return data


def test_every_damaged_byte_is_found_and_the_unit_goes_on_from_a_kept_state(make: Make, name: str) -> None:
    twin, slave = make(name), make(name)  # the last one has the log
    slave.step(1e-2)
    twin.step(1e-2)
    kept = slave.fmu.getFMUstate()
    data = serialized(slave)
    rng = np.random.default_rng(1)
    head = range(0, 96)  # GUID, hash, version, size, phase
    for at in {*head, *rng.integers(0, len(data), 200).tolist()}:
        damaged = bytearray(data)
        damaged[at] ^= 1 << int(rng.integers(8))
        slave.log.clear()
        with pytest.raises(FMICallException):
            slave.fmu.deSerializeFMUstate(bytes(damaged))
        assert "damaged" in slave.log[0] or "no state of a" in slave.log[0]
    slave.fmu.setFMUstate(kept)
    slave.fmu.freeFMUstate(kept)
    slave.step(1e-2)
    twin.step(1e-2)
    np.testing.assert_array_equal(slave.reals(slave.outputs()), twin.reals(twin.outputs()))


def test_phase_that_does_not_exist_is_refused(make: Make, name: str) -> None:
    """its bits contain those of a phase: 0x7ffffff1 was taken for one, and then looked up"""
    slave = make(name)
    data = serialized(slave)
    at = data.index((4).to_bytes(4, "little"), 40)
    damaged = data[:at] + (0x7FFFFFF1).to_bytes(4, "little") + data[at + 4 :]
    with pytest.raises(FMICallException):
        slave.fmu.deSerializeFMUstate(damaged)
    assert "damaged" in slave.log[0]


def test_bytes_cut_short_are_refused(make: Make, name: str) -> None:
    slave = make(name)
    with pytest.raises(FMICallException):
        slave.fmu.deSerializeFMUstate(serialized(slave)[:-1])


def test_state_brings_its_stop_time_back(instantiate: Make) -> None:
    brake = instantiate("mr_brake_belt")
    brake.fmu.setupExperiment(stopTime=1.0)
    brake.fmu.enterInitializationMode()
    brake.fmu.exitInitializationMode()
    state = brake.fmu.getFMUstate()
    brake.fmu.reset()
    brake.initialise()  # without a stop time
    brake.fmu.setFMUstate(state)
    brake.fmu.freeFMUstate(state)
    with pytest.raises(FMICallException):
        brake.fmu.doStep(0.0, 1.5)
    assert "behind the stop time 1" in brake.log[0]
