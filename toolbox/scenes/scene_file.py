"""Scenes from TOML; `toolbox.scenes.saving` writes them.

A scene file is data only: it names parts and laws of the catalogue and gives them numbers. A number is SI (angles in rad), or text with
its unit. The keys, their units, defaults and meanings stand in `toolbox.scenes.keys`; `stickslip list scene` prints them.
"""

from __future__ import annotations

import dataclasses
import inspect
import itertools
import re
import tomllib
import types
import typing
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from toolbox.errors import SceneError, suggest
from toolbox.files.reading import SCENE, text_of
from toolbox.files.units import parse
from toolbox.messages import complaint
from toolbox.modelling.closed_loop import ClosedLoop
from toolbox.modelling.closing import laws_of
from toolbox.modelling.components import Component
from toolbox.modelling.composition import compose
from toolbox.modelling.elements import FrictionLaw
from toolbox.modelling.hybrid_system import HybridSystem
from toolbox.modelling.inputs import OPTIONAL, UNITS
from toolbox.modelling.laws import Controller, designed
from toolbox.modelling.observers import Observer
from toolbox.scenes import catalogue, keys
from toolbox.scenes.cases import Case, Measured, Number, Waveform
from toolbox.scenes.judged import judged_effort, judged_speed
from toolbox.vocabulary import new_field

_SHAPES = {**UNITS, "table": {"times": "s", "values": ""}}
"""Units of the numbers of each shape of an input; empty for the unit of the signal."""

SAMPLED = ("delay", "noise", "resolution", "jitter", "missed_samples", "seed")
"""Keys of a controller that only a sampled law has."""

_DOTTED = re.compile(r"""(?:\.[ \t]*+(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+){100}+""")
"""A key of so many parts, which takes a time that grows with the square of their number."""

LAWS: dict[type, str] = {FrictionLaw: "friction law", Controller: "control law"}
"""Kinds of laws that a field may hold; an observer is a control law to the catalogue."""


def read(path: Path, depth: float | str | None = None, refined: bool = False) -> dict[str, Any]:
    """The fields of a Scene in a TOML file, with its part from tables made for that depth, or of twice as many elements; raises SceneError. Whether it can be
    simulated is left to `Scene.check`."""
    data = _data(path)
    data = data if depth is None else _ending_at(data, depth)
    return _scene(_refined(data, path.parent) if refined else data, path.parent)


def _data(path: Path) -> dict[str, Any]:
    given = text_of(path, SCENE)
    if _DOTTED.search(given):
        raise SceneError("the file must be TOML whose keys have at most a hundred parts, but one has more.")
    try:
        return tomllib.loads(given)
    except (ValueError, RecursionError) as error:
        unquoted = re.search(r"^\s*[\w.\"' -]+=\s*(-?[0-9.]+\s*[a-zA-Z%][^\n#\"']*?)\s*(?:#.*)?$", given, re.MULTILINE)
        hint = "" if unquoted is None else f' A number with a unit needs quotes: "{unquoted[1]}".'
        raise SceneError(f"the file must be TOML, but: {error}.{hint}") from None


def contact_body(data: Mapping[str, Any]) -> str | None:
    """Return the name of the body with many contacts in a scene; None if the plant has equations."""
    entries = data.get("plant", [])
    named = [entry.get("part") for entry in entries if isinstance(entry, dict)] if isinstance(entries, list) else []
    texts = [name for name in named if isinstance(name, str)]
    return next((name for name in texts if any(entry.kind == "contact body" for entry in catalogue.offered(name))), None)


