"""The version of the toolbox that is installed."""

from importlib.metadata import PackageNotFoundError, version

try:
    __version__ = version("stickslip-toolbox")
except PackageNotFoundError:
    __version__ = "(not installed)"
