"""Plants and whole closed loops as C99, for programs that step them: simulators of other people, test benches, real-time targets.

The event loop in C is translated from the compiled one (`toolbox.translation.translation`), and the equations are the C that casadi writes for those that the
toolbox compiles, so that neither is written a second time. All sizes are constants, all memory is one struct that belongs to the caller: saving a state is
copying it. What stands beside it in C, `machine.c`, only sets numbers, steps, and hands out names.
"""

from __future__ import annotations

import dataclasses
import itertools
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

import casadi as ca
import numpy as np

from toolbox.arguments import number
from toolbox.compilation import work_layout as layout
from toolbox.compilation.program import Program, program_of
from toolbox.errors import ControllerError, SceneError, SimulationError
from toolbox.export.c_language import STORED_TYPES, CTranslation, c_number, kinds_of
from toolbox.export.model_c import model_text, signals_of
from toolbox.export.refusals import Refusals, closed_bounds, refusals_of
from toolbox.modelling.closed_loop import ClosedLoop
from toolbox.modelling.laws import Controller, Sampled
from toolbox.modelling.number_kinds import clock_path
from toolbox.modelling.numbers import Number
from toolbox.simulation.carry_out import formulas_of
from toolbox.simulation.failures import controllers_of, not_finite, values_of
from toolbox.simulation.methods import Explicit
from toolbox.simulation.request import Request, accuracy_of
from toolbox.simulation.run import Run
from toolbox.simulation.work_arrays import work_arrays
from toolbox.translation.kinds import STORED, WORK, NotTranslatable, Value, known

FIXED = (
    layout.N,
    layout.NE,
    layout.NG,
    *layout.FORMULAS,
    layout.COUPLED,
    layout.BOUNDS,
    layout.FIRST_HELD,
    layout.NODES,
    layout.BUDGET,
    layout.OUTPUT,
)
"""Entries of `Work.ints` that are constants in C."""

CONSTANT = ("group", "excited", "kind", "initial", "attached", "loader", "lever", "bound", "keys", "clocks", "clock_keys")
"""Arrays that are constants in C."""

EVENTS, STEPS = 64, 10_000
"""Switches and steps of the engine that one call may make before it returns OVERRUN."""

MODELS = {
    layout.FIELD: "field",
    layout.STEP: "step",
    layout.PROJECT: "project",
    layout.PROBE: "probe",
    layout.BURDEN: "burden",
    layout.IMPULSE: "impulse",
}
"""{entry of `Work.ints` with the address of machine code: the function in its place in C}."""

STATUS = {
    layout.DONE: ("DONE", "the time asked for is reached"),
    layout.PAUSED: ("OVERRUN", "the call has made all the steps that it may: call again to go on"),
    layout.EVENTS_FULL: ("OVERRUN", "the call has made all the switches that it may: call again to go on"),
    layout.ENDLESS: ("ENDLESS", "switching has no end"),
    layout.UNDERFLOW: ("UNDERFLOW", "the steps have become too short"),
    layout.INCONSISTENT: ("INCONSISTENT", "no modes are consistent"),
    layout.NEGATIVE_BOUND: ("NEGATIVE_BOUND", "the bound of a friction is negative: is its load?"),
    layout.NOT_FINITE: ("NOT_FINITE", "a controller gives a command, or remembers a value, that is no finite number"),
    layout.STATE_NOT_FINITE: ("STATE_NOT_FINITE", "a state is no finite number"),
    layout.STALLED: ("STALLED", "a million steps have hardly moved the time"),
}


@dataclass(frozen=True)
class Entry:
    """A number that the caller may set, or read: its name, unit, and place in an array."""

    name: str
    unit: str
    place: int = 0


