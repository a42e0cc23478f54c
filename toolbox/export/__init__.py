"""Control laws as C and as FMU."""
