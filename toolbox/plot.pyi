from toolbox.simulation.plot import *
