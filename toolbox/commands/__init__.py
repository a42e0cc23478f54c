"""The commands of `stickslip`, one per file: `add` declares its arguments, `run` does it and returns the exit code."""
