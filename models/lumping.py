"""From sections to a chain: which elements, and what of the string each inertia takes.

An element is a stretch of string, perhaps of several sections, with compliance C = int dx / (G J) and inertia I = int rho J dx. It becomes one spring of
stiffness 1 / C, and every bit of its inertia (drag, friction) goes to its two ends as its place divides the compliance: with C' above it, the part
C' / C goes to the lower end. Total inertia and total compliance are then those of the string, and its twist under constant torques is exact at the nodes.

Rule: every element has sqrt(C I) <= PHASE / (2 pi band), which in a uniform string is its travel time h / c: 18 elements to the wave at the edge of the band.
The natural frequencies of a uniform shaft come out too low by (w h / c)^2 / 24, half a per cent at that edge; of any string tried, by less than twice that.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from models.sections import Section
from toolbox import SceneError
from toolbox.authoring import halved

PHASE = 0.35
"""Largest phase 2 pi band sqrt(C I) [rad] of an element: natural frequencies within the band are then right within one per cent."""

MOST = 10_000
"""Largest number of elements."""


class Lumping:
    """Elements of a string: `nodes` are the measured depths [m] of their ends, `stiffness` [N m/rad] has one entry less."""

    def __init__(self, sections: Sequence[Section], nodes: Sequence[float]):
        self.sections = tuple(sections)
        self.nodes = np.asarray(nodes, float)
        self.ends = np.cumsum([0.0, *(section.length for section in sections)])
        self._compliance = np.cumsum([0.0, *(section.length / section.torsional_rigidity for section in sections)])
        self._at_nodes = self.compliance(self.nodes)
        self.stiffness = 1 / np.diff(self._at_nodes)

    @staticmethod
    def of_band(sections: Sequence[Section], band: float) -> Lumping:
        """As few elements as the rule allows for frequencies up to `band` [Hz], all of about the same sqrt(C I)."""
        elements = len(_marched(sections, (PHASE / (2 * math.pi * band)) ** 2, MOST))
        if elements > MOST:
            raise SceneError(f"Argument `band` must be lower, because {band:g} Hz needs more than {MOST} elements.")
        return Lumping.of_count(sections, elements)

    @staticmethod
    def of_count(sections: Sequence[Section], elements: int) -> Lumping:
        """So many elements, all of the same C I."""
        compliance = sum(section.length / section.torsional_rigidity for section in sections)
        whole = compliance * sum(section.length * section.inertia_per_length for section in sections) * (1 + 1e-9)
        # the smallest C I with which so many elements reach the end, and no round-off is left over
        _, high = halved(lambda product: len(_marched(sections, product, elements)) <= elements, 0.0, whole, 1e-12)
        nodes = _marched(sections, high, elements)
        return Lumping(sections, [*nodes, sum(section.length for section in sections)])

    def compliance(self, s: np.ndarray) -> np.ndarray:
        """Compliance [rad/(N m)] of the string above measured depths s."""
        return np.interp(s, self.ends, self._compliance)

    def along(self, values: Sequence[float], s: np.ndarray) -> np.ndarray:
        """At measured depths s, the value of the section there."""
        return np.asarray(values)[np.clip(np.searchsorted(self.ends, s) - 1, 0, len(self.sections) - 1)]

    def shared(self, density: Callable[[np.ndarray], np.ndarray], breaks: Sequence[float] = ()) -> np.ndarray:
        """Return the share of every node of a quantity with the given density per length. The density is a function of depth, smooth
        between sections and `breaks`."""
        edges = np.unique(np.clip([*self.nodes, *self.ends, *breaks], 0.0, self.ends[-1]))
        points, weights = np.polynomial.legendre.leggauss(8)
        half, middle = np.diff(edges) / 2, (edges[:-1] + edges[1:]) / 2
        s = middle[:, None] + half[:, None] * points
        element = np.clip(np.searchsorted(self.nodes, middle) - 1, 0, len(self.nodes) - 2)
        amount = density(s.ravel()).reshape(s.shape) * half[:, None] * weights
        lower = (self.compliance(s) - self._at_nodes[element, None]) * self.stiffness[element, None]
        taken = np.zeros(len(self.nodes))
        np.add.at(taken, element, (amount * (1 - lower)).sum(axis=1))
        np.add.at(taken, element + 1, (amount * lower).sum(axis=1))
        return taken


def _marched(sections: Sequence[Section], product: float, most: int) -> list[float]:
    """Upper ends of the longest elements with C I <= product, from the top; no more than one beyond `most`."""
    nodes, depth = [0.0], 0.0
    compliance = inertia = 0.0
    for section in sections:
        by_compliance, left = 1 / section.torsional_rigidity, section.length
        while len(nodes) <= most:
            # (C + d / GJ) (I + d rho J) = product
            square, linear = by_compliance * section.inertia_per_length, compliance * section.inertia_per_length + inertia * by_compliance
            missing = max(product - compliance * inertia, 0.0)
            d = 2 * missing / (linear + math.sqrt(linear**2 + 4 * square * missing))
            if d >= left:
                break
            depth, left = depth + d, left - d
            nodes.append(depth)
            compliance = inertia = 0.0
        compliance, inertia, depth = compliance + left * by_compliance, inertia + left * section.inertia_per_length, depth + left
    return nodes
