"""Shape against shape: one function per pair, one file per family."""
