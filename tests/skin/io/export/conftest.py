"""A log of a touch that slides, its states, and frames of a camera."""

from __future__ import annotations

import io

import numpy as np
import pytest

import skin
import topology
from skin.options import Options
from skin.pipeline import Pipeline
from tests.fixtures.live import frames_of
from tests.fixtures.logs import write


@pytest.fixture(scope="package")
def palm():
    return topology.load("palm")


@pytest.fixture(scope="package")
def log(tmp_path_factory):
    file = tmp_path_factory.mktemp("log") / "palm.log"
    write(file, frames_of("palm", "slide", 400))
    return file


@pytest.fixture(scope="package")
def states(palm, log):
    return [state.copy() for state in skin.decode_log(palm, log)]


@pytest.fixture(scope="package")
def pipeline(palm):
    """A pipeline for lists of states, whose counts are 0."""
    return Pipeline(palm, Options())


@pytest.fixture(scope="package")
def image_file():
    """A function: the file of an image of noise, which does not pack well."""
    library = pytest.importorskip("PIL.Image", reason="Pillow is not installed")
    rgb = np.random.default_rng(7).integers(0, 255, (40, 50, 3), np.uint8)

    def file_of(mode="RGB", kind="PNG"):
        out = io.BytesIO()
        library.fromarray(rgb).convert(mode).save(out, format=kind)
        return out.getvalue()

    return file_of


@pytest.fixture
def camera_folder(image_file, tmp_path):
    """A function: a folder of images at these stamps."""

    def folder_of(stamps, name="frames"):
        (folder := tmp_path / name).mkdir()
        for stamp_ns in stamps:
            (folder / f"{stamp_ns}.png").write_bytes(image_file())
        return folder

    return folder_of
