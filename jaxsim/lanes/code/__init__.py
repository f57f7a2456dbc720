"""From scalar operations to machine code: their order, text of LLVM, and the way XLA calls it."""
