"""A sweep on disk as it comes: a zarr store of its results, which xarray reads at any time and from which an interrupted sweep goes on.

    xarray.open_zarr(path)      the axes of a grid are coordinates; nan where no run is done yet; `status` and `error` of every run

A chunk of the store holds the same neighbouring runs in every array. It is written whole beside the old one, forced to disk, and takes its place;
`status` comes after all others, so that what it calls done is there. A kill, a full disk or a power cut costs the runs of the last second, and no run is
taken for done that is not. Every chunk carries its checksum.

Needs the extra `batch`: pip install 'stickslip-toolbox[batch]'.
"""

from __future__ import annotations

import asyncio
import errno
import functools
import json
import math
import os
import time as clock
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from toolbox.errors import SceneError
from toolbox.files.atomic import clear_left, replaced, replaced_folder
from toolbox.sweeps.chunks import DONE, FAILED, WAITING, Columns, chunk_ranges, chunk_shape
from toolbox.sweeps.designs import grid

if TYPE_CHECKING:
    from toolbox.sweeps.results import Sweep

STATUS = {"flag_values": [WAITING, DONE, FAILED], "flag_meanings": "waiting done failed"}
"""What the numbers of `status` mean, in the words of the CF conventions."""

ROWS = 16_384
"""Runs in one chunk of a store, about, unless workers take more at once: some hundred files for a million runs."""

PAUSE = 1.0
"""Seconds between two writes."""

_UNREADABLE = (OSError, KeyError, ValueError, TypeError, RuntimeError)
"""What zarr raises for files that are missing, cut short or altered."""


class Store:
    """The store of one sweep in the folder `path`, new or to be continued.

    sheet: the sweep without its measures;  arguments: what it is made of, as digests, which those of an earlier store must equal;  settings: what `begin` was
    given, None where there is no store yet. Raises SceneError for a folder with anything else, for another sweep and a damaged store, ImportError without zarr.
    """

    def __init__(self, path: str | Path, sheet: Sweep, arguments: Mapping[str, str]):
        self.path, self.sheet, self.arguments = Path(path), sheet, dict(arguments)
        self.settings: dict[str, Any] | None = None
        self._group: Any = None
        self._changed: set[int] = set()
        self._written = -math.inf
        _zarr()
        if not (self.path / "zarr.json").is_file():
            if self.path.exists() and (not self.path.is_dir() or any(self.path.iterdir())):
                raise SceneError(
                    f"Argument `out` must be an empty or new folder, or that of a sweep to be continued, but `{self.path}` is not."
                )
            folder_of(self.path.absolute().parent)
            return
        self._group, notes = _opened(self.path, "r+")
        other = [word for word in self.arguments if notes.get("arguments", {}).get(word) != self.arguments[word]]
        if other:
            words = ", ".join(f"`{word}`" for word in other)
            raise SceneError(
                f"Argument `out` must be a new folder, or that of the same sweep, but `{self.path}` holds one with other {words}."
            )
        self.settings = notes["settings"]
        for name in _parts(notes):
            for folder, _, _ in os.walk(self.path / name):
                clear_left(Path(folder))

    def begin(self, settings: Mapping[str, Any], together: int = 1) -> None:
        """Lay out a new store. settings: to be found again in `settings`;  together: runs that are worked on at once, which one chunk holds at least."""
        self.settings = dict(settings)
        chunk = chunk_shape(self.sheet.shape, max(ROWS, together))
        with replaced_folder(self.path) as folder:
            _laid_out(folder, self.sheet, chunk, {"arguments": self.arguments, "settings": self.settings})
        self._group, _ = _opened(self.path, "r+")

    def columns(self) -> Columns:
        """What is there; nothing where the store has not begun. Raises SceneError for a chunk that is missing or damaged."""
        if self._group is None:
            return Columns.empty(self.sheet.runs, len(self.sheet.measure_units))
        return _read(self.path, self._group, tuple(self.sheet.measure_units))

    @functools.cached_property
    def ranges(self) -> list[tuple[int, int]]:
        """(first, last) run of every chunk, of a store that has begun."""
        return list(chunk_ranges(self._group["status"].shape, self._group["status"].chunks))

    def changed(self, first: int, last: int) -> None:
        """Note that the runs from `first` to before `last` have come in."""
        self._changed |= {k for k, (a, b) in enumerate(self.ranges) if a < last and first < b}

    def flush(self, columns: Columns, pause: float = 0.0) -> None:
        """Write what has changed, unless the last write is less than `pause` seconds ago. Raises OSError where the disk does not take it."""
        if not self._changed or clock.monotonic() - self._written < pause:
            return
        try:
            for k in sorted(self._changed):
                _write(self._group, self.ranges[k], columns, tuple(self.sheet.measure_units))
                self._changed.discard(k)
        except (OSError, SceneError) as error:
            words = error.strerror if isinstance(error, OSError) else str(error).rstrip(".")
            number = (error.errno if isinstance(error, OSError) else None) or errno.EIO
            raise OSError(
                number, f"{words}; what was written before is kept, and the same call goes on from there", str(self.path)
            ) from None
        self._written = clock.monotonic()

    def finish(self, seconds: float) -> None:
        """Note the seconds that it took."""
        notes = json.loads(self._group.attrs["sweep"])
        self._group.attrs["sweep"] = json.dumps({**notes, "seconds": seconds})


