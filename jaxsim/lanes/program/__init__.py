"""The language of one lane: scalar operations, and what simplifies them."""
