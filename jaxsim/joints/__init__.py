"""Joint types: what the coordinates of a joint do to its link."""
