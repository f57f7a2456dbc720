"""Array helpers without physics: indexing, sums by group, safe norms, series, precision."""
