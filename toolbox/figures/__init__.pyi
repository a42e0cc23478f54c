from .films import film as film
from .spectrograms import spectrogram as spectrogram
