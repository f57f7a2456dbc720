"""Videos of states."""

import importlib.util
import pathlib
import warnings
from collections.abc import Sequence

import numpy as np

_NO_IMAGEIO = 'writing a video needs imageio: pip install "imageio[ffmpeg]"'


def write_video(frames: Sequence[np.ndarray], path: str | pathlib.Path, fps: float) -> pathlib.Path:
    """Write frames as mp4, or as gif where imageio has no ffmpeg.

    Args:
      frames: pictures (height, width, 3) of bytes.
      path: file to write, without an ending.
      fps: frames per second.

    Returns:
      The file written.

    Raises:
      RuntimeError: imageio is not installed.
    """
    try:
        import imageio.v3 as imageio
    except ImportError as error:
        raise RuntimeError(_NO_IMAGEIO) from error
    path = pathlib.Path(path)
    if importlib.util.find_spec("imageio_ffmpeg") is None:
        file = path.with_suffix(".gif")
        # Gif counts in hundredths of a second, and players slow down below two of them.
        imageio.imwrite(file, np.stack(frames), duration=max(20, 1000 / fps), loop=0)
        return file
    file = path.with_suffix(".mp4")
    with warnings.catch_warnings():
        # JAX warns of any fork; this one goes on as ffmpeg at once.
        warnings.filterwarnings("ignore", message=r"os\.fork", category=RuntimeWarning)
        imageio.imwrite(file, np.stack(frames), fps=fps, macro_block_size=1)
    return file
