"""Translation of the compiled loops, which are written in a part of Python that is nearly C, into C99 and into the machine code of LLVM."""
