"""A sweep on disk as it comes: a zarr store of its results, which xarray reads at any time and from which an interrupted sweep goes on.

    xarray.open_zarr(path)      the axes of a grid are coordinates; nan where no run is done yet; `status` and `error` of every run

A chunk of the store holds the same neighbouring runs in every array. It is written whole beside the old one, forced to disk, and takes its place;
`status` comes after all others, so that what it calls done is there. A kill, a full disk or a power cut costs the runs of the last second, and no run is
taken for done that is not. Every chunk carries its checksum.

Needs the extra `batch`: pip install -e '.[batch]' in the folder of the toolbox.
"""

from __future__ import annotations

import asyncio
import errno
import functools
import math
import os
import time as clock
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np

from toolbox.errors import SceneError
from toolbox.files.atomic import replaced, replaced_folder
from toolbox.files.journal import Journal
from toolbox.files.reading import LARGEST, most_unpacked, opened
from toolbox.modelling.closed_loop import ClosedLoop
from toolbox.sweeps import metadata
from toolbox.sweeps.chunks import DONE, FAILED, WAITING, Columns, chunk_ranges, chunk_shape
from toolbox.sweeps.designs import Variations, grid
from toolbox.sweeps.variants import fingerprints, shared_run

STATUS = {"flag_values": [WAITING, DONE, FAILED], "flag_meanings": "waiting done failed"}
"""What the numbers of `status` mean, in the words of the CF conventions."""

ROWS = 16_384
"""Runs in one chunk of a store, about, unless workers take more at once: some hundred files for a million runs."""

PAUSE = 1.0
"""Seconds between two writes."""

Sheet = Any
"""A `toolbox.sweeps.results.Sweep`, which knows this file."""


class Store:
    """The store of one sweep in the folder `path`, new or to be continued.

    sheet: the sweep without its measures;  arguments: what it is made of, as digests, which those of an earlier store must equal;  settings: what `begin` was
    given, None where there is no store yet. Raises SceneError for a folder with anything else, for another sweep and a damaged store, ImportError without zarr.
    """

    def __init__(self, path: str | Path, sheet: Sheet, arguments: Mapping[str, str]):
        self.path, self.sheet, self.arguments = Path(path), sheet, dict(arguments)
        self.settings: dict[str, Any] | None = None
        self._open: _Open | None = None
        self._changed: set[int] = set()
        self._written = -math.inf
        _zarr()
        if not (self.path / metadata.FILE).is_file():
            if self.path.exists() and (not self.path.is_dir() or any(self.path.iterdir())):
                raise SceneError(
                    f"Argument `checkpoint` must be an empty or new folder, or that of a sweep to be continued, but `{self.path}` is not."
                )
            folder_of(self.path.absolute().parent)
            return
        self._open = _Open(self.path, "r+")
        notes = self._open.notes
        other = [word for word in self.arguments if notes.get("arguments", {}).get(word) != self.arguments[word]]
        if other:
            words = ", ".join(f"`{word}`" for word in other)
            raise SceneError(
                f"Argument `checkpoint` must be a new folder, or that of the same sweep, but `{self.path}` holds one with other {words}."
            )
        self.settings = notes["settings"]

    def begin(self, settings: Mapping[str, Any], together: int = 1) -> None:
        """Lay out a new store. settings: to be found again in `settings`;  together: runs that are worked on at once, which one chunk holds at least."""
        self.settings = dict(settings)
        chunk = chunk_shape(self.sheet.shape, max(ROWS, together))
        with replaced_folder(self.path) as folder:
            _laid_out(folder, self.sheet, chunk, {"arguments": self.arguments, "settings": self.settings})
        self._open = _Open(self.path, "r+")

    def columns(self) -> Columns:
        """Return the stored results; empty if the store has not begun. SceneError is raised for a missing or damaged chunk."""
        if self._open is None:
            return Columns.empty(self.sheet.runs, len(self.sheet.metric_units))
        return self._open.columns()

    @functools.cached_property
    def ranges(self) -> list[tuple[int, int]]:
        """(first, last) run of every chunk, of a store that has begun."""
        assert self._open is not None
        return self._open.ranges()

    def changed(self, first: int, last: int) -> None:
        """Note that the runs from `first` to before `last` have come in."""
        self._changed |= {k for k, (a, b) in enumerate(self.ranges) if a < last and first < b}

    def flush(self, columns: Columns, pause: float = 0.0) -> None:
        """Write the changes, unless the last write is less than `pause` seconds ago. OSError is raised if the disk refuses the write."""
        if not self._changed or clock.monotonic() - self._written < pause:
            return
        assert self._open is not None
        try:
            for k in sorted(self._changed):
                self._open.write(self.ranges[k], columns)
                self._changed.discard(k)
        except (OSError, SceneError) as error:
            words = error.strerror if isinstance(error, OSError) else str(error).rstrip(".")
            number = (error.errno if isinstance(error, OSError) else None) or errno.EIO
            raise OSError(
                number, f"{words}; what was written before is kept, and the same call goes on from there", str(self.path)
            ) from None
        self._written = clock.monotonic()


