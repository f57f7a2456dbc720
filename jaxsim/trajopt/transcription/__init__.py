"""Problems in which states are unknowns, too: constraints along a path, and banded equations."""
