"""Learning curves and videos."""

import sys

import imageio.v3 as imageio
import numpy as np
import pytest

from jaxsim.viz.plots.learning import plot_learning
from jaxsim.viz.video import write_video

ROWS = [
    {"steps": 10, "seconds": 1.0, "episode_return": float("nan")},
    {"steps": 20, "seconds": 2.0, "episode_return": 3.0, "eval_return": 4.0},
]


def test_picture_is_written(tmp_path):
    plot_learning({"a": ROWS, "empty": []}, tmp_path / "curve.png", "title", goal=5)
    picture = imageio.imread(tmp_path / "curve.png")
    assert picture.shape[0] > 300
    assert picture[..., :3].std() > 0


def test_video_has_the_frames(tmp_path):
    frames = [np.full((32, 48, 3), i * 20, np.uint8) for i in range(5)]
    path = write_video(frames, tmp_path / "episode", fps=25)
    assert path.suffix in (".mp4", ".gif")
    if path.suffix == ".gif":
        assert imageio.imread(path, index=None).shape[:3] == (5, 32, 48)
    else:  # imageio's reader of mp4 leaves its pipes open
        ffmpeg = pytest.importorskip("imageio_ffmpeg")
        assert ffmpeg.count_frames_and_secs(str(path))[0] == 5


@pytest.mark.parametrize(
    ("module", "draw"),
    [
        ("matplotlib.figure", lambda path: plot_learning({}, path)),
        ("imageio", lambda path: write_video([], path.with_suffix(".mp4"), 1)),
    ],
)
def test_missing_extra_is_named(module, draw, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, module, None)
    package = module.partition(".")[0]
    with pytest.raises(RuntimeError, match=f'pip install "?{package}'):
        draw(tmp_path / "x.png")