@dataclass(frozen=True)
class Machine:
    """A loop made ready for C: the run that it was tried with, its program and arrays."""

    name: str
    loop: ClosedLoop
    run: Run
    program: Program
    sizes: np.ndarray
    """The largest magnitude of every state in the run."""

    @cached_property
    def work(self) -> dict[str, np.ndarray]:
        """The arrays as they are before the first step, without room for records."""
        arrays = work_arrays(self.run, self.program)._asdict()
        instant = 2 * self.program.kernel.elements + 1
        for name in arrays:
            if name.startswith("rec_"):
                arrays[name] = np.zeros((8, *arrays[name].shape[1:]), arrays[name].dtype)
            elif name.startswith("ev_"):
                arrays[name] = np.zeros((EVENTS + instant, *arrays[name].shape[1:]), arrays[name].dtype)
        ints, reals = arrays["ints"], arrays["reals"]
        ints[layout.NODES], ints[layout.BUDGET] = 0, STEPS
        reals[layout.END], reals[layout.LAST] = 0.0, np.inf
        arrays["samplers"] = arrays["samplers"].copy()
        for c in range(len(arrays["samplers"])):
            arrays["samplers"][c, layout.ADDRESS] = c + 1
        room = len(self.settable)  # in front of the jumps of tables, for those that the caller makes
        arrays["jump_first"] = np.concatenate([[0], arrays["jump_first"] + room])
        arrays["jump_t"] = np.concatenate([[-np.inf], arrays["jump_t"]])
        arrays["jump_index"] = np.concatenate([np.zeros(room, np.int64), arrays["jump_index"]])
        arrays["jump_value"] = np.concatenate([np.zeros(room), arrays["jump_value"]])
        ints[layout.JUMP] = 1
        return arrays

    @cached_property
    def inputs(self) -> list[Entry]:
        """Inputs that the caller sets, as numbers."""
        slots = self.program.coefficient_slot
        return [Entry(name, self.program.system.inputs[name].unit, slots[name]) for name, kind in self.run.kinds if kind == "number"]

    @cached_property
    def parameters(self) -> list[Entry]:
        """Parameters with an effect. A parameter is left out if an input of the same name replaces it.

        A sample time in the equations of a controller is none of them, because the clock of the machine would not follow.
        """
        found, program, taken = [], self.program, {entry.name for entry in self.inputs}
        taken |= {path for i in range(len(self.loop.controllers)) if (path := clock_path(self.loop, i)) is not None}
        laws = [each for _, following, outputs in program.updates for each in (following, outputs)]
        every = ca.vertcat(program.form.field, program.form.guards, program.form.probed, signals_of(program), *laws)
        acting = set(ca.jacobian_sparsity(ca.densify(every), program.equations.p).get_triplet()[1])
        for name, entry in program.system.parameters.items():
            rows = [name] if entry.size is None else [f"{name}.{i}" for i in range(entry.size)]
            found += [
                Entry(row, entry.unit, entry.offset + i) for i, row in enumerate(rows) if entry.offset + i in acting and row not in taken
            ]
        return found

    @cached_property
    def settable(self) -> list[Entry]:
        """Inputs, then parameters."""
        return [*self.inputs, *self.parameters]

    def number(self, entry: Entry) -> Number | None:
        """Return the declared number of a settable entry; None if the entry is neither an input nor declared."""
        is_input = entry.name in {each.name for each in self.inputs}
        return self.loop.number(entry.name) if is_input or self.program.system.has_parameter(entry.name) else None

    @cached_property
    def refusals(self) -> Refusals:
        """Bounds of the settable numbers, and relations between them."""
        system, places = self.program.system, dict[int, int]()
        declared = [self.number(entry) for entry in self.settable]
        for i, entry in enumerate(self.settable):
            if i >= len(self.inputs):
                places[entry.place] = i
            elif entry.name in system.parameters:  # the default of the input, in whose place it stands
                places[system.parameters[entry.name].offset] = i
        return refusals_of([closed_bounds(each.bounds if each is not None else {}) for each in declared], system.parts, places)

    @cached_property
    def states(self) -> list[Entry]:
        """The states."""
        found = []
        for name, (first, size, unit) in self.program.system.states.items():
            rows = [name] if size is None else [f"{name}.{i}" for i in range(size)]
            found += [Entry(row, unit, first + i) for i, row in enumerate(rows)]
        return found

    @cached_property
    def outputs(self) -> list[Entry]:
        """The states, then the other signals, as `toolbox.export.model_c` gives them."""
        system = self.program.system
        found = [Entry(each.name, each.unit) for each in self.states]
        for name, (expression, unit) in system.signals.items():
            if system.state_index(name) is None:
                size = expression.numel()
                found += [Entry(row, unit) for row in ([name] if size == 1 else [f"{name}.{i}" for i in range(size)])]
        return found

    def translated(self, importer: bool = False) -> CTranslation:
        """Return the event loop in C. `importer` adds the functions for a program that integrates by itself."""
        from toolbox.export.event_mode import event_mode  # here, because LLVM is slow to import
        from toolbox.stepping.event_stepper import advance

        ints = self.work["ints"]
        numbers: dict[tuple[str, int], Any] = {("ints", place): int(ints[place]) for place in FIXED}
        numbers["reals", layout.POWER] = float(self.work["reals"][layout.POWER])
        models = {int(ints[place]): f"{self.name}_model_{word}" for place, word in MODELS.items() if ints[place]}
        constant = {word: f"{self.name}_{word}" for word in CONSTANT}
        made = CTranslation(
            {WORK: kinds_of(self.work)}, numbers, constant, models=models, update=f"{self.name}_update", struct=f"{self.name}_machine"
        )
        made.written(advance, [Value("w", WORK), known(None)])
        if importer:
            made.written(event_mode, [Value("w", WORK), Value("entered", "b")])
        return made


