from toolbox.modelling.inputs import *