def _scene(data: dict[str, Any], folder: Path) -> dict[str, Any]:
    name = contact_body(data)
    if name is not None:
        raise SceneError(
            f"the many contacts of `{name}` are stepped together, and `stickslip simulate` runs them (in Python `ContactScene.load`). Every other command "
            "rests on a plant as equations, which they are not."
        )
    _keys(data, "the scene", keys.names("scene"), keys.required("scene"))
    parts = tuple(_component(entry, f"plant[{i}]", folder) for i, entry in enumerate(_tables(data, "plant"), 1))
    plant = compose(*parts)
    duration = parse(data["duration"], "s", "duration")
    known = keys.names("[verdict]")
    verdict = dict(renamed_keys(_keys(data.get("verdict", {}), "verdict"), known, "Scene", "verdict"))
    verdict = _keys(verdict, "verdict", known, keys.required("[verdict]"))
    contacts = [each.name for each in plant.elements if verdict.get("element") not in plant.modeless] or [*plant.modeless]
    if not contacts:
        raise SceneError("Argument `plant` must have a contact that can stick, or one with memory, but it has none.")
    if len(contacts) > 1 and "element" not in verdict:
        raise SceneError(
            f"The key `element` is missing in `verdict`: which of {_in_short(contacts)} is to be judged? Say it under [verdict], such as "
            f'`element = "{contacts[-1]}"`.'
        )
    element = _text(verdict.get("element", contacts[0]), "verdict.element")
    _known(element, contacts, "verdict.element")
    signal = _text(verdict.get("signal", judged_speed(plant, element)), "verdict.signal")
    reference = data.get("reference")
    if reference is not None:
        reference = parse(reference, plant.signal_unit(signal), "reference")
    cases = tuple(_case(entry, f"controllers[{i}]", plant, reference) for i, entry in enumerate(_tables(data, "controllers"), 1))
    return {
        "title": _text(data["title"], "title"),
        "parts": parts,
        "cases": cases or (Case("no controller"),),
        "duration": duration,
        "element": None if element in plant.modeless else element,
        "signal": signal,
        "effort": _text(verdict.get("effort", judged_effort(plant, signal)), "verdict.effort"),
        **_verdict_numbers({"after": duration / 2, **verdict}, plant.signal_unit(signal)),
        "accuracy": parse(data.get("accuracy", 1e-6), "1", "accuracy"),
        "reference": reference,
        "start": {name: _number(value, plant.signal_unit(name), name) for name, value in _keys(data.get("start", {}), "start").items()},
        "inputs": inputs_of(data.get("inputs", {}), "inputs", plant, cases),
        "parameters": {
            name: _number(value, plant._parameter(name).unit, name)
            for name, value in _keys(data.get("parameters", {}), "parameters").items()
        },
        "measured": _measured(data["measured"], folder) if "measured" in data else None,
        "units": {name: _unit_of(name, unit) for name, unit in _keys(data.get("units", {}), "units").items()},
    }


def _unit_of(name: str, unit: Any) -> str:
    """The unit in which numbers of an SI unit are shown."""
    try:
        parse(f"1 {name}", name)
    except SceneError:
        raise SceneError(f'Argument `units` must name SI units, such as "m/s", but `{name}` is none.') from None
    parse(f"1 {_text(unit, f'units.{name}')}", name, f"units.{name}")
    return str(unit)


def _verdict_numbers(verdict: Mapping[str, Any], unit: str) -> dict[str, float | None]:
    """The numbers under [verdict] by their keys, None for a key that is not given; unit: of the judged signal."""
    units = {key.name: unit if key.unit == keys.OF_SIGNAL else key.unit for key in keys.KEYS["[verdict]"] if key.unit}
    return {name: parse(verdict[name], units[name], f"verdict.{name}") if name in verdict else None for name in units}


def _measured(data: Any, folder: Path) -> Measured:
    """The log that a scene names, by its whole path."""
    _keys(data, "measured", keys.names("[measured]"), keys.required("[measured]"))
    columns = {
        name: _text(heading, f"measured.columns.{name}") for name, heading in _keys(data.get("columns", {}), "measured.columns").items()
    }
    windows = []
    given = data.get("windows", [])
    for i, window in enumerate(given if isinstance(given, list) else [given]):
        if not isinstance(window, list) or len(window) != 2:
            raise SceneError(f"Argument `measured.windows` must be a list of [begin, end], such as [[0, 10]], but it is {given!r}.")
        begin, end = (parse(each, "s", f"measured.windows.{i}") for each in window)
        if not begin < end:
            raise SceneError(f"Argument `measured.windows.{i}` must begin before it ends, but it is {window!r}.")
        windows.append((float(begin), float(end)))
    return Measured((folder / _text(data["file"], "measured.file")).resolve(), columns, tuple(windows))