def why(status: int, work: Any, program: Program) -> str:
    """Why a machine cannot be stepped on, as the end of a sentence, with the contact that is in the way."""
    if status == layout.NOT_FINITE:
        return not_finite(program.system, int(work.ints[layout.CULPRIT]), float(work.reals[layout.TIME]), work.z)
    words = STATUS.get(status, ("", "it failed"))[1]
    if status == layout.NEGATIVE_BOUND:
        words = words.replace("a friction", f"`{program.system.elements[work.ints[layout.CULPRIT]].name}`")
    return words if words.endswith("?") else words + "."


def stopped(status: int) -> type[SimulationError]:
    """The kind of error of a machine that cannot be stepped on."""
    return ControllerError if status == layout.NOT_FINITE else SimulationError


# ---------------------------------------------------------------------------------------------------------------------------------------- refusals
@dataclass(frozen=True)
class _Watched(Explicit):
    """The steps that go to C, in a run that changes to implicit ones where these pay."""

    watches_stiffness: ClassVar[bool] = True


def machine(loop: ClosedLoop, name: str, duration: Any = None, accuracy: float | None = None) -> Machine:
    """Return a loop prepared for C, after a trial run that shows how it steps. SceneError is raised for a loop that C cannot express."""
    for given in loop.controllers:
        law = given.law if isinstance(given, Sampled) else given
        if not isinstance(law, Controller):
            raise SceneError(
                f"A loop goes to C with laws of casadi expressions, but {type(law).__name__} is a law in Python: export the plant alone."
            )
    for law in loop.designed_controllers:
        if not isinstance(law, Controller):
            raise SceneError(
                f"A loop goes to C with laws of casadi expressions, but {type(law).__name__} solves a program at every sample: export the plant, and where "
                'it can the law by itself, `export_c(loop, path, part="law")`.'
            )
    span = loop.duration if duration is None else duration
    if span is None:
        raise SceneError("Argument `duration` must be given, over which the accuracy holds: only a loop out of a scene has one of its own.")
    span = number("duration", span, "s", above=0)
    tried = Request(_with_all_inputs(loop), span, None, _Watched(), accuracy_of(loop, accuracy)).checked()
    done = tried.again()
    if done.program.formulas.implicit:
        raise SceneError("The loop must be one for explicit steps to go to C, but it is stiff: its run takes implicit ones.")
    run = dataclasses.replace(tried, method=Explicit())
    return Machine(name, tried.loop, run, program_of(run.system, run.kinds, formulas_of(run)), np.abs(done.states).max(axis=0))


def _with_all_inputs(loop: ClosedLoop) -> ClosedLoop:
    """The loop with every input that has a constant default as a number, so that it can be set."""
    system, found = loop.system, dict(loop.inputs)
    for name, entry in system.inputs.items():
        if name not in found and not ca.depends_on(entry.default, ca.vertcat(system.t, system.x)):
            value = ca.substitute(entry.default, system.p, ca.DM(system.values)) if system.p.numel() else entry.default
            if ca.SX(value).is_constant() or not ca.symvar(ca.SX(value)):
                found[name] = float(ca.evalf(value))
    return loop.replace(inputs=found)


# -------------------------------------------------------------------------------------------------------------------------------------------- text
def machine_sources(made: Machine, importer: bool = False) -> dict[str, str]:
    """Return {file: text} of the header and the source. `importer` adds the event mode and derivatives for a program that integrates by
    itself.

    Raises SceneError where the loop holds what C has no words for.
    """
    try:
        loop = made.translated(importer)
    except NotTranslatable as error:
        raise SceneError(f"The event loop cannot be written in C: {error}.") from error
    return {f"{made.name}.h": _header(made), f"{made.name}.c": _source(made, loop, importer)}


def machine_files(made: Machine) -> dict[str, str]:
    """{file: text} of a machine in C. Raises SceneError as `machine_sources` does."""
    return {
        **machine_sources(made),
        "main.c": filled("machine_main.c", made),
        "CMakeLists.txt": filled("machine_cmake.txt", made),
        "README.md": _readme(made),
    }


