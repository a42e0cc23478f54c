"""Arguments of tests that hold a plant with its law in the short form of `simulate`, as a closed loop and the rest."""

from toolbox import closed_loop

WORDS = ("sample_time", "inputs", "parameters", "start", "element", "signal")


def together(plant, controller=None, **arguments):
    """(the closed loop, the arguments that do not belong to it)."""
    own = {word: arguments.pop(word) for word in WORDS if word in arguments}
    return closed_loop(plant, controller, **own), arguments
