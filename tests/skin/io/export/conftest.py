"""A log of a touch that slides, and its states."""

import pytest

import skin
import topology
from bus.logs import write
from tests.fixtures.live import frames_of


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