def filled(template: str, made: Machine) -> str:
    """A file beside this one, with the name of the machine."""
    text = Path(__file__).with_name(template).read_text(encoding="utf-8")
    words = {"NAME": made.name, "UPPER": made.name.upper(), "DURATION": repr(float(made.run.duration)), "TITLE": made.loop.title}
    return re.sub(r"@(\w+)@", lambda found: words[found[1]], text)


def _c_name(name: str) -> str:
    return re.sub(r"\W", "_", name)


def _members(made: Machine) -> dict[str, np.ndarray]:
    """The arrays that are in the struct."""
    return {name: array for name, array in made.work.items() if name not in CONSTANT}


def _header(made: Machine) -> str:
    upper, name = made.name.upper(), made.name
    groups = {"INPUT": made.inputs, "PARAMETER": made.parameters, "STATE": made.states, "OUTPUT": made.outputs}
    lines = [
        f"/* {made.loop.title}: a machine exported by stickslip-toolbox. SI units, angles in rad. See README.md. */",
        f"#ifndef {upper}_H",
        f"#define {upper}_H",
        "",
        "#include <stdint.h>",
        "",
    ]
    first = 0
    for word, entries in groups.items():
        first = len(made.inputs) if word == "PARAMETER" else 0
        lines += [f"#define {upper}_{word}S {len(entries)}"]
        lines += [f"#define {upper}_{word}_{_c_name(entry.name)} {first + i} /* [{entry.unit}] */" for i, entry in enumerate(entries)]
    elements = made.program.system.elements
    lines += [f"#define {upper}_ELEMENTS {len(elements)}"]
    for i, element in enumerate(elements):
        legend = ", ".join(f"{mode}: {word}" for mode, word in sorted(element.mode_names.items()))
        lines.append(f"#define {upper}_ELEMENT_{_c_name(element.name)} {i} /* {legend} */")
    lines += ["", "/* what a step returns, and what is set */"]
    for code, (word, meaning) in STATUS.items():
        if word != "OVERRUN" or code == layout.PAUSED:
            lines.append(f"#define {upper}_{word} {code} /* {meaning} */")
    lines += [
        f"#define {upper}_BACKWARD (-1) /* the time asked for lies before the present one, or is no number */",
        f"#define {upper}_UNKNOWN (-2) /* there is no such number, or it cannot be set now */",
        f"#define {upper}_OUTSIDE (-3) /* the value is not finite, out of bounds, or not allowed beside the others: nothing is changed */",
        "",
    ]
    lines += [
        "/* everything that changes; only the functions below read and write it, and a copy of it is a saved state */",
        f"typedef struct {name}_machine {{",
    ]
    for member, array in _members(made).items():
        lines.append(f"  {STORED_TYPES[str(array.dtype)]} {member}[{max(array.size, 1)}];")
    lines += [
        f"  double wanted[{max(len(made.settable), 1)}];",
        f"}} {name}_machine;",
        "",
        filled("machine_api.h", made),
        f"#endif /* {upper}_H */",
        "",
    ]
    return "\n".join(lines)


def _numbers(array: np.ndarray) -> str:
    kind = STORED[str(array.dtype)]
    return (
        ", ".join(c_number(np.uint64(each) if kind == "u" else float(each) if kind == "f" else int(each)) for each in array.ravel()) or "0"
    )


def _tables(made: Machine) -> list[str]:
    """What `machine.c` reads: bounds, places and names of what can be set, and names of what can be read, and of what controllers give."""
    name = made.name
    second = ", ".join(str(int(element.second)) for element in made.program.system.elements) or "0"
    system = made.program.system
    titles, values = controllers_of(system), [values_of(system, c) for c in range(len(system.updates))]
    firsts = [0, *itertools.accumulate(map(len, values))]
    return [
        made.refusals.text(name),
        f"static const int32_t {name}_first_value[{len(firsts)}] = {{{', '.join(map(str, firsts))}}};",
        f"static const uint8_t {name}_second[{max(len(made.program.system.elements), 1)}] = {{{second}}};",
        f"static const int32_t {name}_places[{max(len(made.settable), 1)}] = {{{', '.join(str(each.place) for each in made.settable) or '0'}}};",
        *(
            f"static const char *const {name}_{word}[{max(len(entries), 1)}] = {{{', '.join(_quoted(each) for each in entries) or '0'}}};"
            for word, entries in (
                ("settable_names", [each.name for each in made.settable]),
                ("output_names", [each.name for each in made.outputs]),
                ("element_names", [each.name for each in made.program.system.elements]),
                ("value_names", [f"{each} of {title}" for title, row in zip(titles, values, strict=True) for each in row]),
            )
        ),
    ]


