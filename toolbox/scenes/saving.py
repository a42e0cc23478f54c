"""Scenes to TOML, every parameter in SI; `toolbox.scenes.scene_file` reads them."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from toolbox.files.atomic import replaced
from toolbox.files.units import TypedNumber
from toolbox.modelling.laws import Controller
from toolbox.scenes import catalogue, keys
from toolbox.scenes.cases import Case, Waveform
from toolbox.scenes.scene_file import LAWS, SAMPLED

HEADER = b"# Every parameter in SI units, angles in rad.\n"


def write(scene: Mapping[str, Any], path: Path) -> None:
    """Write a scene, given by its fields, with every parameter in SI, whole or not at all."""
    import tomli_w

    units = {unit: shown for unit, shown in scene["units"].items() if shown != unit}
    content = HEADER + tomli_w.dumps(_resolved(scene) | ({"units": units} if units else {})).encode()
    with replaced(path) as file:
        file.write(content)


def _resolved(scene: Mapping[str, Any]) -> dict[str, Any]:
    data: dict[str, Any] = {"title": scene["title"], "duration": float(scene["duration"]), "accuracy": float(scene["accuracy"])}
    if scene["reference"] is not None:
        data["reference"] = _plain(scene["reference"])
    judged = {**scene, "element": scene["contact"]}
    data["verdict"] = {name: _plain(judged[name]) for name in keys.names("[verdict]") if judged[name] is not None}
    for key in ("start", "inputs", "parameters"):
        if scene[key]:
            data[key] = {name: _plain(value) for name, value in scene[key].items()}
    if scene["measured"] is not None:
        log = scene["measured"]
        data["measured"] = {"file": log.file.as_posix()}
        data["measured"] |= {"columns": dict(log.columns)} if log.columns else {}
        data["measured"] |= {"windows": [list(window) for window in log.windows]} if log.windows else {}
    data["plant"] = [{"part": catalogue.name_of(type(part))} | _fields(part) for part in scene["parts"]]
    data["controllers"] = [_resolved_case(case) for case in scene["cases"]]
    return data


def flat(scene: Mapping[str, Any]) -> dict[str, Any]:
    """Return {key: value in SI} of a scene given by its fields. A part or a law has its name in the catalogue or its label, with a number
    if there are several."""
    found: dict[str, Any] = {}

    def put(name: str, value: Any) -> None:
        if isinstance(value, Mapping):
            for key, each in value.items():
                put(f"{name}.{key}" if name else key, each)
        elif isinstance(value, list) and value and all(isinstance(each, Mapping) for each in value):
            for each in value:
                put(f"{name}.{each['law']}", each)
        elif value is not None:
            found[name] = value

    data = _resolved(scene)
    for key, value in data.items():
        if key in ("plant", "controllers"):
            titles = [str(entry.get("label", entry.get("part"))) for entry in value]
            for i, (title, entry) in enumerate(zip(titles, value, strict=True)):
                put(f"{key}.{title}" + (f" {titles[: i + 1].count(title)}" if titles.count(title) > 1 else ""), entry)
        else:
            put(key, value)
    return found


def _resolved_case(case: Case) -> dict[str, Any]:
    data: dict[str, Any] = {"label": case.label}
    if case.law is not None:
        around = _nested(case.law)
        inner = around.pop()
        law = {"law": catalogue.name_of(type(inner))}
        fields = _fields(inner)
        known = {key: fields.pop(key) for key in SAMPLED if key in fields}
        data |= {"law": law | known} | fields if known else law | fields
        if around:
            data["inside"] = [_fields(outer) | {"law": catalogue.name_of(type(outer))} for outer in reversed(around)]
        if case.sample_time is not None:
            data |= {"sample_time": float(case.sample_time), "delay": float(case.delay)}
            data |= {
                key: {name: float(value) for name, value in getattr(case, key).items()}
                for key in ("noise", "resolution")
                if getattr(case, key)
            }
            data |= {key: float(value) for key in ("jitter", "missed_samples") if (value := getattr(case, key))}
            if case.noise or case.jitter or case.missed_samples:
                data["seed"] = case.seed
    if case.inputs:
        data["inputs"] = {name: _plain(value) for name, value in case.inputs.items()}
    return data


def _nested(law: Controller) -> list[Controller]:
    """A law and those inside it, from the outside in."""
    inner = getattr(law, "law", None)
    return [law, *_nested(inner)] if isinstance(inner, Controller) else [law]


def _fields(part: Any) -> dict[str, Any]:
    """Every field of a part; TOML has no null, so an absent one is left out, or "none" where the class would fill it in."""
    data = {}
    for spec in dataclasses.fields(part):
        value = getattr(part, spec.name)
        if value is not None:
            data[spec.name] = _plain(value)
        elif spec.default is not None:
            data[spec.name] = "none"
    return data


def _plain(value: Any) -> Any:
    if isinstance(value, tuple(LAWS)):
        return {"law": catalogue.name_of(type(value))} | _fields(value)
    if isinstance(value, Waveform):
        return {value.shape: {key: _plain(number) for key, number in value.numbers.items()}}
    if isinstance(value, (tuple, list, np.ndarray)):
        return [_plain(entry) for entry in value]
    if isinstance(value, (str, bool, int, TypedNumber)):
        return value
    return _fields(value) if dataclasses.is_dataclass(value) else float(value)
