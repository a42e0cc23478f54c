"""Machines as FMUs: the C of `toolbox.export.machine_c` behind FMI 2.0 or 3.0, for co-simulation and for model exchange.

In co-simulation the machine steps itself, by the event loop of the toolbox. In model exchange the importer integrates: it gets states with the hidden
forces among them, a residual of every guard, and an event mode of the same functions (`toolbox.export.event_mode`). What stands in C by hand,
`machine_fmi.c` and the interface of each version, sets and gives numbers.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import casadi as ca

from toolbox.compilation import work_layout as layout
from toolbox.export.fmu_archive import REAL, fmu_archive, refusing
from toolbox.export.machine_c import EVENTS, Machine, filled, machine, machine_sources
from toolbox.modelling.closed_loop import ClosedLoop

NO_EXCHANGE = "a friction in two directions turns without bound at rest"
FIELD = "Float64"

NOMINAL = 0.1
"""Nominal value of a state as a share of its largest magnitude, in the run of the export and so far: what it has in most of a run, not at its peaks.

Importers take their absolute tolerance from it. With the largest magnitude itself small motions are lost in it, from which stick-slip grows.
"""


@dataclass(frozen=True)
class Variable:
    """A variable of a unit: its name, reference, and attributes of FMI."""

    name: str
    reference: int
    causality: str
    unit: str = ""
    number: Mapping[str, str] = field(default_factory=dict)  # start, min, max, derivative
    role: Mapping[str, str] = field(default_factory=dict)  # variability, initial
    meaning: str = ""
    whole: bool = False


@dataclass(frozen=True)
class Unit:
    """A machine as a unit of FMI: its variables and its sources."""

    made: Machine
    version: str

    @cached_property
    def integrated(self) -> int:
        """Number of states, hidden ones included."""
        return int(self.made.work["ints"][layout.N])

    @cached_property
    def exchanges(self) -> bool:
        """Whether it goes by model exchange, too."""
        return not any(element.second for element in self.made.program.system.elements)

    @cached_property
    def indicators(self) -> list[tuple[int, bool]]:
        """(guard, whether it is its rate) of every event indicator: rates of contacts, which can dip below zero and come back within a step."""
        guards, elements = int(self.made.work["ints"][layout.NG]), self.made.program.system.elements
        return [(j, False) for j in range(guards)] + [(2 * i, True) for i, element in enumerate(elements) if element.has_gap]

    @cached_property
    def variables(self) -> list[Variable]:
        """All variables, in the order of their references."""
        made, system = self.made, self.made.program.system
        found = [Variable("time", 0, "independent", "s", role={"variability": "continuous"})] if self.version == "3.0" else []
        found += self._settable() + self._integrated()
        first = 1 + len(made.settable) + 2 * self.integrated
        taken = {each.name for each in found}
        others = made.outputs[len(made.states) :]
        found += [Variable(entry.name, first + i, "output", entry.unit) for i, entry in enumerate(others) if entry.name not in taken]
        first += len(others)
        if self.version == "3.0":
            for i, (j, rate) in enumerate(self.indicators):
                found.append(Variable(f"indicator.{'rate.' if rate else ''}{j}", first + i, "local"))
        first += len(self.indicators)
        for i, element in enumerate(system.elements):
            if not element.second and element.name not in system.shared_modes:
                words = ", ".join(f"{mode}: {word}" for mode, word in sorted(element.mode_names.items()))
                found.append(
                    Variable(f"{element.name}.mode", first + i, "output", role={"variability": "discrete"}, meaning=words, whole=True)
                )
        return found

    def _settable(self) -> list[Variable]:
        """Inputs and parameters."""
        made, system, found = self.made, self.made.program.system, []
        slips = ca.vertcat(*[element.slip for element in system.elements])
        bent = {name for i, name in enumerate(system.inputs) if slips.numel() and ca.depends_on(slips, system.u[i])}
        for i, entry in enumerate(made.settable):
            is_input = i < len(made.inputs)
            number = made.number(entry)
            start = {"start": repr(float(made.work["p"][entry.place]))} | _limits(number.bounds if number is not None else {})
            role = {"variability": ("discrete" if entry.name in bent else "continuous") if is_input else "tunable"}
            kind, meaning = "input" if is_input else "parameter", number.meaning if number is not None else ""
            found.append(Variable(entry.name, 1 + i, kind, entry.unit, start, role, meaning))
        return found

    def _integrated(self) -> list[Variable]:
        """States, those that an importer does not know by name among them, and their rates."""
        made, found, rates, exact = self.made, [], [], {"initial": "exact", "variability": "continuous"}
        first = 1 + len(made.settable)
        for i in range(self.integrated):
            start = {"start": repr(float(made.work["x"][i]))}
            if i < len(made.states):
                found.append(Variable(made.states[i].name, first + i, "output", made.states[i].unit, start, exact))
            else:
                name = f"hidden.{i - len(made.states)}"
                found.append(Variable(name, first + i, "local", "", start, exact, "a sticking force that varies in time"))
            rates.append(Variable(f"der({found[i].name})", first + self.integrated + i, "local", "", {"derivative": str(first + i)}))
        return found + rates

    def source(self, guid: str) -> str:
        """The interface in C."""
        made, version = self.made, self.version[0]
        elements = len(made.program.system.elements)
        sizes = {
            "INTEGRATED": self.integrated, "GUARDS": int(made.work["ints"][layout.NG]), "INDICATORS": len(self.indicators),
            "SAMPLERS": len(made.work["samplers"]), "EVENT_ROOM": EVENTS + 2 * elements + 1, "EXCHANGES": int(self.exchanges),
        }  # fmt: skip
        nominal = [made.sizes[i] if i < len(made.sizes) and made.sizes[i] > 0.0 else 1.0 for i in range(self.integrated)]
        from toolbox.export.event_mode import UNARMED  # here, because LLVM is slow to import

        tables = [
            *(f"#define {word} {size}" for word, size in sizes.items()),
            f"#define UNARMED {UNARMED!r}",
            f"#define NOMINAL_SHARE {NOMINAL!r}",
            f"static const double nominal[] = {{{', '.join(repr(float(each)) for each in [*nominal, 1.0])}}};",
            f"static const int indicator_guard[] = {{{', '.join([*(str(j) for j, _ in self.indicators), '0'])}}};",
            f"static const int indicator_rate[] = {{{', '.join([*(str(int(rate)) for _, rate in self.indicators), '0'])}}};",
        ]
        core = filled("machine_fmi.c", made)
        head = core.index("/* References")
        core = core[:head] + "\n".join(tables) + "\n\n" + core[head:]
        interface = Path(__file__).with_name(f"machine_fmi{version}.c").read_text(encoding="utf-8").replace("@CORE@", core)
        return "\n".join(
            [
                f'#define GUID "{guid}"',
                f'#define NO_EXCHANGE "{NO_EXCHANGE}"',
                "#ifdef _WIN32",
                "#define EXPORT __declspec(dllexport)",
                "#else",
                "#define EXPORT",
                "#endif",
                interface,
                *("EXPORT " + refusing(*each) for each in (REFUSED_2 if version == "2" else refused_3())),
                "",
            ]
        )


def _limits(bounds: Mapping[str, Any]) -> dict[str, str]:
    """Bounds of a number as FMI has them, which knows no open ones."""
    low = bounds.get("at_least") if bounds.get("at_least") is not None else bounds.get("above")
    found = {"min": low, "max": bounds.get("at_most")}
    return {word: repr(float(value)) for word, value in found.items() if value is not None}


REFUSED_2 = (
    *((f"fmi2{way}{kind}", f"{REAL}, {const}{word}", "n ? wrong(c, MESSAGE) : OK")
      for kind, word in (("Integer", "int *value"), ("Boolean", "int *value"), ("String", "const char **value"))
      for way, const in (("Get", ""), ("Set", "const ")) if (way, kind) not in (("Set", "String"), ("Get", "Integer"))),
    ("fmi2SetString", f"{REAL}, const char *const *value", "n ? wrong(c, MESSAGE) : OK"),
    ("fmi2SetRealInputDerivatives", f"{REAL}, const int *order, const double *value", "wrong(c, MESSAGE)"),
    ("fmi2GetRealOutputDerivatives", f"{REAL}, const int *order, double *value", "wrong(c, MESSAGE)"),
    *((f"fmi2Get{word}Status", f"void *c, int kind, {kind} *value", "DISCARD")
      for word, kind in (("", "Status"), ("Real", "double"), ("Integer", "int"), ("Boolean", "int"), ("String", "const char *"))),
    ("fmi2CancelStep", "void *c", "wrong(c, MESSAGE)"),
    ("fmi2SetDebugLogging", "void *c, int on, size_t n, const char *const *categories", "OK"),
)  # fmt: skip
"""(function, parameters, answer) of what no machine has in FMI 2.0."""


def refused_3() -> list[tuple[str, str, str]]:
    """The same in FMI 3.0."""
    kinds = {"Float32": "float", "Int8": "int8_t", "UInt8": "uint8_t", "Int16": "int16_t", "UInt16": "uint16_t", "UInt32": "uint32_t", "Int64": "int64_t",
             "UInt64": "uint64_t", "Boolean": "bool"}  # fmt: skip
    asked, no = "void *c, const Reference *r, size_t n", "n ? wrong(c, MESSAGE) : OK"
    found = [(f"fmi3Get{word}", f"{asked}, {kind} *value, size_t size", no) for word, kind in kinds.items()]
    found += [(f"fmi3Set{word}", f"{asked}, const {kind} *value, size_t size", no) for word, kind in (kinds | {"Int32": "int32_t"}).items()]
    found += [
        ("fmi3GetString", f"{asked}, const char **value, size_t size", no),
        ("fmi3SetString", f"{asked}, const char *const *value, size_t size", no),
        ("fmi3GetBinary", f"{asked}, size_t *sizes, const uint8_t **value, size_t size", no),
        ("fmi3SetBinary", f"{asked}, const size_t *sizes, const uint8_t *const *value, size_t size", no),
        ("fmi3GetClock", f"{asked}, bool *value", no),
        ("fmi3SetClock", f"{asked}, const bool *value", no),
        ("fmi3GetIntervalDecimal", f"{asked}, double *value, int *qualifier", no),
        ("fmi3SetIntervalDecimal", f"{asked}, const double *value", no),
        ("fmi3GetIntervalFraction", f"{asked}, uint64_t *counters, uint64_t *resolutions, int *qualifier", no),
        ("fmi3SetIntervalFraction", f"{asked}, const uint64_t *counters, const uint64_t *resolutions", no),
        ("fmi3GetShiftDecimal", f"{asked}, double *value", no),
        ("fmi3SetShiftDecimal", f"{asked}, const double *value", no),
        ("fmi3GetShiftFraction", f"{asked}, uint64_t *counters, uint64_t *resolutions", no),
        ("fmi3SetShiftFraction", f"{asked}, const uint64_t *counters, const uint64_t *resolutions", no),
        ("fmi3GetNumberOfVariableDependencies", "void *c, Reference r, size_t *n", "wrong(c, MESSAGE)"),
        ("fmi3GetVariableDependencies", "void *c, Reference r, size_t *elements, Reference *on, size_t *of, int *kinds, size_t n", "wrong(c, MESSAGE)"),
        ("fmi3GetAdjointDerivative", "void *c, const Reference *of, size_t n, const Reference *along, size_t m, const double *seed, size_t seeds, "
         "double *found, size_t size", "wrong(c, MESSAGE)"),
        ("fmi3GetOutputDerivatives", f"{asked}, const int32_t *orders, double *value, size_t size", "wrong(c, MESSAGE)"),
        ("fmi3EnterConfigurationMode", "void *c", "wrong(c, MESSAGE)"),
        ("fmi3ExitConfigurationMode", "void *c", "wrong(c, MESSAGE)"),
        ("fmi3ActivateModelPartition", "void *c, Reference clock, double t", "wrong(c, MESSAGE)"),
        ("fmi3SetDebugLogging", "void *c, bool on, size_t n, const char *const *categories", "OK"),
    ]  # fmt: skip
    return found


# ------------------------------------------------------------------------------------------------------------------------------------ description
def _attributes(unit: Unit) -> tuple[dict[str, str], dict[str, str]]:
    """Attributes of model exchange and of co-simulation."""
    name, both = unit.made.name, "true"
    if unit.version == "2.0":
        common = {
            "modelIdentifier": name,
            "canGetAndSetFMUstate": both,
            "canSerializeFMUstate": both,
            "providesDirectionalDerivative": both,
        }
        return common, common | {"canHandleVariableCommunicationStepSize": both}
    common = {"modelIdentifier": name, "canGetAndSetFMUState": both, "canSerializeFMUState": both, "providesDirectionalDerivatives": both}
    return common | {"needsCompletedIntegratorStep": both}, common | {"canHandleVariableCommunicationStepSize": both, "hasEventMode": both}


def description(unit: Unit, guid: str) -> bytes:
    """modelDescription.xml of a unit."""
    made, two = unit.made, unit.version == "2.0"
    root = ElementTree.Element(
        "fmiModelDescription",
        {
            "fmiVersion": unit.version, "modelName": made.name, "guid" if two else "instantiationToken": guid, "generationTool": "stickslip-toolbox",
            "variableNamingConvention": "flat", "description": made.loop.title,
        },
    )  # fmt: skip
    if two:
        root.set("numberOfEventIndicators", str(len(unit.indicators)))
    exchange, steps = _attributes(unit)
    for word, attributes in ([("ModelExchange", exchange)] if unit.exchanges else []) + [("CoSimulation", steps)]:
        kind = ElementTree.SubElement(root, word, attributes)
        if two:
            ElementTree.SubElement(ElementTree.SubElement(kind, "SourceFiles"), "File", name=f"{made.name}_fmi.c")
    definitions = ElementTree.SubElement(root, "UnitDefinitions")
    for word_ in dict.fromkeys(each.unit for each in unit.variables if each.unit):
        ElementTree.SubElement(definitions, "Unit", name=word_)
    span = made.run.duration
    ElementTree.SubElement(
        root, "DefaultExperiment", startTime="0.0", stopTime=repr(float(span)), tolerance=repr(float(made.run.accuracy)), stepSize=repr(float(span) / 1000.0)
    )  # fmt: skip
    listed = ElementTree.SubElement(root, "ModelVariables")
    index = {each.reference: str(i + 1) for i, each in enumerate(unit.variables)}
    for each in unit.variables:
        _variable(listed, each, two, index)
    _structure(ElementTree.SubElement(root, "ModelStructure"), unit, two, index)
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)


def _variable(listed: ElementTree.Element, each: Variable, two: bool, index: Mapping[int, str]) -> None:
    """One variable."""
    common = {"name": each.name, "valueReference": str(each.reference), "causality": each.causality, **each.role}
    common |= {"description": each.meaning} if each.meaning else {}
    number = dict(each.number) | ({"unit": each.unit} if each.unit else {})
    if two:
        if "derivative" in number:
            number["derivative"] = index[int(number["derivative"])]
        ElementTree.SubElement(ElementTree.SubElement(listed, "ScalarVariable", common), "Integer" if each.whole else "Real", number)
    else:
        ElementTree.SubElement(listed, "Int32" if each.whole else FIELD, common | number)


def _structure(structure: ElementTree.Element, unit: Unit, two: bool, index: Mapping[int, str]) -> None:
    """Outputs, derivatives, what is unknown at the start, and in FMI 3.0 the indicators."""
    outputs = [each for each in unit.variables if each.causality == "output"]
    rates = [each for each in unit.variables if "derivative" in each.number]
    unknown = sorted([each for each in outputs if each.role.get("initial") != "exact"] + rates, key=lambda each: each.reference)
    if two:
        for word, entries in (("Outputs", outputs), ("Derivatives", rates), ("InitialUnknowns", unknown)):
            if entries:
                group = ElementTree.SubElement(structure, word)
                for each in entries:
                    ElementTree.SubElement(group, "Unknown", index=index[each.reference])
        return
    indicators = [each for each in unit.variables if each.name.startswith("indicator.")]
    for word, entries in (
        ("Output", outputs),
        ("ContinuousStateDerivative", rates),
        ("InitialUnknown", unknown),
        ("EventIndicator", indicators),
    ):
        for each in entries:
            ElementTree.SubElement(structure, word, valueReference=str(each.reference))


def build_description(name: str) -> bytes:
    """sources/buildDescription.xml of FMI 3.0."""
    root = ElementTree.Element("fmiBuildDescription", fmiVersion="3.0")
    made = ElementTree.SubElement(root, "BuildConfiguration", modelIdentifier=name)
    files = ElementTree.SubElement(made, "SourceFileSet", language="C99", compilerOptions="-ffp-contract=fast")
    ElementTree.SubElement(files, "SourceFile", name=f"{name}_fmi.c")
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)


def written_unit(loop: ClosedLoop, target: Path, duration: Any, accuracy: float | None, version: str, further: Mapping[str, bytes]) -> Path:
    """Write a machine as an FMU; see `toolbox.export_fmu`."""
    import tempfile
    import uuid

    unit = Unit(machine(loop, target.stem, duration, accuracy), version)
    texts = machine_sources(unit.made, importer=True)
    name = unit.made.name
    guid = f"{{{uuid.uuid5(uuid.NAMESPACE_OID, ''.join(texts.values()) + unit.source('') + re.sub('guid', '', description(unit, '').decode()))}}}"
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        # one source: an importer that compiles all that it finds must not meet the machine twice
        whole = unit.source(guid).replace(f'#include "{name}.c"', texts.pop(f"{name}.c"))
        for file, text in (texts | {f"{name}_fmi.c": whole}).items():
            (folder / file).write_text(text, encoding="utf-8")
        extra = dict(further) | ({"sources/buildDescription.xml": build_description(name)} if version == "3.0" else {})
        flags = ["-std=c99", "-ffp-contract=fast"]
        return fmu_archive(target, folder, [folder / f"{name}_fmi.c"], description(unit, guid), version, flags, extra)