def _source(made: Machine, loop: CTranslation, importer: bool) -> str:
    name = made.name
    calling = loop.source() + filled("machine.c", made) + (filled("machine_fmi.c", made) if importer else "")
    constants = [
        f"static const {STORED_TYPES[str(made.work[word].dtype)]} {name}_{word}[{max(made.work[word].size, 1)}] = {{{_numbers(made.work[word])}}};"
        for word in CONSTANT
        if re.search(rf"\b{name}_{word}\[", "".join(each.text for each in loop.order))
    ]
    starts, values = [], []
    for member, array in _members(made).items():
        if member == "ints":  # no addresses of this process: C calls its functions by their names
            array = array.copy()
            array[list(MODELS)] = 0
        if array.size and (array != 0).any() and not member.startswith(("rec_", "ev_")):
            places = np.flatnonzero(array)
            values.append(f"static const int32_t {name}_at_{member}[{places.size}] = {{{', '.join(map(str, places.tolist()))}}};")
            values.append(
                f"static const {STORED_TYPES[str(array.dtype)]} {name}_first_{member}[{places.size}] = {{{_numbers(array.ravel()[places])}}};"
            )
            starts.append(f"  for (i = 0; i < {places.size}; ++i) w->{member}[{name}_at_{member}[i]] = {name}_first_{member}[i];")
    modes = [
        f"  if (element == {i} && mode == {mode}) return {_quoted(word)};"
        for i, element in enumerate(made.program.system.elements)
        for mode, word in element.mode_names.items()
    ]
    return "\n\n".join(
        [
            f"/* The machine of {name}.h: its equations as casadi writes them, and the event loop of the toolbox, translated. */",
            f'#include "{name}.h"\n\n#include <math.h>\n#include <string.h>',
            model_text(name, made.program, calling, [each.place for each in made.settable] if importer else None),
            "\n".join(constants),
            loop.source(),
            "\n".join(values),
            "\n".join(_tables(made)),
            f"static const char *{name}_mode_word(int element, int mode) {{\n"
            + "\n".join([*modes, "  (void)element; (void)mode;", '  return "";'])
            + "\n}",
            f"static void {name}_copy_start({name}_machine *w) {{\n"
            + "\n".join(["  int i;", "  memset(w, 0, sizeof *w);", *starts])
            + "\n}",
            "\n".join(f"#define {word} {place}" for word, place in _places().items()),
            filled("machine.c", made),
        ]
    )


def _places() -> Mapping[str, int]:
    """Places in `ints` and `reals` that `machine.c` names."""
    words = ("TIME", "END", "JUMP", "EVENTS", "STARTED", "CULPRIT", "ACCEPTED", "REJECTED", "EVENTS_FULL", "PAUSED")
    return {f"AT_{word}": getattr(layout, word) for word in words}


def _quoted(text: str) -> str:
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'


def _readme(made: Machine) -> str:
    def table(entries: list[Entry], first: int = 0) -> str:
        return "\n".join(
            [
                "| number | name | unit |",
                "|---|---|---|",
                *(f"| {first + i} | `{each.name}` | {each.unit} |" for i, each in enumerate(entries)),
            ]
        )

    elements = [
        f"| {i} | `{element.name}` | {', '.join(f'{mode} {word}' for mode, word in sorted(element.mode_names.items()))} |"
        for i, element in enumerate(made.program.system.elements)
    ]
    return filled("machine_readme.md", made) + "\n".join(
        [
            f"Accuracy: {made.run.accuracy:g} over {made.run.duration:g} s. One call makes at most {STEPS} steps and {EVENTS} switches.",
            "", "## Inputs", table(made.inputs), "", "## Parameters", table(made.parameters, len(made.inputs)), "", "## Outputs", table(made.outputs),
            "", "## Elements", "| number | name | modes |", "|---|---|---|", *elements, "",
        ]
    )  # fmt: skip


def written_machine(loop: ClosedLoop, path: str | Path, duration: Any, accuracy: float | None) -> tuple[Path, Path]:
    """Write a machine into a folder; see `toolbox.export_c`."""
    from toolbox.export.law_text import replaced_together

    folder = Path(path)
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", folder.name):
        raise SceneError(f"Argument `path` must end in a name of C, letters, digits and _, but it is `{path}`.")
    if folder.name.lower() == "main":
        raise SceneError(f"Argument `path` must not end in main, which is the example beside the machine, but it is `{path}`.")
    files = machine_files(machine(loop, folder.name, duration, accuracy))
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise SceneError(f"Cannot write `{folder}`: {error.strerror}.") from None
    replaced_together({folder / name: text for name, text in files.items()})
    return folder / f"{folder.name}.c", folder / f"{folder.name}.h"
