import pytest

from swarm_mj.observation.gl_context import gl_available


@pytest.fixture(autouse=True)
def _skip_without_gl(request):
    if request.node.get_closest_marker("gl"):
        available, reason = gl_available()
        if not available:
            pytest.skip(reason)
