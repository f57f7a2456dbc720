"""Files of moving pictures."""

import importlib.util
import pathlib
import warnings
from collections.abc import Iterable

import numpy as np

_NO_IMAGEIO = 'writing a video needs imageio: pip install "imageio[ffmpeg]"'


def write_video(frames: Iterable[np.ndarray], path: str | pathlib.Path, fps: float) -> pathlib.Path:
    """Write frames, one at a time, as MP4 or GIF.

    Args:
      frames: pictures (height, width, 3) of bytes.
      path: file to write; without an ending, `.mp4`, or `.gif` where imageio has no ffmpeg.
      fps: frames per second.

    Returns:
      The file written.

    Raises:
      ValueError: the ending is another one.
      RuntimeError: imageio is not installed, or not with ffmpeg.
    """
    path, has_ffmpeg = pathlib.Path(path), importlib.util.find_spec("imageio_ffmpeg") is not None
    if not path.suffix:
        path = path.with_suffix(".mp4" if has_ffmpeg else ".gif")
    if path.suffix not in _WRITERS:
        raise ValueError(f"a film is a .mp4 or a .gif, got {path.name!r}")
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        _WRITERS[path.suffix](frames, path, fps)
    except ImportError as error:
        raise RuntimeError(_NO_IMAGEIO) from error
    return path


def _write_mp4(frames: Iterable[np.ndarray], path: pathlib.Path, fps: float) -> None:
    import imageio.v2 as imageio
    import imageio_ffmpeg  # noqa: F401  imageio would say something longer

    with warnings.catch_warnings():
        # JAX warns of any fork; this one goes on as ffmpeg at once.
        warnings.filterwarnings("ignore", message=r"os\.fork", category=RuntimeWarning)
        with imageio.get_writer(path, fps=fps, macro_block_size=2) as writer:
            for frame in frames:
                writer.append_data(frame)


def _write_gif(frames: Iterable[np.ndarray], path: pathlib.Path, fps: float) -> None:
    """One palette for all frames: what does not move then costs nothing."""
    from PIL import Image

    pictures = [Image.fromarray(frame) for frame in frames]
    sample = np.concatenate([np.asarray(p) for p in pictures[:: max(1, len(pictures) // 6)]])
    palette = Image.fromarray(sample).quantize(128)
    flat = [p.quantize(palette=palette, dither=Image.Dither.NONE) for p in pictures]
    # Gif counts in hundredths of a second, and players slow down below two of them.
    duration = max(20, round(1000 / fps))
    flat[0].save(path, save_all=True, append_images=flat[1:], duration=duration, loop=0)


_WRITERS = {".mp4": _write_mp4, ".gif": _write_gif}
