"""Checksums of the files in a folder."""

import json
import pathlib
import zlib

_NAME = "files.json"


def write(folder: pathlib.Path) -> None:
    """Write the checksums of all files into the folder."""
    text = json.dumps({name: _checksum(folder / name) for name in _files(folder)})
    (folder / _NAME).write_text(text, "utf-8")


def check(folder: pathlib.Path) -> None:
    """Compare the files with their checksums; a folder without checksums (after a crash) passes.

    Raises:
      ValueError: a file is missing or has changed.
    """
    if not (folder / _NAME).exists():
        return
    try:
        known = dict(json.loads((folder / _NAME).read_text("utf-8")))
    except (ValueError, TypeError) as error:
        raise ValueError(f"its file {_NAME} is damaged") from error
    for name, checksum in known.items():
        if not (folder / name).is_file() or _checksum(folder / name) != checksum:
            raise ValueError(f"its file {name} is damaged")


def _files(folder: pathlib.Path) -> list[str]:
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())


def _checksum(path: pathlib.Path) -> int:
    total = 0
    with path.open("rb") as file:
        while block := file.read(1 << 20):
            total = zlib.crc32(block, total)
    return total
