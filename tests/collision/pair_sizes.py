"""Sizes of the shapes that pairs are tested with, as MJCF has them."""

SIZES = {
    "plane": "1 1 1",
    "sphere": "0.11",
    "capsule": "0.07 0.15",
    "ellipsoid": "0.08 0.12 0.17",
    "cylinder": "0.09 0.12",
    "box": "0.08 0.11 0.14",
}
