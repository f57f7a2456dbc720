"""What is not physics and not ours alone: indices, sums, kinds, series, norms, precision."""
