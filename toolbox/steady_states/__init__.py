"""Steady states, linearisation, poles, Hopf points, impedance."""
