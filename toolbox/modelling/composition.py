"""Parts of a plant, and the plant that has exactly those parts.

A part is a frozen dataclass with an `equations` method. `compose` calls it on a copy whose numeric fields are casadi symbols, connects signals
by name, and returns a `HybridSystem`: symbolic structure that is shared by all plants built from the same kinds of parts, plus one vector
of parameter values. A plant with other numbers therefore costs microseconds and is never compiled again.
"""

from __future__ import annotations

import copy
import copyreg
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from difflib import get_close_matches
from typing import Any

import casadi as ca
import numpy as np

from toolbox.arguments import count_of, refuse
from toolbox.errors import SceneError
from toolbox.modelling.components import (
    Component,
    Equations,
    Slot,
    Update,
    bounds_checked,
    checked,
    equations_of,
    first_word,
    governed,
    law_of,
    numbers_of,
    own_word,
    remembered,
    structure_of,
    symbolic_copy,
    unit_at,
)
from toolbox.modelling.elements import Element, State, time
from toolbox.modelling.friction_groups import grouped
from toolbox.modelling.garbage import uncollected
from toolbox.modelling.hybrid_system import HybridSystem, Input, Parameter, SampledUpdate
from toolbox.modelling.laws import Controller, External, designed, names
from toolbox.modelling.switching import check_rates
from toolbox.modelling.well_posed import check_numbers


def compose(*components: Component) -> HybridSystem:
    """Compose a plant of exactly these parts, connected by the names of their signals.

    A signal that no part computes becomes an input with its default value.

    Parameters
    ----------
    components
        The parts, in any order.

    Returns
    -------
    HybridSystem
        The plant, for `closed_loop`, `simulate`, `linearise` and the other functions.

    Raises
    ------
    SceneError
        If one of these is true; the message names it.

        - No part is given, or a part has a wrong type.
        - A parameter is out of its bounds.
        - Two parts have the same name, a field of a part has the name of a signal of the part, or one signal name has
          different units.
        - A signal without a default is missing.
        - There is an algebraic loop, or an equation contains a NaN.
        - The force of a contact does not act on its slip.

    Examples
    --------
    >>> from models import BitRock, wells
    >>> from toolbox import compose
    >>> print(compose(wells.JANSEN_2, BitRock(weight="97 kN")))
    HybridSystem(TorsionalChain, BitRock): 3 states (chain.twist, chain.speed); contacts: bit; inputs: top.torque [N m], bit.weight [N]
    """
    if not components:
        raise SceneError("A plant needs at least one part, but `compose` got none.")
    for component in components:
        if not isinstance(component, Component):
            kind = type(component).__name__
            found = f"a {kind}"
            if isinstance(component, type):
                found = f"the class {component.__name__}: give one of it, `{component.__name__}()`"
            found = f"a {kind} of them: write `compose(*parts)`" if isinstance(component, (list, tuple)) else found
            raise SceneError(f"Argument `components` must be Component objects, but one is {found}.")
    if any(hasattr(component, "design") for component in components):
        plant = [component for component in components if not hasattr(component, "design")]
        if not plant:
            raise SceneError("A controller needs a plant to act on, but `compose` got controllers only.")
        declared = compose(*plant)
        components = tuple(designed(c, declared) if hasattr(c, "design") else c for c in components)
    return assembled(components)


def assembled(components: tuple[Component, ...]) -> HybridSystem:
    """The system of parts whose controllers have been designed."""
    key = tuple(structure_of(component) for component in components)
    for component in components:
        checked(component)
    shared = _COMPOSED.get(key)
    if shared is None:
        try:
            with uncollected():
                shared = _Composer(components).system()
        except SceneError:
            raise
        except Exception:  # a structure that does not fit its numbers, which `check` has not seen because one of them is out of bounds
            for component in components:
                bounds_checked(component)
            raise
        if len(_COMPOSED) >= 256:
            _COMPOSED.pop(next(iter(list(_COMPOSED)), None), None)
        shared.parameter_check = check_numbers
        _COMPOSED[key] = shared
    system = numbered(shared, components)
    check_numbers(system)
    return system


