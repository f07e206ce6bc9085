from __future__ import annotations

import dataclasses

import pytest
from PIL import Image

from mrta_falsify.core.errors import ConfigError
from reports import animation
from reports.contents import RunView


def test_a_gif_shows_the_run_ten_times_faster(hall, hall_trace, tmp_path):
    animation.write_gif(RunView(world=hall, trace=hall_trace), tmp_path / "run.gif")
    with Image.open(tmp_path / "run.gif") as image:
        assert image.n_frames == 13  # 10 s, a frame every 17 ticks, and the last tick
        assert image.info["loop"] == 0


def test_an_mp4_is_a_video_file(hall, hall_trace, tmp_path):
    pytest.importorskip("imageio_ffmpeg")
    animation.write_mp4(RunView(world=hall, trace=hall_trace), tmp_path / "run.mp4")
    content = (tmp_path / "run.mp4").read_bytes()
    assert content[4:8] == b"ftyp"
    assert len(content) > 5_000


def test_a_run_without_a_kept_trace_cannot_be_animated(hall, hall_trace, tmp_path):
    bare = dataclasses.replace(hall_trace, columns={})
    with pytest.raises(ConfigError, match="needs the trace"):
        animation.write_gif(RunView(world=hall, trace=bare), tmp_path / "run.gif")


def test_mp4_without_its_extra_says_what_to_install(hall, hall_trace, tmp_path, monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(ConfigError, match=r"pip install 'mrta-falsify\[video\]'"):
        animation.write_mp4(RunView(world=hall, trace=hall_trace), tmp_path / "run.mp4")
