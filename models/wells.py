"""Published drill strings, as ready-made chains.

NAVARRO_LOPEZ_2, NAVARRO_LOPEZ_4: E. M. Navarro-Lopez, D. Cortes, J. Sound Vib. 307 (2007) 152-171 (two inertias; table, pipe, collar, bit).
JANSEN_2: J. D. Jansen, L. van den Steen, J. Sound Vib. 179 (1995) 647-668; the drag c_b = 50 N m s/rad of its bit is taken from the former.
UFRJ_2: pipe and bottom-hole assembly published at UFRJ, Rio de Janeiro, as one inertia I_pipe/3 + I_BHA on the stiffness G J/L_p of the pipe, with the
damping 0.35 I + 0.06 k_t; with `collar=-1` a `WhirlingCollar` acts on its last inertia. They prescribe the top speed; the top drive (2122 kg m2,
425 N m s/rad) is an assumption.
"""

from __future__ import annotations

from models.drill_string import TorsionalChain

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