def _in_short(names: Sequence[str]) -> str:
    """Names for people, with those in the middle of a long row of numbered ones left out."""
    groups = [list(group) for _, group in itertools.groupby(names, key=lambda name: name.rstrip("0123456789"))]
    told = [[*group[:1], "...", *group[-1:]] if len(group) > 4 else group for group in groups]
    return ", ".join(word if word == "..." else f"`{word}`" for group in told for word in group)


def _component(data: Any, where: str, folder: Path, kind: str = "part") -> Any:
    """A part of a plant, or another kind of body, with its fields."""
    _keys(data, where, None, keys.required("[[plant]]"))
    item = catalogue.part(data["part"], kind)
    values, title = {key: value for key, value in data.items() if key != "part"}, _text(data["part"], where)
    if _from_tables(item, values):
        return _tabulated(item, values, title, folder)
    hints = typing.get_type_hints(item if isinstance(item, type) else type(item))
    values |= {
        key: _loaded(hints[key], value, f"{title}.{key}", folder) for key, value in values.items() if hasattr(hints.get(key), "load")
    }
    return _filled(item, values, title)


def _from_tables(item: Any, keys: Mapping[str, Any]) -> bool:
    """Whether a part with these keys is made by its `from_tables`."""
    if not (isinstance(item, type) and hasattr(item, "from_tables")):
        return False
    made, own = inspect.signature(item.from_tables).parameters, {spec.name for spec in dataclasses.fields(item)}
    return any(key in made and key not in own for key in keys)


def _ending_at(data: Mapping[str, Any], depth: float | str) -> dict[str, Any]:
    """A scene whose part from tables ends at a depth. Raises SceneError where it has none."""
    entries = [entry if isinstance(entry, dict) else {} for entry in _tables(data, "plant")]
    named = [entry["part"] for entry in entries if isinstance(entry.get("part"), str)]
    for i, entry in enumerate(entries):
        item: Any = catalogue.part(entry["part"], "part") if entry.get("part") in named else None
        if _from_tables(item, entry) and "end_depth" in inspect.signature(item.from_tables).parameters:
            return {**data, "plant": [*entries[:i], {**entry, "end_depth": depth}, *entries[i + 1 :]]}
    raise SceneError(
        f"its machine is known at one depth only, because none of its parts ({', '.join(named)}) is made from a table of sections, of which the first could "
        'be longer or shorter: `part = "DrillString"` with `sections` is.'
    )


