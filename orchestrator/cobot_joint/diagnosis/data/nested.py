"""Nested files as arrays under their paths: MATLAB's HDF5 and ROS 2 bags."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

LONGEST = 16  # an array of more values in a message is a picture, a scan or a blob
APART = 60.0  # s between a message's stamp and its recording; beyond it the two count from different moments
Series = dict[str, tuple[NDArray[np.float64], NDArray[np.float64]]]  # path -> (time [s], values), each (n,)


def matlab_hdf5(path: Path) -> dict[str, Any]:
    """Variables of a MAT file from version 7.3 on: arrays as MATLAB shows them, structs as dict, cells as list.

    Format: MathWorks, "MAT-File Versions": HDF5, arrays in column-major order, attribute MATLAB_class.
    """
    import h5py

    with h5py.File(path) as file:
        return {name: _matlab(item, file) for name, item in file.items() if not name.startswith("#")}


def _matlab(item: Any, file: Any) -> Any:
    if hasattr(item, "keys"):  # a struct; sparse matrices and objects come out as what they are made of
        return {name: _matlab(inner, file) for name, inner in item.items()}
    values = item[()]
    if not isinstance(values, np.ndarray) or item.attrs.get("MATLAB_empty"):
        return None
    if values.dtype.kind == "O":  # a cell, or a field of an array of structs: references
        return [_matlab(file[reference], file) for reference in values.T.ravel(order="F")]
    return None if item.attrs.get("MATLAB_class") == b"char" else values.T


def ros2_bag(path: Path) -> tuple[Series, dict[str, str]]:
    """Numbers in the messages of an MCAP file, `joint_states.elbow.velocity`, and why others are none.

    The clock is the message's own stamp where it has one, else the recorder's; s from the bag's first.
    """
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    factory, decoders, unusable = DecoderFactory(), {}, {}
    stamps: dict[str, list[tuple[int, int]]] = defaultdict(list)  # topic -> (recorder's, own), ns
    rows: dict[str, list[dict[str, float]]] = defaultdict(list)
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            topic = channel.topic.strip("/")
            if channel.id not in decoders:
                decoders[channel.id] = factory.decoder_for(channel.message_encoding, schema)
            decode = decoders[channel.id]
            if decode is None:
                unusable[topic] = f"is encoded in {channel.message_encoding}, ROS 2 messages (cdr) are read"
                continue
            content = decode(message.data)
            stamp = getattr(getattr(content, "header", None), "stamp", None)
            own = stamp.sec * 10**9 + stamp.nanosec if stamp is not None else 0
            stamps[topic].append((message.log_time, own))
            rows[topic].append(dict(_numbers(topic, content)))
    clocks = {topic: _clock(pairs) for topic, pairs in stamps.items()}
    first = min((clock[0] for clock in clocks.values()), default=0)
    series: Series = {}
    for topic, found in rows.items():
        time = (clocks[topic] - first) * 1e-9
        for name in dict.fromkeys(name for row in found for name in row):
            if all(name in row for row in found):
                series[name] = time, np.array([row[name] for row in found])
            else:
                unusable[name] = f"is in {sum(name in row for row in found)} of {len(found)} messages"
    return series, unusable


def _clock(stamps: list[tuple[int, int]]) -> NDArray[np.int64]:
    """ns; the messages' own stamps, unless they are not set or count from another moment than the recorder's."""
    recorded, own = np.array(stamps, dtype=np.int64).T
    return own if abs(float(np.median(own - recorded))) < APART * 1e9 else recorded


def _numbers(path: str, value: Any) -> Iterator[tuple[str, float]]:
    """Numbers of a message under their paths; those of arrays go by the message's own names, as a JointState's do."""
    if isinstance(value, (bool, int, float)):
        yield path, float(value)
    elif isinstance(value, (list, tuple, np.ndarray)):
        if len(value) <= LONGEST:
            for k, item in enumerate(value):
                yield from _numbers(f"{path}[{k}]", item)
    elif hasattr(value, "__slots__"):
        named = getattr(value, "name", None)
        names = named if isinstance(named, list) else []
        for field in value.__slots__:
            inner = getattr(value, field)
            if field == "header" or isinstance(inner, (str, bytes)) or inner is named:
                continue
            if names and isinstance(inner, (list, tuple, np.ndarray)) and len(inner) == len(names):
                for name, item in zip(names, inner, strict=True):
                    yield from _numbers(f"{path}.{name}.{field}", item)
            else:
                yield from _numbers(f"{path}.{field}", inner)