def saved(sweep: Sweep, path: Path) -> None:
    """Write a sweep that is there as the store that it would have left, in place of what is there."""
    _zarr()
    _check_free(path)
    columns = Columns.empty(sweep.runs, len(sweep.measures))
    columns.put(0, np.stack([values.ravel() for values in sweep.measures.values()], axis=1), sweep.errors)
    with replaced_folder(path) as folder:
        group = _laid_out(folder, sweep, chunk_shape(sweep.shape, ROWS), {})
        for both in chunk_ranges(group["status"].shape, group["status"].chunks):
            _write(group, both, columns, tuple(sweep.measures))


def _check_free(path: Path) -> None:
    """Raise SceneError where a sweep would take the place of anything but a sweep."""
    if not os.path.lexists(path):
        return
    entries = {entry.name for entry in path.iterdir()} if path.is_dir() else {""}
    own = {"zarr.json", *_parts(_opened(path, "r")[1])} if "zarr.json" in entries else set()
    foreign = sorted(entries - own)
    if foreign:
        raise SceneError(f"Argument `path` must not hide your own files, but `{path / foreign[0]}` is not of a sweep.")


def _parts(notes: Mapping[str, Any]) -> tuple[str, ...]:
    """Names of the arrays of a store."""
    return ("status", "error", *notes["names"], *notes["measure_units"])


def loaded(path: Path) -> Sweep:
    """The sweep in a store. Raises SceneError where there is none, where it is damaged, and where runs still wait."""
    from toolbox.sweeps.results import Sweep

    _zarr()
    group, notes = _opened(path, "r")
    names = tuple(notes["names"])
    columns = _read(path, group, tuple(notes["measure_units"]))
    waiting = int((columns.status == WAITING).sum())
    if waiting:
        raise SceneError(
            f"The sweep in `{path}` must be finished to be loaded, but {waiting} of {columns.status.size} runs wait: the same call of `sweep` goes on with "
            "them; xarray.open_zarr shows what is there."
        )
    axes = tuple(group[name][...] for name in names)
    shape = group["status"].shape
    return Sweep(
        title=notes["title"], names=names, units=tuple(notes["units"]), points=grid(dict(zip(names, axes, strict=True))).points if notes["grid"] else
        np.stack(axes, axis=1), shape=shape, axes=axes if notes["grid"] else (), measures={name: columns.values[:, k].reshape(shape) for k, name in
        enumerate(notes["measure_units"])}, measure_units=notes["measure_units"], errors=columns.errors, duration=notes["duration"],
        accuracy=notes["accuracy"], seconds=notes["seconds"],
    )  # fmt: skip


