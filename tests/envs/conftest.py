"""What several tests of the environments need."""

import pytest

from swarm_mj.observation.gl_context import gl_available


@pytest.fixture(scope="session")
def gl():
    """Skip where there is no OpenGL."""
    available, reason = gl_available()
    if not available:
        pytest.skip(reason)
