"""Results of a diagnosis as a file that is safe to read: numbers, strings, arrays and the diagnosis's own dataclasses.

A file is an npz archive: `content` is JSON (UTF-8 bytes) that refers to the arrays by number, `sha256` is the digest of
all of it. Nothing in it can name code to run: a class is looked up in cobot_joint.diagnosis and has to be a dataclass.
"""

from __future__ import annotations

import hashlib
import importlib
import json
import re
import zipfile
import zlib
from dataclasses import fields, is_dataclass
from pathlib import Path, PurePath
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel

PACKAGE = "cobot_joint.diagnosis"
CLASS = re.compile(rf"({re.escape(PACKAGE)}(?:\.[A-Za-z]\w*)*):([A-Za-z]\w*)")  # module:name
COLLECTIONS: dict[str, Any] = {"tuple": tuple, "set": set, "frozenset": frozenset}


class DamagedError(ValueError):
    """A file that is not, or no longer, what `save` wrote under that key."""


def save(file: Path, value: Any, key: str = "") -> None:
    """Write what `load` gives back, under a key that it has to be asked for by.

    TypeError: something in it is neither a number, string, array, collection of these nor a dataclass of the diagnosis.
    """
    encoder = _Encoder()
    tree = encoder.encode(value)
    content = json.dumps({"key": key, "value": tree, "objects": encoder.objects}).encode()
    arrays = {"content": np.frombuffer(content, dtype=np.uint8)}
    arrays |= {str(k): array for k, array in enumerate(encoder.arrays)}
    with file.open("wb") as stream:
        np.savez(stream, sha256=np.frombuffer(_digest(arrays), dtype=np.uint8), **arrays)  # type: ignore[arg-type]


def load(file: Path, key: str = "") -> Any:
    """What `save` wrote under this key. DamagedError: it is not that any more. FileNotFoundError: there is none."""
    if not file.is_file():
        raise FileNotFoundError(file)
    try:
        with np.load(file, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
        if arrays.pop("sha256").tobytes() != _digest(arrays):
            raise DamagedError("its checksum does not match its content")
        content = json.loads(arrays.pop("content").tobytes())
        if content["key"] != key:
            raise DamagedError("it was kept under another name")
        return _Decoder(content["objects"], arrays).decode(content["value"])
    except DamagedError:
        raise
    except (
        OSError, EOFError, ValueError, KeyError, IndexError, TypeError, AttributeError, ImportError, MemoryError,
        RecursionError, NotImplementedError, zipfile.BadZipFile, zlib.error,
    ) as error:  # fmt: skip
        raise DamagedError(f"it cannot be read: {error}") from error


def fingerprint(value: Any) -> str:
    """SHA-256 of the content of anything that `save` takes, and of pydantic's models and paths: the same for equal
    values, whoever made them.
    """
    encoder = _Encoder(shared=False)
    content = json.dumps(encoder.encode(value)).encode()
    arrays = {"content": np.frombuffer(content, dtype=np.uint8)}
    return _digest(arrays | {str(k): array for k, array in enumerate(encoder.arrays)}).hex()


def _digest(arrays: dict[str, NDArray]) -> bytes:
    found = hashlib.sha256()
    for name in sorted(arrays):
        array = arrays[name]
        found.update(f"{name} {array.dtype.str} {array.shape}\n".encode() + array.tobytes())
    return found.digest()


class _Encoder:
    """Values as JSON; arrays and dataclass instances beside it, each once if `shared`."""

    def __init__(self, shared: bool = True) -> None:
        self.arrays: list[NDArray] = []
        self.objects: list[Any] = []
        self._shared = shared
        self._known: dict[int, tuple[Any, dict[str, int]]] = {}  # id -> the object, kept alive, and where it is

    def encode(self, value: Any) -> Any:
        if value is None or type(value) in (bool, int, float, str):
            return value
        if type(value) is list:
            return [self.encode(item) for item in value]
        if isinstance(value, dict):
            return {"dict": [[self.encode(key), self.encode(item)] for key, item in value.items()]}
        for name, kind in COLLECTIONS.items():
            if type(value) is kind:
                items = list(map(self.encode, value))
                return {name: items if kind is tuple else sorted(items, key=repr)}
        if id(value) in self._known:
            return self._known[id(value)][1]
        if isinstance(value, np.generic):
            return {"scalar": self._array(np.asarray(value))}
        reference = self._reference(value)
        if self._shared:
            self._known[id(value)] = value, reference
        return reference

    def _reference(self, value: Any) -> dict[str, Any]:
        kind = type(value)
        if isinstance(value, np.ndarray):
            return {"array": self._array(value)}
        if not self._shared and isinstance(value, (BaseModel, PurePath)):
            return {kind.__name__: str(value) if isinstance(value, PurePath) else self.encode(value.model_dump())}
        if not is_dataclass(kind) or not CLASS.fullmatch(name := f"{kind.__module__}:{kind.__qualname__}"):
            raise TypeError(f"{kind.__module__}.{kind.__qualname__} cannot be kept: not a dataclass of {PACKAGE}")
        found = {"class": name, "fields": {f.name: self.encode(getattr(value, f.name)) for f in fields(value)}}
        if not self._shared:
            return found
        self.objects.append(found)
        return {"object": len(self.objects) - 1}

    def _array(self, array: NDArray) -> int:
        if array.dtype.hasobject:
            raise TypeError("an array of Python objects cannot be kept")
        self.arrays.append(array)
        return len(self.arrays) - 1


class _Decoder:
    def __init__(self, objects: list[Any], arrays: dict[str, NDArray]) -> None:
        self.arrays = arrays
        self.objects: list[Any] = []
        for given in objects:  # each refers to those before it only
            self.objects.append(self._object(given))

    def decode(self, tree: Any) -> Any:
        if isinstance(tree, list):
            return [self.decode(item) for item in tree]
        if not isinstance(tree, dict):
            return tree
        ((kind, content),) = tree.items()
        if kind == "dict":
            return {self.decode(key): self.decode(item) for key, item in content}
        if kind in COLLECTIONS:
            return COLLECTIONS[kind](self.decode(item) for item in content)
        if kind == "array":
            return self.arrays[str(content)]
        if kind == "scalar":
            return self.arrays[str(content)][()]
        if kind == "object":
            return self.objects[content]
        raise DamagedError(f"it holds {kind!r}, which is nothing that can be kept")

    def _object(self, given: dict[str, Any]) -> Any:
        kind, content = _class(given["class"]), given["fields"]
        if set(content) != {f.name for f in fields(kind)}:
            raise DamagedError(f"{given['class']} has other fields")
        made: Any = object.__new__(kind)
        for name, tree in content.items():
            object.__setattr__(made, name, self.decode(tree))  # frozen ones too
        return made


def _class(name: str) -> type:
    """The dataclass of that name, defined in the diagnosis. DamagedError: there is none."""
    match = CLASS.fullmatch(name)
    kind = getattr(importlib.import_module(match[1]), match[2], None) if match else None
    if not (match and isinstance(kind, type) and is_dataclass(kind) and kind.__module__ == match[1]):
        raise DamagedError(f"it holds a {name}, which is no dataclass of {PACKAGE}")
    return kind