def numbered(shared: HybridSystem, parts: tuple[Component, ...], known: int = 0, first: int = 0) -> HybridSystem:
    """Return a system of a structure with the numbers of its parts, each within its bounds. The first `known` parts, with the first `first`
    numbers, are left out."""
    system = copy.copy(shared)
    system.parts, system.values = parts, shared.values.copy()
    numbers = [value for part in parts[known:] for value in numbers_of(part)]
    for entry in system.parameters.values():
        at = entry.offset - first
        if 0 <= at < len(numbers):
            entry.check(tuple(numbers[at : at + count_of(entry.size)]))
    system.values[first : first + len(numbers)] = numbers
    return system


_COMPOSED: dict[Any, HybridSystem] = {}

NEEDED = "needed"
"""Where a system keeps the names of all signals that its parts need, in `HybridSystem.cache`."""


class _Composer:
    """Collects the equations of all parts, renames, connects and checks them."""

    def __init__(self, components: Sequence[Component]):
        self.components = components
        self.placeholders: dict[str, tuple[ca.SX, str]] = {}
        self.defaults: dict[str, Any] = {}
        self.needed_by: dict[str, str] = {}
        self.disputed: set[str] = set()
        self.aliases: list[tuple[ca.SX, ca.SX]] = []
        self.parameters: dict[str, Parameter] = {}
        self.symbols: list[ca.SX] = []
        self.values: list[float] = []
        self.states: dict[str, tuple[int, int | None, str]] = {}
        self.x: list[ca.SX] = []
        self.begin: list[np.ndarray] = []
        self.flow: list[ca.SX] = []
        self.given: dict[str, tuple[ca.SX, str]] = {}
        self.elements: list[Element] = []
        self.modeless: dict[str, str] = {}
        self.owners: dict[str, int] = {}
        self.stored: dict[str, ca.SX] = {}
        self.losses: dict[str, ca.SX] = {}
        self.supplies: dict[str, ca.SX] = {}
        self.held: list[ca.SX] = []
        self.updates: list[tuple[Update, int, tuple[str, ...], dict[str, tuple[int, int | None]]]] = []
        self.routes: dict[str, str] = {}
        for component in components:
            for name, target in component.redirected_signals.items():
                if name in self.routes:
                    raise SceneError(f"Two parts stand between control laws and `{name}`: a plant can have one.")
                self.routes[name] = target

    def system(self) -> HybridSystem:
        for i, component in enumerate(self.components):
            self._add(component)
            for name in [*self.states, *(element.name for element in self.elements)]:
                self.owners.setdefault(name, i)
        return self._connected()

    def _add(self, component: Component) -> None:
        law = law_of(component)
        title = type(law).__name__
        slots: list[Slot] = []
        symbolic = symbolic_copy(component, "", slots)
        needs: dict[tuple[str, str], tuple[Any, ca.SX]] = {}

        def signal(name: str, unit: str, default: Any = None) -> ca.SX:
            return needs.setdefault((name, unit), (default, ca.SX.sym(name)))[1]

        equations = equations_of(symbolic, signal, title)
        memory = equations.update.memory if equations.update is not None else equations.flow
        shared: set[str] = set()  # first words of signals of the plant, which keep them
        routes: Mapping[str, str] = {}
        if isinstance(law, (Controller, External)):
            routes, prefix, own = self.routes, own_word(law, memory), first_word(component)
            shared = {name.partition(".")[0] for name in (*names(law.actuated_signals), *names(law.measured_signals))}
        else:
            first = next((variable.label for variable in memory), next(iter(equations.outputs), ""))
            prefix = first.partition(".")[0] or title.lower()
            own = component.name or prefix

        def renamed(name: str) -> str:
            if name in routes:
                return routes[name]
            head, dot, tail = name.partition(".")
            return own + dot + tail if head == prefix and head not in shared else name

        def name_of(variable: State) -> str:
            return remembered(variable.label, prefix, own) if isinstance(law, (Controller, External)) else renamed(variable.label)

        originals = [twin for element in equations.elements for twin in (element, *element.companions)]
        elements = self._add_elements(component, originals, own, renamed)
        self._check_regular(title, equations)
        for slot in slots:
            users = [e for e, original in zip(elements, originals, strict=True) if governed(original.law, slot.owner)]
            path = slot.field_path.removeprefix("law." if component.holds_law or not hasattr(component, "actuated_signals") else "")
            self._add_parameter(f"{own}.{path}", slot, users if slot.owner is not symbolic else [])
        for (name, unit), (default, placeholder) in needs.items():
            self._need(renamed(name), unit, default, placeholder, title)
        for variable, derivative in equations.flow.items():
            self._add_state(name_of(variable), variable, derivative, variable.unit)
        for name, (expression, unit) in equations.outputs.items():
            self._give(renamed(name), ca.SX(expression), unit)
        fields = {f"{own}.{slot.field_path}" for slot in slots}
        for name in map(renamed, [*equations.outputs, *(variable.label for variable in equations.flow)]):
            if name in fields:
                raise SceneError(f"The name `{name}` must stand for one thing, but a field of {title} and a signal that it gives have it.")
        if equations.update is not None:
            self._add_update(equations.update, renamed, name_of)
        if equations.stored is not None:
            self.stored[own] = ca.SX(equations.stored)
        self.losses |= {f"{own}.{name}": ca.SX(power) for name, power in equations.losses.items()}
        self.supplies |= {f"{own}.{name}": ca.SX(power) for name, power in equations.supplies.items()}
        for element in elements:
            self._add_of_element(element)

    def _add_elements(self, component: Component, originals: list[Element], own: str, renamed: Callable[[str], str]) -> list[Element]:
        """Copies of the elements of a component, under their names in the plant."""
        elements = [copy.copy(element) for element in originals]
        taken = {element.name for element in self.elements}
        for element in elements:
            element.name = renamed(element.name)
            if component.name and element.name.partition(".")[0] != own:
                element.name = f"{own}.{element.name}"
            if element.name in self.modeless or element.name in taken:
                raise SceneError(f"Two elements are called `{element.name}`: give one of the parts a `name=`.")
            taken.add(element.name)
            self.modeless |= {element.name: type(element.law).__name__} if element.flow else {}
            self.elements += [] if element.flow else [element]
        return elements

    def _add_of_element(self, element: Element) -> None:
        """What an element says by itself: its signals, the memory of its law, and its powers."""
        for tail, (expression, unit) in element.signals().items():
            if f"{element.name}.{tail}" not in self.given:
                self._give(f"{element.name}.{tail}", expression, unit)
        for variable, derivative in element.flow.items():
            self._add_state(f"{element.name}.{variable.label}", variable, derivative, unit_at(element, variable.unit))
        for target, source in zip((self.losses, self.supplies), element.powers, strict=False):
            target.update({f"{element.name} {name}": power for name, power in source.items()})

    def _add_state(self, name: str, variable: State, derivative: Any, unit: str) -> None:
        """A state and its derivative."""
        derivative = ca.densify(ca.SX(derivative))
        if derivative.shape != variable.shape:
            raise SceneError(f"The derivative of `{name}` must have shape {variable.shape}, but it has {derivative.shape}.")
        if name in self.states:
            raise SceneError(f"Two parts have the state `{name}`: give one of them a `name=`.")
        self.states[name] = (sum(v.numel() for v in self.x), variable.length, unit)
        self.x.append(ca.SX(variable))
        self.begin.append(np.broadcast_to(np.asarray(variable.begin, float), variable.numel()))
        self.flow.append(derivative)
        self._give(name, ca.SX(variable), unit)

    def _add_update(self, update: Update, renamed: Callable[[str], str], name_of: Callable[[State], str]) -> None:
        """What a sampled law holds and remembers between its samples."""
        outputs = {renamed(name): value for name, value in update.outputs.items()}
        places: dict[str, tuple[int, int | None]] = {}
        first_held = sum(symbol.numel() for symbol in self.held)
        for variable in update.memory:
            name = name_of(variable)
            if name in self.given or name in places:
                raise SceneError(f"Two parts have the state `{name}`: give one of them a `name=`.")
            places[name] = (sum(count_of(size) for _, size in places.values()), variable.length)
        for name, (_, unit) in outputs.items():
            self.held.append(ca.SX.sym(name))
            self._give(name, self.held[-1], unit)
        for variable, name in zip(update.memory, places, strict=True):
            self.held.append(ca.SX.sym(name, variable.numel()))
            self._give(name, self.held[-1], variable.unit)
        self.updates.append((update, first_held, tuple(outputs), places))

    def _check_regular(self, title: str, equations: Equations) -> None:
        expressions = [*equations.flow.values(), *(e for e, _ in equations.outputs.values())]
        for element in equations.elements:
            expressions += [*element.flow.values(), *(power for powers in element.powers for power in powers.values())]
            expressions += [getattr(element, name) for name in element.expression_fields]
        expressions += [*equations.losses.values(), *equations.supplies.values(), 0 if equations.stored is None else equations.stored]
        if equations.update is not None:
            expressions += [*equations.update.memory.values(), *(e for e, _ in equations.update.outputs.values())]
        together = ca.vertcat(*[ca.vec(ca.SX(expression)) for expression in expressions])
        function = ca.Function("scan", ca.symvar(together), [together], {"max_io": 10**9})
        for k in range(function.n_instructions()):
            if function.instruction_id(k) == ca.OP_CONST and math.isnan(function.instruction_constant(k)):
                raise SceneError(f"The equations of {title} contain a NaN constant: use casadi functions inside `equations`, not `math`.")

    def _add_parameter(self, path: str, slot: Slot, users: Sequence[Element]) -> None:
        """A number of a part, or of a friction law that these elements use."""
        unit = slot.spec.metadata.get("unit", "1")
        if len(users) == 1:
            path = f"{users[0].name}.{slot.field_path}"
        if users:
            unit = unit_at(users[0], unit)
        if path in self.parameters:
            raise SceneError(f"Two parts have the parameter `{path}`: give one of them a `name=`.")
        metadata = slot.spec.metadata
        self.parameters[path] = Parameter(path, unit, metadata.get("meaning", ""), slot.size, len(self.values), metadata)
        self.symbols.append(slot.symbol)
        self.values.extend([math.nan] * slot.symbol.numel())

    def _give(self, name: str, expression: ca.SX, unit: str) -> None:
        if name in self.given:
            raise SceneError(f"Two parts give the signal `{name}`.")
        self.given[name] = (expression, unit)

    def _need(self, name: str, unit: str, default: Any, placeholder: ca.SX, title: str) -> None:
        if name not in self.placeholders:
            self.placeholders[name] = (placeholder, unit)
            self.defaults[name] = default
            self.needed_by[name] = title
            return
        first, known_unit = self.placeholders[name]
        if known_unit != unit:
            raise SceneError(f"Signal `{name}` is needed in {known_unit} and, by {title}, in {unit}: units must agree.")
        self.aliases.append((placeholder, first))
        if self.defaults[name] is None:
            self.defaults[name] = default
        elif default is not None and not ca.is_equal(ca.SX(default), ca.SX(self.defaults[name]), 10):
            self.disputed.add(name)

    def _connected(self) -> HybridSystem:
        """The system of all parts, checked."""
        inputs = self._inputs()
        bundle = self._linked(self._bundle())
        if not self.x:
            raise SceneError("A plant needs at least one state, but these parts have none.")
        system = HybridSystem()
        system.t, system.x, system.p, system.held = time, _column(self.x), _column(self.symbols), _column(self.held)
        system.u = _column([entry.symbol for entry in inputs.values()])
        system.flow = ca.vertcat(*[bundle[f"flow:{i}"] for i in range(len(self.flow))])
        system.states, system.begin = self.states, np.concatenate(self.begin)
        for i, element in enumerate(self.elements):
            for name in element.expression_fields:
                setattr(element, name, bundle[f"{name}:{i}"])
        bundle = self._grouped(system, bundle)
        system.F, system.m = _column([e.multiplier for e in self.elements]), _column([e.mode for e in self.elements])
        system.signals = {name: (bundle[f"given:{name}"], unit) for name, (_, unit) in self.given.items()}
        for kind in ("stored", "losses", "supplies"):
            setattr(system, kind, {name: bundle[f"{kind}:{name}"] for name in getattr(self, kind)})
        system.updates = tuple(
            SampledUpdate(
                _column(update.memory), bundle[f"memory:{i}"], bundle[f"output:{i}"], names, places, first, update.from_callable,
                _column(update.noise.values()), tuple(update.noise),
            )
            for i, (update, first, names, places) in enumerate(self.updates)
        )  # fmt: skip
        system.inputs, system.parameters, system.redirected_signals, system.owners = inputs, self.parameters, self.routes, self.owners
        system.elements, system.modeless = tuple(self.elements), self.modeless
        system.values, system.cache, system.parts = np.array(self.values, float), {NEEDED: frozenset(self.placeholders)}, ()
        self._check(system, bundle)
        return system

    def _grouped(self, system: HybridSystem, bundle: dict[str, ca.SX]) -> dict[str, ca.SX]:
        """The expressions with one friction in place of all on one slip, which the elements and the flow of the system then have, too."""
        groups = grouped(time, system.x, system.flow, self.elements)
        if groups is None:
            return bundle
        self.elements, system.flow, system.shared_modes = groups.elements, groups.flow, groups.leaders
        return _substituted(bundle, groups.old, groups.new)

    def _inputs(self) -> dict[str, Input]:
        """The signals that nobody gives, with their defaults; one entry of a vector state is given where it is needed."""
        inputs: dict[str, Input] = {}
        for name, (placeholder, unit) in self.placeholders.items():
            head, _, tail = name.rpartition(".")
            if name not in self.given and head in self.states and tail.isdigit() and int(tail) < (self.states[head][1] or 0):
                self.given[name] = (self.given[head][0][int(tail)], self.given[head][1])
            if name not in self.given:
                inputs[name] = Input(name, placeholder, unit, self._default(name, unit))
            elif self.given[name][1] != unit:
                raise SceneError(f"Signal `{name}` is given in {self.given[name][1]} but needed in {unit}: units must agree.")
        return inputs

    def _default(self, name: str, unit: str) -> ca.SX:
        """The default of an input as an expression of parameters: a number becomes one of them."""
        default = self.defaults[name]
        if name in self.disputed:
            raise SceneError(
                f"Two parts have defaults of their own for the signal `{name}`: compose a part that gives it, or let only one of them have a default."
            )
        if default is None:
            near = get_close_matches(name, self.given, n=1, cutoff=0.85)
            remedy = f"did you mean `{near[0]}`?" if near else f"add a part that gives `{name}` (`stickslip list` shows all parts)."
            raise SceneError(f"{self.needed_by[name]} needs the signal `{name}` [{unit}], but no part gives it: {remedy}")
        if isinstance(default, ca.SX):
            if not all(ca.depends_on(ca.vertcat(*self.symbols), s) for s in ca.symvar(default)):
                raise SceneError(f"The default of `{name}` must be a number or an expression of parameters, but it is {default}.")
            return default
        refuse(f"The default of `{name}`", default, unit, {})
        if name in self.parameters:
            raise SceneError(f"The default of `{name}` and its parameter are different things: use the parameter as default.")
        symbol = ca.SX.sym(name)
        self.parameters[name] = Parameter(name, unit, "value where nothing else gives it", None, len(self.values), {})
        self.symbols.append(symbol)
        self.values.append(float(default))
        return symbol

    def _bundle(self) -> dict[str, ca.SX]:
        """{kind:name: expression} of all that parts say, with placeholders for the signals that they need."""
        bundle: dict[str, ca.SX] = {f"given:{k}": v for k, (v, _) in self.given.items()}
        bundle |= {f"flow:{i}": v for i, v in enumerate(self.flow)}
        for kind in ("stored", "losses", "supplies"):
            bundle |= {f"{kind}:{k}": v for k, v in getattr(self, kind).items()}
        for i, element in enumerate(self.elements):
            bundle |= {f"{name}:{i}": getattr(element, name) for name in element.expression_fields}
        for i, (update, _, _, _) in enumerate(self.updates):
            bundle[f"memory:{i}"] = ca.densify(_column(map(ca.SX, update.memory.values())))
            bundle[f"output:{i}"] = ca.densify(ca.vertcat(*[ca.SX(value) for value, _ in update.outputs.values()], *update.memory))
        return bundle

    def _linked(self, bundle: dict[str, ca.SX]) -> dict[str, ca.SX]:
        """The same expressions with what parts give in place of what others need."""
        links = {name: placeholder for name, (placeholder, _) in self.placeholders.items() if name in self.given}
        if self.aliases:  # a signal that several parts need has several placeholders: all become the first one
            bundle = _substituted(bundle, [a for a, _ in self.aliases], [b for _, b in self.aliases])
        for name in _topological({name: bundle[f"given:{name}"] for name in links}, links):
            bundle = _substituted(bundle, [links[name]], [bundle[f"given:{name}"]])
        return bundle

    def _check(self, system: HybridSystem, bundle: dict[str, ca.SX]) -> None:
        """Raise SceneError for symbols that nobody declared, what must not depend on something else, and elements that are not well posed."""
        of_laws = [symbol for update in system.updates for symbol in (update.memory, update.noise)]
        others = ca.vertcat(system.p, system.u, system.F, system.m, system.held)
        known = ca.vertcat(time, system.x, others, *of_laws, *[element.speed for element in self.elements])
        strangers = ca.Function("scan", [known], [ca.vertcat(*bundle.values())], {"allow_free": True}).get_free()
        if strangers:
            unlisted = sorted({name.rpartition(".")[0] for name in strangers if name.endswith((".multiplier", ".mode"))})
            remedy = f"element `{unlisted[0]}` must be in `elements`" if unlisted else "a state must be a key of `flow`"
            raise SceneError(f"The equations use symbols that nobody declared: {', '.join(strangers)}; {remedy}.")
        rigid = [e.multiplier for e in self.elements if e.rigid]
        for name in (n for n in self.modeless if any(ca.depends_on(bundle[f"given:{n}.force"], push) for push in rigid)):
            raise SceneError(f"The load of `{name}` must not come from a rigid contact, as its law has a memory: make that elastic.")
        slips = ca.vertcat(*[e.slip for e in self.elements], *[e.closure for e in self.elements if e.rigid or e.has_gap])
        if ca.depends_on(slips, system.held):
            raise SceneError("A slip must not depend on a signal held by a sampled law: it would jump at every sample.")
        _ = system.switched_equations  # raises where the elements are not well posed
        check_rates(time, system.x, others, system.flow, system.elements)