def folder_of(path: Path) -> None:
    """Make a folder with its parents; raises SceneError where that cannot be."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise SceneError(f"Argument `out` must be a folder that can be written, but `{path}` cannot: {error.strerror}.") from None


# --------------------------------------------------------------------------------------------------------------------------------------- chunks
def _region(group: Any, first: int) -> tuple[slice, ...]:
    """Where the block stands that begins with an entry."""
    status = group["status"]
    at = np.unravel_index(first, status.shape)
    return tuple(slice(int(i), min(int(i) + size, length)) for i, size, length in zip(at, status.chunks, status.shape, strict=True))


def _write(group: Any, both: tuple[int, int], columns: Columns, names: tuple[str, ...]) -> None:
    first, last = both
    region = _region(group, first)
    shape = tuple(each.stop - each.start for each in region)
    for k, name in enumerate(names):
        group[name][region] = columns.values[first:last, k].reshape(shape)
    failed = np.flatnonzero(columns.status[first:last] == FAILED)
    if failed.size:
        texts = np.full(last - first, "", dtype=object)
        for i in failed.tolist():
            texts[i] = columns.errors[first + i]
        group["error"][region] = texts.reshape(shape)
    group["status"][region] = columns.status[first:last].reshape(shape)


def _read(path: Path, group: Any, names: tuple[str, ...]) -> Columns:
    status = group["status"]
    columns = Columns.empty(math.prod(status.shape), len(names))
    for first, last in chunk_ranges(status.shape, status.chunks):
        region = _region(group, first)
        at = tuple(each.start // size for each, size in zip(region, status.chunks, strict=True))
        key, name = status.metadata.encode_chunk_key(at), "status"
        try:
            columns.status[first:last] = status[region].ravel()
            if not columns.status[first:last].any():
                continue
            for k, name in enumerate(names):
                if not (path / name / key).is_file():
                    raise FileNotFoundError
                columns.values[first:last, k] = group[name][region].ravel()
            failed = np.flatnonzero(columns.status[first:last] == FAILED)
            if failed.size:
                name, texts = "error", group["error"][region].ravel()
                columns.errors.update({first + i: str(texts[i]) for i in failed.tolist()})
                if not all(texts[failed]):
                    raise FileNotFoundError
        except _UNREADABLE as error:
            what = "missing" if isinstance(error, FileNotFoundError) else "damaged"
            raise SceneError(
                f"The file `{path / name / key}` of the sweep is {what}: delete `{path / 'status' / key}`, and the runs {first} to {last - 1} are done again "
                "when the sweep is continued."
            ) from None
    return columns


# ---------------------------------------------------------------------------------------------------------------------------------------- zarr
def _zarr() -> Any:
    try:
        import xarray  # noqa: F401, what is written is for it
        import zarr
    except ImportError:
        raise ImportError("A sweep on disk needs zarr and xarray: pip install 'stickslip-toolbox[batch]'.") from None
    return zarr


@functools.cache
def _durable() -> Any:
    from zarr.storage import LocalStore

    class Durable(LocalStore):
        """Files of which a name is never seen before the content is on disk."""

        async def set(self, key: str, value: Any) -> None:
            await asyncio.to_thread(self.set_sync, key, value)

        def set_sync(self, key: str, value: Any) -> None:
            place = Path(self.root) / key
            place.parent.mkdir(parents=True, exist_ok=True)
            with replaced(place, durable=True) as file:
                file.write(value.to_bytes())

    return Durable


def _opened(path: Path, mode: str) -> tuple[Any, dict[str, Any]]:
    """The group of a store and its notes."""
    zarr = _zarr()
    try:
        with zarr.config.set({"array.write_empty_chunks": True}):  # a chunk of nothing but nan is there, too
            group = zarr.open_group(_durable()(path, read_only=mode == "r"), mode=mode)
            notes = json.loads(group.attrs["sweep"])
            for name in _parts(notes):
                group[name].metadata  # noqa: B018, raises where it is not there
    except _UNREADABLE as error:
        raise SceneError(f"There is no sweep in `{path}`, or it is damaged: {error}") from None
    return group, notes


def _laid_out(folder: Path, sheet: Sweep, chunk: tuple[int, ...], more: Mapping[str, Any]) -> Any:
    """A group with all arrays of a sweep, and its coordinates filled in."""
    from zarr.codecs import ZstdCodec

    zarr = _zarr()
    notes = {
        "title": sheet.title, "names": sheet.names, "units": sheet.units, "measure_units": sheet.measure_units, "grid": bool(sheet.axes),
        "duration": sheet.duration, "accuracy": sheet.accuracy, "seconds": sheet.seconds, **more,
    }  # fmt: skip
    attributes = {"title": sheet.title, "sweep": json.dumps(notes)}
    if not sheet.axes:
        attributes["coordinates"] = " ".join(sheet.names)
    group = zarr.create_group(_durable()(folder), attributes=attributes)
    made = functools.partial(group.create_array, compressors=[ZstdCodec(checksum=True)], config={"write_empty_chunks": True})
    dims = sheet.names if sheet.axes else ("run",)
    for k, (name, unit) in enumerate(zip(sheet.names, sheet.units, strict=True)):
        values, own = (sheet.axes[k], (name,)) if sheet.axes else (sheet.points[:, k], dims)
        array = made(name, shape=values.shape, chunks=values.shape, dtype="float64", dimension_names=own, attributes={"units": unit})
        array[:] = values
    for name, unit in sheet.measure_units.items():
        made(name, shape=sheet.shape, chunks=chunk, dtype="float64", fill_value=math.nan, dimension_names=dims, attributes={"units": unit})
    made("status", shape=sheet.shape, chunks=chunk, dtype="uint8", fill_value=WAITING, dimension_names=dims, attributes=STATUS)
    made("error", shape=sheet.shape, chunks=chunk, dtype=str, fill_value="", dimension_names=dims)
    with warnings.catch_warnings():  # one file for all metadata is what xarray looks for, though zarr 3 calls it not yet specified
        warnings.simplefilter("ignore")
        zarr.consolidate_metadata(_durable()(folder))
    return group
