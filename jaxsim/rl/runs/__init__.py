"""The directory of a run: who holds it, what is in it, and reading it again."""