def saved(sweep: Sheet, path: Path) -> None:
    """Write a finished sweep as a store, in place of an existing store. The result is the store that the sweep itself would have
    written."""
    _zarr()
    _check_free(path)
    columns = Columns.empty(sweep.runs, len(sweep.metrics))
    columns.put(0, np.stack([values.ravel() for values in sweep.metrics.values()], axis=1), sweep.failures)
    with replaced_folder(path) as folder:
        _laid_out(folder, sweep, chunk_shape(sweep.shape, ROWS), {})
        opened = _Open(folder, "r+")
        for both in opened.ranges():
            opened.write(both, columns)


def _check_free(path: Path) -> None:
    """Raise SceneError where a sweep would take the place of anything but a sweep."""
    if not os.path.lexists(path):
        return
    entries = {entry.name for entry in path.iterdir()} if path.is_dir() else {""}
    own = {metadata.FILE, *metadata.parts(metadata.notes_of(path))} if metadata.FILE in entries else set()
    foreign = sorted(entries - own)
    if foreign:
        raise SceneError(f"Argument `path` must not hide your own files, but `{path / foreign[0]}` is not of a sweep.")


def loaded(path: Path) -> dict[str, Any]:
    """Return the sweep in a store, as the arguments of a `Sweep`. SceneError is raised if there is no sweep, if it is damaged, or if runs
    still wait."""
    _zarr()
    opened = _Open(path, "r")
    notes, columns = opened.notes, opened.columns()
    names = tuple(notes["names"])
    waiting = int((columns.status == WAITING).sum())
    if waiting:
        raise SceneError(
            f"The sweep in `{path}` must be finished to be loaded, but {waiting} of {columns.status.size} runs wait: the same call of `sweep` goes on with "
            "them; xarray.open_zarr shows what is there."
        )
    axes = tuple(map(opened.axis, names))
    shape = opened.arrays["status"].shape
    points = grid(dict(zip(names, axes, strict=True))).points if notes["grid"] else np.stack(axes, axis=1)
    metrics = {name: columns.values[:, k].reshape(shape) for k, name in enumerate(notes["measure_units"])}
    return {
        "title": notes["title"], "names": names, "units": tuple(notes["units"]), "points": points, "shape": shape, "axes": axes if notes["grid"] else (),
        "metrics": metrics, "metric_units": notes["measure_units"], "failures": columns.errors, "duration": notes["duration"],
        "accuracy": notes["accuracy"], "display_units": notes.get("asked", {}),
    }  # fmt: skip


