"""Published drill strings, as ready-made chains.

NAVARRO_LOPEZ_2, NAVARRO_LOPEZ_4: E. M. Navarro-Lopez, D. Cortes, J. Sound Vib. 307 (2007) 152-171 (two inertias; table, pipe, collar, bit).
JANSEN_2: J. D. Jansen, L. van den Steen, J. Sound Vib. 179 (1995) 647-668; the drag c_b = 50 N m s/rad of its bit is taken from the former.
AARSNES_SHOR: U. J. F. Aarsnes, R. J. Shor (2018), inclined well, off bottom, dry friction along the string; F_c = mu sin(inc) rho g A r_o without
buoyancy, mu 0.3 falling to 0.195 at 1.5 rad/s (a jump, see `StepFriction`), drag 0.1 1/s, top drive of 2900 kg m2, drive PI(38e3, 100e3).
UFRJ: pipe and bottom-hole assembly of F. F. Real et al. (2018), 5200 m; their damping 0.35 I + 0.06 k_t is a drag of 0.35 1/s and an internal damping of
0.06 s. They prescribe the top speed; the top drive of 2122 kg m2 is an assumption, that of Jansen and van den Steen.
UFRJ_2: pipe and bottom-hole assembly published at UFRJ, Rio de Janeiro, as one inertia I_pipe/3 + I_BHA on the stiffness G J/L_p of the pipe, with the
damping 0.35 I + 0.06 k_t; with `collar_index=-1` a `WhirlingCollar` acts on its last inertia. They prescribe the top speed; the top drive (2122 kg m2,
425 N m s/rad) is an assumption.

AARSNES_SHOR and UFRJ are lumped from the tables in `models/tables` when first asked for; `DrillString.from_tables` lumps them otherwise. AARSNES_SHOR is
right up to 2 Hz (34 inertias): under the published drive the first motion of its bit, the period of its stick-slip and the largest torque at the top are
within 5 % of those of twice as many elements. At 1 Hz a first wave, which friction swallows in every finer string, moves the bit 1.5 s too early.
UFRJ, without friction along it, is right up to 1 Hz (30 inertias).
"""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

from models.drill_string import TorsionalChain
from models.friction import StepFriction
from toolbox.authoring import suggest

if TYPE_CHECKING:
    from models.tabulated_string import DrillString

    AARSNES_SHOR: DrillString
    UFRJ: DrillString

__all__ = ["AARSNES_SHOR", "JANSEN_2", "NAVARRO_LOPEZ_2", "NAVARRO_LOPEZ_4", "UFRJ", "UFRJ_2"]

JANSEN_2 = TorsionalChain(
    inertia=(2122.0, 374.0),
    stiffness=(473.0,),
    damping=(23.2,),
    top_drag=425.0,
    bit_drag=50.0,
)

NAVARRO_LOPEZ_2 = TorsionalChain(
    inertia=(2122.0, 471.9698),
    stiffness=(861.5336,),
    damping=(172.3067,),
    top_drag=425.0,
    bit_drag=50.0,
)

NAVARRO_LOPEZ_4 = TorsionalChain(
    inertia=(930.0, 2782.25, 750.0, 471.9698),
    stiffness=(698.063, 1080.0, 907.48),
    damping=(139.6126, 190.0, 181.49),
    top_drag=425.0,
    bit_drag=50.0,
)

UFRJ_2 = TorsionalChain(
    inertia=(2122.0, 455.23502),
    stiffness=(324.85663,),
    damping=(178.82366,),
    top_drag=425.0,
)


@cache
def __getattr__(name: str) -> DrillString:
    from importlib.resources import as_file, files  # here, because who asks for another well needs neither

    from models.tabulated_string import DrillString

    if name == "AARSNES_SHOR":
        with as_file(files("models") / "tables") as folder:
            return DrillString.from_tables(
                folder / "aarsnes_shor_sections.csv", folder / "aarsnes_shor_survey.csv", top_inertia=2900.0, drag_rate=0.1, friction=StepFriction(),
            )  # fmt: skip
    if name == "UFRJ":
        with as_file(files("models") / "tables") as folder:
            return DrillString.from_tables(
                folder / "ufrj_sections.csv", top_inertia=2122.0, drag_rate=0.35, internal_damping=0.06, band=1.0
            )
    raise AttributeError(f"There is no well `{name}`: {suggest(name, __all__)}")
