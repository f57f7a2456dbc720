"""The directory of a run: locking, writing and reading."""
