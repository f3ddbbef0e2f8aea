"""What every test of bad input shares: the marker, and an end to what would never end or eat the whole memory."""

import pytest

from .limits import bounded


def pytest_configure(config):
    config.addinivalue_line("markers", "robust: bad input, full disks, long runs and many resets")


@pytest.fixture
def guard():
    """Run a block with bounded time and memory: `with guard(): ...`."""
    return bounded
