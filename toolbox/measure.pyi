from toolbox.measuring.measure import *