def _column(entries: Iterable[Any]) -> ca.SX:
    """Expressions one below the other, shape (0, 1) without any."""
    return ca.vertcat(ca.SX(0, 1), *entries)


def _substituted(bundle: dict[str, ca.SX], old: list[ca.SX], new: list[ca.SX]) -> dict[str, ca.SX]:
    return dict(zip(bundle, ca.substitute(list(bundle.values()), old, new), strict=True))


def _topological(expressions: dict[str, ca.SX], links: dict[str, ca.SX]) -> list[str]:
    """Names ordered so that substituting one after the other leaves no placeholder; raises SceneError on an algebraic loop."""
    depends = {n: {o for o, s in links.items() if ca.depends_on(e, s)} for n, e in expressions.items()}
    order: list[str] = []
    left = set(expressions)
    while left:
        # a name whose placeholder no other remaining expression would bring back goes last
        free = sorted(n for n in left if not any(n in depends[o] for o in left))
        if not free:
            raise SceneError(f"The signals {', '.join(f'`{n}`' for n in sorted(left))} form an algebraic loop.")
        order.extend(free)
        left -= set(free)
    return order


def _composed_again(parts: tuple[Component, ...], values: np.ndarray) -> HybridSystem:
    """A plant from the parts and values as which it travels."""
    system = assembled(parts)
    system.values = values
    return system


# here and not in the class, which does not know how it is composed
copyreg.pickle(HybridSystem, lambda system: (_composed_again, (system.parts, system.values)))
