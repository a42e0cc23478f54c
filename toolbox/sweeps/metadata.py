"""What a store of a sweep says of itself, read and checked before anything else reads it.

A store is a folder that anybody may have written: zarr finds by name the code that decodes it, so that only the format and the few codecs that sweeps are
written with are let through. The notes of a sweep carry their checksum, and those of all metadata that say how its arrays lie; arrays carry
their own in every chunk.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from toolbox.errors import SceneError
from toolbox.files.reading import TEXT, content

FILE = "zarr.json"
"""Where zarr format 3 keeps its metadata; a folder of another format has none."""

_CODECS = {"bytes", "vlen-utf8", "zstd"}
_TYPES = {"float64", "uint8", "string"}


def parts(notes: Mapping[str, Any]) -> tuple[str, ...]:
    """Names of the arrays of a store."""
    return ("status", "error", *notes["names"], *notes["measure_units"])


def attributes(notes: Mapping[str, Any]) -> dict[str, str]:
    """The notes of a sweep as attributes of its store."""
    text = json.dumps(notes)
    return {"sweep": text, "checksum": _digest(text.encode())}


def digests(path: Path, names: tuple[str, ...]) -> dict[str, str]:
    """Checksums of the metadata of arrays."""
    return {name: _digest(content(path / name / FILE, TEXT, apart=True)) for name in names}


def notes_of(path: Path) -> dict[str, Any]:
    """Return the notes of the sweep in a folder. SceneError is raised if there is no sweep, if it is damaged, or if a format or codec is
    not used by sweeps."""
    if not os.path.lexists(path / FILE):
        raise SceneError(f"There is no sweep in `{path}`: there is no file `{path / FILE}`.")
    try:
        group = _metadata(path / FILE, "group")
        words = group["attributes"]
        text, checksum = words["sweep"], words.get("checksum")
        notes = json.loads(text)
        if checksum not in (None, _digest(text.encode())):  # a store of an early version has none
            raise SceneError(f"There is no sweep in `{path}`, or it is damaged: the checksum of `{path / FILE}` is another.")
        for name in parts(notes):
            _check_array(path, name, notes.get("digests", {}).get(name))
    except SceneError:
        raise
    except Exception as error:  # what is damaged raises anything
        raise SceneError(f"There is no sweep in `{path}`, or it is damaged: {error}") from None
    return notes


def _check_array(path: Path, name: str, checksum: str | None) -> None:
    file = path / name / FILE
    if name in ("", ".", "..") or "/" in name or "\\" in name:
        raise SceneError(f"There is no sweep in `{path}`: an array of it cannot be called `{name}`.")
    if checksum is not None and _digest(content(file, TEXT, apart=True)) != checksum:
        raise SceneError(f"The sweep in `{path}` is damaged: the checksum of `{file}` is another.")
    array = _metadata(file, "array")
    foreign = {codec["name"] for codec in array["codecs"]} - _CODECS | {array["data_type"]} - _TYPES
    if foreign or array.get("storage_transformers") or array["chunk_grid"]["name"] != "regular":
        raise SceneError(f"The file `{file}` must be of a sweep, but it asks for {', '.join(sorted(foreign)) or 'another layout'}.")


def _metadata(file: Path, kind: str) -> dict[str, Any]:
    found = json.loads(content(file, TEXT, apart=True))
    if not isinstance(found, dict) or found.get("zarr_format") != 3 or found.get("node_type") != kind:
        raise SceneError(f"The file `{file}` must describe an {kind} of zarr format 3, but it does not.".replace("an group", "a group"))
    return found


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()[:32]
