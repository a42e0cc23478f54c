"""The looks and the curves that all pictures share, spectrograms and films."""

from typing import TYPE_CHECKING

from toolbox.faces import face

if TYPE_CHECKING:
    from toolbox.figures.films import film as film
    from toolbox.figures.spectrograms import spectrogram as spectrogram

__getattr__, __dir__ = face()
