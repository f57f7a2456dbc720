"""MJCF files that come with other packages: models that were not written for this one."""

import importlib.util
import pathlib

FOLDERS = {
    "gymnasium": "envs/mujoco/assets",
    "mujoco.mjx": "test_data",
    "brax": "envs/assets",
}

# Why some models cannot be loaded: parts of the messages.
UNSUPPORTED = (
    "armature is not supported",
    "mass matrix is singular",
    "type 'camprojection' is not supported",
    "may collide",
)


def asset_files() -> dict[str, pathlib.Path]:
    """Paths of all files by a short name; packages that are not installed have none."""
    files = {}
    for package, folder in FOLDERS.items():
        for root in _locations(package):
            for path in sorted((root / folder).rglob("*.xml")):
                files[f"{package}:{path.relative_to(root / folder)}"] = path
    return files


def _locations(package: str) -> list[pathlib.Path]:
    spec = importlib.util.find_spec(package)
    return [pathlib.Path(p) for p in (spec.submodule_search_locations if spec else ())]