def folder_of(path: Path) -> None:
    """Make a folder with its parents. SceneError is raised if the folder cannot be made."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise SceneError(f"Argument `checkpoint` must be a folder that can be written, but `{path}` cannot: {error.strerror}.") from None


def journal_in(folder: Path, name: str, loop: ClosedLoop, variations: Variations, duration: float, accuracy: float, **more: Any) -> Journal:
    """Return the journal of a search over runs of a loop, from a file of a folder. `more` is the rest of the definition of the search.
    SceneError is raised for the journal of another search."""
    folder_of(folder)
    run = shared_run(loop, variations, duration, accuracy=accuracy)
    return Journal(folder / name, fingerprints(run, variations.names, duration=[duration], **more))


# ---------------------------------------------------------------------------------------------------------------------------------------- zarr
class _Open:
    """The arrays of a store and its notes. Raises SceneError for anything that no sweep has written."""

    def __init__(self, path: Path, mode: Literal["r", "r+"]):
        zarr = _zarr()
        self.path, self.notes = path, metadata.notes_of(path)
        self.names = tuple(self.notes["measure_units"])
        try:
            with zarr.config.set({"array.write_empty_chunks": True}):  # a chunk of nothing but nan is there, too
                self.group = zarr.open_group(_durable()(path, read_only=mode == "r"), mode=mode, zarr_format=3, use_consolidated=False)
                self.arrays = {name: self.group[name] for name in metadata.parts(self.notes)}
            if len({self.arrays[name].shape for name in ("status", "error", *self.names)}) > 1:
                raise ValueError("its arrays are not of one shape")
            if 8 * math.prod(self.arrays["status"].shape) * (len(self.names) + 1) > LARGEST:
                raise ValueError("its arrays are too large to be read")
        except Exception as error:  # what is damaged raises anything
            raise SceneError(f"There is no sweep in `{path}`, or it is damaged: {error}") from None

    def ranges(self) -> list[tuple[int, int]]:
        """(first, behind the last) run of every chunk."""
        return list(chunk_ranges(self.arrays["status"].shape, self.arrays["status"].chunks))

    def write(self, both: tuple[int, int], columns: Columns) -> None:
        """Write one chunk of results, whose status comes last."""
        first, last = both
        region = self._region(first)
        shape = tuple(each.stop - each.start for each in region)
        for k, name in enumerate(self.names):
            self.arrays[name][region] = columns.values[first:last, k].reshape(shape)
        failed = np.flatnonzero(columns.status[first:last] == FAILED)
        if failed.size:
            texts = np.full(last - first, "", dtype=object)
            for i in failed.tolist():
                texts[i] = columns.errors[first + i]
            self.arrays["error"][region] = texts.reshape(shape)
        self.arrays["status"][region] = columns.status[first:last].reshape(shape)

    def columns(self) -> Columns:
        """Return the stored results. SceneError is raised for a missing or damaged chunk."""
        status = self.arrays["status"]
        columns = Columns.empty(math.prod(status.shape), len(self.names))
        for first, last in self.ranges():
            region = self._region(first)
            at = tuple(each.start // size for each, size in zip(region, status.chunks, strict=True))
            key, name = status.metadata.encode_chunk_key(at), "status"
            try:
                columns.status[first:last] = status[region].ravel()
                if not columns.status[first:last].any():
                    continue
                for k, name in enumerate(self.names):
                    columns.values[first:last, k] = self._chunk(name, key, region).ravel()
                failed = np.flatnonzero(columns.status[first:last] == FAILED)
                if failed.size:
                    name, texts = "error", self._chunk("error", key, region).ravel()
                    columns.errors.update({first + i: str(texts[i]) for i in failed.tolist()})
            except Exception as error:  # what is damaged raises anything
                what = "missing" if isinstance(error, FileNotFoundError) else "damaged"
                raise SceneError(
                    f"The file `{self.path / name / key}` of the sweep is {what}: delete `{self.path / 'status' / key}`, and the runs {first} to {last - 1} "
                    "are done again when the sweep is continued."
                ) from None
        return columns

    def axis(self, name: str) -> np.ndarray:
        """Return the values of a varied number. SceneError is raised if they are missing or damaged."""
        array = self.arrays[name]
        key = array.metadata.encode_chunk_key((0,))
        try:
            return self._chunk(name, key, slice(None))
        except Exception as error:  # what is damaged raises anything
            what = "missing" if isinstance(error, FileNotFoundError) else "damaged"
            raise SceneError(f"The file `{self.path / name / key}` of the sweep is {what}, and with it what was varied.") from None

    def _chunk(self, name: str, key: str, region: Any) -> np.ndarray:
        if not (self.path / name / key).is_file():  # zarr would fill in what is missing
            raise FileNotFoundError
        return self.arrays[name][region]

    def _region(self, first: int) -> tuple[slice, ...]:
        """Where the block stands that begins with an entry."""
        status = self.arrays["status"]
        at = np.unravel_index(first, status.shape)
        return tuple(slice(int(i), min(int(i) + size, length)) for i, size, length in zip(at, status.chunks, status.shape, strict=True))


def _zarr() -> Any:
    try:
        import xarray  # noqa: F401, what is written is for it
        import zarr
    except ImportError:
        raise ImportError("A sweep on disk needs zarr and xarray: pip install -e '.[batch]' in the folder of the toolbox.") from None
    return zarr


@functools.cache
def _durable() -> Any:
    from zarr.storage import LocalStore

    class Durable(LocalStore):
        """Files of which a name is never seen before the content is on disk."""

        async def get(self, key: str, prototype: Any = None, byte_range: Any = None) -> Any:
            await asyncio.to_thread(_check_file, Path(self.root) / key)
            return await super().get(key, prototype, byte_range)

        def get_sync(self, key: str, **named: Any) -> Any:
            _check_file(Path(self.root) / key)
            return super().get_sync(key, **named)

        async def set(self, key: str, value: Any) -> None:
            await asyncio.to_thread(self.set_sync, key, value)

        def set_sync(self, key: str, value: Any) -> None:
            place = Path(self.root) / key
            place.parent.mkdir(parents=True, exist_ok=True)
            with replaced(place, durable=True) as file:
                file.write(value.to_bytes())

    return Durable


def _check_file(path: Path) -> None:
    """Raise SceneError for what is no regular file, and for a chunk that unpacks to more than it may. Zstandard: RFC 8878, section 3.1.1."""
    if not os.path.lexists(path) or path.is_dir():
        return
    with opened(path, apart=True) as file:
        head, size = file.read(18), os.fstat(file.fileno()).st_size
    if head[:4] != b"\x28\xb5\x2f\xfd" or (len(head) < 18 and len(head) < size):
        return
    flag = head[4]
    at = 5 + (not flag & 0x20) + (0, 1, 2, 4)[flag & 3]
    width = (flag >> 5 & 1, 2, 4, 8)[flag >> 6]
    unpacked = int.from_bytes(head[at : at + width], "little") + (256 if width == 2 else 0)
    if not width or unpacked > most_unpacked(size):
        raise SceneError(f"The file `{path}` must say to how much it unpacks, and to no more than {most_unpacked(size) / 2**20:.0f} MiB.")


def _laid_out(folder: Path, sheet: Sheet, chunk: tuple[int, ...], more: Mapping[str, Any]) -> None:
    """Make a store with all arrays of a sweep, and its coordinates filled in."""
    from zarr.codecs import ZstdCodec

    zarr = _zarr()
    notes = {
        "title": sheet.title, "names": sheet.names, "units": sheet.units, "measure_units": sheet.metric_units, "grid": bool(sheet.axes),
        "duration": sheet.duration, "accuracy": sheet.accuracy, "asked": sheet.display_units, **more,
    }  # fmt: skip
    attributes = {"title": sheet.title}
    if not sheet.axes:
        attributes["coordinates"] = " ".join(sheet.names)
    group = zarr.create_group(_durable()(folder), attributes=attributes)
    made = functools.partial(group.create_array, compressors=[ZstdCodec(checksum=True)], config={"write_empty_chunks": True})
    dims = sheet.names if sheet.axes else ("run",)
    for k, (name, unit) in enumerate(zip(sheet.names, sheet.units, strict=True)):
        values, own = (sheet.axes[k], (name,)) if sheet.axes else (sheet.points[:, k], dims)
        array = made(name, shape=values.shape, chunks=values.shape, dtype="float64", dimension_names=own, attributes={"units": unit})
        array[:] = values
    for name, unit in sheet.metric_units.items():
        made(name, shape=sheet.shape, chunks=chunk, dtype="float64", fill_value=math.nan, dimension_names=dims, attributes={"units": unit})
    made("status", shape=sheet.shape, chunks=chunk, dtype="uint8", fill_value=WAITING, dimension_names=dims, attributes=STATUS)
    made("error", shape=sheet.shape, chunks=chunk, dtype=str, fill_value="", dimension_names=dims)
    group.update_attributes(metadata.attributes({**notes, "digests": metadata.digests(folder, metadata.parts(notes))}))
    with warnings.catch_warnings():  # one file for all metadata is what xarray looks for, though zarr 3 calls it not yet specified
        warnings.simplefilter("ignore")
        zarr.consolidate_metadata(_durable()(folder))