def _refined(data: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """A scene whose parts that are lumped from tables have twice as many elements. Raises SceneError if it has none."""
    entries = _tables(data, "plant")
    finer = []
    for i, entry in enumerate(entries):
        item: Any = catalogue.part(entry["part"], "part") if isinstance(entry, dict) and isinstance(entry.get("part"), str) else None
        if _from_tables(item, entry) and "elements" in inspect.signature(item.from_tables).parameters:
            count = entry.get("elements") or _component(entry, f"plant.{i}", folder).element_count
            finer.append({**{key: value for key, value in entry.items() if key != "band"}, "elements": 2 * count})
        else:
            finer.append(entry)
    if finer == entries:
        raise SceneError("none of its parts is lumped from a table of sections, so that no number of elements can be doubled.")
    return {**data, "plant": finer}


def _loaded(kind: Any, value: Any, name: str, folder: Path) -> Any:
    """A field of data of its own, such as the matrices of a body: the path of a file that its class loads, or a table of its fields."""
    try:
        if isinstance(value, str):
            return kind.load(folder / _text(value, name))
        if not isinstance(value, dict):
            raise SceneError(f"it must be the path of a file, or a table, but it is {value!r}.")
        specs = dataclasses.fields(kind)
        required = [spec.name for spec in specs if spec.default is dataclasses.MISSING]
        return kind(**_keys(value, name, [spec.name for spec in specs], required))
    except SceneError as error:
        raise SceneError(f"Argument `{name}`: {error}") from None


def _tabulated(item: Any, data: Mapping[str, Any], title: str, folder: Path) -> Component:
    """A part made by its `from_tables`."""
    return item.from_tables(**_of_tables(item, data, title, folder))


def _of_tables(item: Any, data: Mapping[str, Any], title: str, folder: Path) -> dict[str, Any]:
    """Arguments of `from_tables`, whose annotations say which is a path."""
    made = inspect.signature(item.from_tables).parameters
    hints = typing.get_type_hints(item.from_tables, include_extras=True)
    _keys(data, title, tuple(made), [name for name, argument in made.items() if argument.default is inspect.Parameter.empty])
    values: dict[str, Any] = {}
    for key, value in data.items():
        options = typing.get_args(hints[key]) if isinstance(hints[key], types.UnionType) else (hints[key],)
        if Path in options:
            values[key] = folder / _text(value, f"{title}.{key}")
        else:
            values[key] = _field_value(value, hints[key], f"{title}.{key}", None)
    return values


def table_part(path: Path) -> tuple[Any, dict[str, Any]]:
    """(part that is made from tables, arguments of its `from_tables`) of a scene. Raises SceneError if it has none."""
    for entry in _tables(_data(path), "plant"):
        item = catalogue.part(entry["part"], "part") if isinstance(entry, dict) and isinstance(entry.get("part"), str) else None
        values = {key: value for key, value in entry.items() if key != "part"} if item is not None else {}
        if _from_tables(item, values):
            return item, _of_tables(item, values, entry["part"], path.parent)
    raise SceneError('none of its parts is made from a table of sections: `part = "DrillString"` with `sections` and `survey` is.')


def _case(data: Any, where: str, plant: HybridSystem, reference: float | None) -> Case:
    _keys(data, where, None, keys.required("[[controllers]]"))
    label = _text(data["label"], f"{where}.label")
    own = keys.names("[[controllers]]")
    if "law" not in data:
        _keys(data, f"controller `{label}`, which has no `law`", ("label", "inputs", "law"))
        return Case(label, inputs=inputs_of(data.get("inputs", {}), f"{label}.inputs", plant, ()))
    named, known = data["law"], {}
    if isinstance(named, dict):
        _keys(named, f"{label}.law", None, ("law",))
        known = {key: value for key, value in named.items() if key != "law"}
        named = named["law"]
    item = catalogue.part(named, "control law")
    values = {key: value for key, value in data.items() if key not in own} | known
    law = _law(item, values, _text(named, where), reference, own)
    given = data.get("inside", [])
    for i, outer in enumerate(given if isinstance(given, list) else [given], 1):
        law = _around(law, {"law": outer} if isinstance(outer, str) else outer, f"{label}.inside[{i}]", reference)
    sample_time = data.get("sample_time")
    if sample_time is not None:
        sample_time = parse(sample_time, "s", f"{label}.sample_time")
    for key in SAMPLED if sample_time is None else ():
        if key in data:
            raise SceneError(f"The key `{key}` of `{label}` must come with `sample_time`, but there is none.")
    sensors = {key: _readings(data.get(key, {}), f"{label}.{key}", plant) for key in ("noise", "resolution")}
    delay, jitter, missed = (
        parse(data.get(key, 0.0), unit, f"{label}.{key}") for key, unit in (("delay", "s"), ("jitter", "s"), ("missed_samples", "1"))
    )
    case = Case(label, law, sample_time, delay, seed=data.get("seed", 0), jitter=jitter, missed_samples=missed, **sensors)
    return dataclasses.replace(case, inputs=inputs_of(data.get("inputs", {}), f"{label}.inputs", plant, [case]))


def named_case(name: str, plant: HybridSystem, reference: float | None) -> Case:
    """Return the case of a law of the catalogue with its own numbers, at the set-point of the scene. SceneError is raised for a law without
    a continuous form."""
    case = _case({"label": name, "law": name}, "law", plant, reference)
    made = designed(case.law, plant)
    if not isinstance(made, Controller) or type(made).continuous is Controller.continuous:
        raise SceneError(f"Law `{name}` has no continuous form: name it in the scene, under [[controllers]], with its `sample_time`.")
    return case


def _law(item: Any, values: Mapping[str, Any], title: str, reference: float | None, also: Sequence[str] = ()) -> Any:
    """A control law with these fields, and the set-point of the scene where it takes one and none is given."""
    specs = {spec.name: spec for spec in dataclasses.fields(item)}
    lacking = {type(catalogue.present(item, spec)): name for name, spec in specs.items() if name not in values}
    if lacking.get(Controller) == "law":
        raise SceneError(f'`{title}` acts around another law: name that one under `law`, and write `inside = "{title}"` beside it.')
    if Observer in lacking:
        raise SceneError(f'The key `{lacking[Observer]}` is missing in `{title}`: a table such as {{ law = "observers.Kalman" }}.')
    if reference is not None and "reference" not in values and "reference" in specs:
        values = {**values, "reference": reference}
    return _filled(item, values, title, also)


def _around(law: Controller, data: Any, where: str, reference: float | None) -> Controller:
    """A law inside another, given by its name and its fields as a table."""
    _keys(data, where, None, ("law",))
    item = catalogue.part(data["law"], "control law")
    if "law" not in typing.get_type_hints(item):
        known = [entry.name for entry in catalogue.parts("control law") if "law" in typing.get_type_hints(entry.item)]
        raise SceneError(
            f"Argument `{where}` must name a law that acts around another one, but `{data['law']}` does not: {suggest('', known)}"
        )
    return _law(item, {**data, "law": law}, data["law"], reference)


def _asking(plant: HybridSystem, cases: Sequence[Case], names: Any) -> HybridSystem:
    """The plant, or where a law asks for an input that it has not, such as `top.reference`, the plant with the first law under which all names are known."""
    system = plant
    for case in cases if isinstance(names, Mapping) else ():
        if all(system.has_signal(name) or system.has_parameter(name) for name in names):
            break
        try:
            system = ClosedLoop(plant, laws_of(case.controller, None)).system
        except SceneError as error:
            raise SceneError(f"Controller `{case.label}`: {error}") from None
    return system


def _readings(data: Any, where: str, plant: HybridSystem) -> dict[str, float]:
    """Numbers by signal, each in the unit of its signal."""
    return {name: parse(value, plant.signal_unit(name), f"{where}.{name}") for name, value in _keys(data, where).items()}


def renamed_keys(data: Mapping[str, Any], known: Collection[str], cls: type | str, title: str) -> Iterator[tuple[str, Any]]:
    """The entries of a table; a key that is the former name of a field has the name now, which one line on stderr gives."""
    for key, value in data.items():
        now = key if key in known else new_field(cls, key)
        if now != key:
            complaint(f"note: the key `{key}` of `{title}` is now `{now}`.", 0)
        yield now, value


def _filled(item: Any, data: Mapping[str, Any], title: str, also: Sequence[str] = ()) -> Any:
    """A class with these fields, or a ready-made part with these fields replaced."""
    cls = item if isinstance(item, type) else type(item)
    hints = typing.get_type_hints(cls)
    specs = {spec.name: spec for spec in dataclasses.fields(cls) if spec.init}
    values = {}
    for key, value in renamed_keys(data, specs, cls, title):
        if key not in specs:
            raise SceneError(f"There is no key `{key}` in `{title}`: {suggest(key, [*specs, *also])}")
        values[key] = _field_value(value, hints[key], f"{title}.{key}", catalogue.present(item, specs[key]))
    if not isinstance(item, type):
        return dataclasses.replace(item, **values)
    for spec in specs.values():
        if spec.name not in values and spec.default is dataclasses.MISSING and spec.default_factory is dataclasses.MISSING:
            raise SceneError(f"The key `{spec.name}` is missing in `{title}`.")
    return item(**values)


def _field_value(value: Any, hint: Any, name: str, current: Any) -> Any:
    """A field of a part from TOML, whose numbers and kinds the part itself reads and checks."""
    options = typing.get_args(hint) if isinstance(hint, types.UnionType) or typing.get_origin(hint) is typing.Union else (hint,)
    if value == "none" and types.NoneType in options:
        return None
    for base, kind in LAWS.items():
        if any(isinstance(option, type) and issubclass(option, base) for option in options) and not isinstance(value, base):
            if not isinstance(value, dict):
                raise SceneError(f"Argument `{name}` must be a table with `law`, but it is {value!r}.")
            return _named(value, name, current, base, kind)
    return _tuples(value)


def _tuples(value: Any) -> Any:
    return tuple(map(_tuples, value)) if isinstance(value, list) else value


def _named(data: Mapping[str, Any], name: str, current: Any, base: type, kind: str) -> Any:
    """A law that a table names, or the present one with other numbers."""
    values = {key: value for key, value in data.items() if key != "law"}
    if "law" in data:
        return _filled(catalogue.part(data["law"], kind), values, name, ("law",))
    if not isinstance(current, base):
        raise SceneError(f"The key `law` is missing in `{name}`.")
    return _filled(current, values, name, ("law",))


def inputs_of(data: Any, where: str, plant: HybridSystem, cases: Sequence[Case]) -> dict[str, float | Waveform]:
    """Inputs of a plant or of the laws of these cases, given by name as numbers, as text with a unit, or as tables of a shape."""
    system = _asking(plant, cases, data)
    return {name: _input(value, name, _input_unit(system, name)) for name, value in _keys(data, where).items()}


def _input(value: Any, name: str, unit: str) -> float | Waveform:
    if not isinstance(value, dict):
        return parse(value, unit, name)
    shape = next(iter(value), "")
    if len(value) != 1 or shape not in _SHAPES:
        raise SceneError(f"Argument `{name}` must be a number or one of {', '.join(f'`{s}`' for s in _SHAPES)}, but it is {value!r}.")
    units = _SHAPES[shape]
    where = f"{name}.{shape}"
    _keys(value[shape], where, tuple(units), [key for key in units if key not in OPTIONAL.get(shape, ())])
    if shape == "table":
        for key, entries in value[shape].items():
            if not isinstance(entries, list):
                raise SceneError(f"Argument `{where}.{key}` must be a list of numbers, but it is {entries!r}.")
        return Waveform(shape, {key: _number(entries, units[key] or unit, f"{where}.{key}") for key, entries in value[shape].items()})
    return Waveform(shape, {key: parse(entry, units[key] or unit, f"{where}.{key}") for key, entry in value[shape].items()})


def _number(value: Any, unit: str, name: str) -> Number:
    if isinstance(value, list):
        return tuple(parse(entry, unit, f"{name}.{i}") for i, entry in enumerate(value))
    return parse(value, unit, name)


def _input_unit(system: HybridSystem, name: str) -> str:
    if system.has_signal(name) or system.has_parameter(name):  # one that changes in time
        return system.unit(name)
    raise SceneError(f"There is no input `{name}`: {suggest(name, system.inputs)}")


def _tables(data: Mapping[str, Any], key: str) -> list[Any]:
    entries = data.get(key, [])
    if not isinstance(entries, list):
        raise SceneError(f"Argument `{key}` must be written as [[{key}]], once for each entry, but it is {entries!r}.")
    return entries


def _keys(data: Any, where: str, known: Sequence[str] | None = None, required: Sequence[str] = ()) -> dict[str, Any]:
    """A table whose keys are all known and in which none is missing."""
    if not isinstance(data, dict):
        raise SceneError(f"Argument `{where}` must be a table, but it is {data!r}.")
    for key in data:
        if known is not None and key not in known:
            raise SceneError(f"There is no key `{key}` in {where}: {suggest(key, known)}")
    for key in required:
        if key not in data:
            raise SceneError(f"The key `{key}` is missing in {where}.")
    return data


def _text(value: Any, name: str) -> str:
    if not isinstance(value, str) or not value.strip() or not value.isprintable():
        raise SceneError(f"Argument `{name}` must be text in one line, but it is {value!r}.")
    return value


def _known(value: Any, names: Sequence[Any], name: str) -> None:
    if value not in names:
        raise SceneError(f"Argument `{name}` must be one of those there are, but it is `{value}`: {suggest(str(value), map(str, names))}")
