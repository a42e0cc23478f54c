"""The keys of a scene file: one source for who reads a file, for `stickslip list scene` and for the page of the documentation."""

from __future__ import annotations

from typing import NamedTuple


class Key(NamedTuple):
    """A key of a scene file: its unit ("" for text and names), its default, and its meaning."""

    name: str
    unit: str
    default: str
    meaning: str


REQUIRED = "required"

OF_SIGNAL = "of `signal`"
"""The unit of a number that is compared with the judged signal."""

CONTACTS = "At the head, for a body with many contacts"
"""The table of keys at the head of the scene of such a body."""

KEYS: dict[str, tuple[Key, ...]] = {
    "scene": (
        Key("title", "", REQUIRED, "title of tables and figures"),
        Key("duration", "s", REQUIRED, "length of the runs"),
        Key("accuracy", "1", "1e-6", "target for the error of a state, in parts of its size"),
        Key("reference", OF_SIGNAL, "none", "set-point of the judged signal; laws with a field `reference` take it"),
        Key("plant", "", REQUIRED, "parts of the machine, each under [[plant]]"),
        Key("controllers", "", "the plant alone", "controllers to be compared, each under [[controllers]]"),
        Key("start", "", "at rest", "states at the beginning, under [start]"),
        Key("inputs", "", "those of the parts", "inputs in time, under [inputs]"),
        Key("parameters", "", "those of the parts", "what the machine really is, under [parameters]"),
        Key("verdict", "", "see there", "what is judged, under [verdict]"),
        Key("measured", "", "none", "what was measured on the machine, under [measured]"),
        Key("units", "", "as typed", "units of tables and figures, under [units]"),
    ),
    CONTACTS: (
        Key("title", "", REQUIRED, "title of tables and figures"),
        Key("duration", "s", REQUIRED, "length of the runs, which begin at rest under the forces at their beginning"),
        Key("step", "s", REQUIRED, "length of a time step"),
        Key("plant", "", REQUIRED, "the body, such as ElasticFace, once under [[plant]]"),
        Key("controllers", "", "the body alone", "sampled laws to be compared, and cases without a law, each under [[controllers]]"),
        Key("inputs", "", "0", "forces and speeds of the counter-surface in time, under [inputs]"),
    ),
    "[[plant]]": (
        Key("part", "", REQUIRED, "a part of `stickslip list`, such as BitRock or wells.JANSEN_2"),
        Key("<parameter>", "of the part", "of the part", "any parameter of it; a friction law is { law = \"Exponential\", static = 0.8 }; a part made from "
            "tables takes what its `from_tables` takes, and an elastic body is the path of its file, with paths from the folder of the scene"),
    ),
    "[[controllers]]": (
        Key("label", "", REQUIRED, "its name in tables, figures and files"),
        Key("law", "", "the plant alone", "a control law of `stickslip list`; where a parameter of it has the name of a key, { law = \"LinearMPC\", "
            "delay = \"30 ms\" }"),
        Key("<parameter>", "of the law", "of the law", "any parameter of the law"),
        Key("inside", "", "none", "what acts around the law, from inside out: \"Lifting\", or { law = \"Lifting\", first_factor = 1.6 }, or a list of such"),
        Key("sample_time", "s", "continuous", "period of a sampled law"),
        Key("delay", "s", "0", "time from a sample to its effect; sampled laws only"),
        Key("noise", "of each signal", "none", "standard deviations of what a sampled law measures: { \"shaft.speed\" = 0.01 }"),
        Key("resolution", "of each signal", "none", "steps of what a sampled law measures"),
        Key("jitter", "s", "0", "largest lateness of a sample; sampled laws only"),
        Key("missed_samples", "1", "0", "probability that a sample is missed; sampled laws only"),
        Key("seed", "1", "0", "seed of noise, jitter and missed samples, an integer"),
        Key("inputs", "of each input", "those of the scene", "inputs in time of this case alone"),
    ),
    "[start]": (Key("<state>", "of the state", "0", "value of a state at the beginning"),),
    "[inputs]": (
        Key("<signal>", "of the signal", "its default", "a number, or { ramp = { start, end, begin, finish } }, likewise step, sine, noise, sweep, square, "
            "triangle, start_up, table = { times, values }; for an input of the plant, "
            "a parameter that changes in time, or what all laws ask for, such as a set-point"),
    ),
    "[parameters]": (Key("<name>", "of the parameter", "as declared", "value of a parameter where the machine is not what the controllers are designed for"),),
    "[verdict]": (
        Key("element", "", "the only contact", "the contact whose sticking is judged"),
        Key("signal", "", "the speed at the contact", "the speed whose severity, settling and overshoot are judged"),
        Key("effort", "", "what drives", "the signal whose peak is reported"),
        Key("after", "s", "half of the duration", "time from which on a run is judged"),
        Key("standstill_speed", OF_SIGNAL, "none", "of a stop: the value of the signal at which the machine stands, where the verdict ends"),
    ),
    "[units]": (Key("<SI unit>", "", "as typed", "unit in which numbers of this SI unit are shown: \"m/s\" = \"km/h\""),),
    "[measured]": (
        Key("file", "", REQUIRED, "path of the log, from the folder of the scene"),
        Key("columns", "", "the names of the plant", "what signals, or time, are called in the log: { \"shaft.speed\" = \"speed sensor 2\" }"),
        Key("windows", "s", "all of it", "stretches of the log, each simulated from `start` on under what was measured of the inputs: [[\"5 s\", \"35 s\"]]"),
    ),
}  # fmt: skip
"""{table of the file: its keys}; a name in <> stands for many."""


def names(table: str) -> tuple[str, ...]:
    """Names of the keys of a table."""
    return tuple(key.name for key in KEYS[table] if not key.name.startswith("<"))


def required(table: str) -> tuple[str, ...]:
    """Names of the keys that a table must have."""
    return tuple(key.name for key in KEYS[table] if key.default == REQUIRED)
