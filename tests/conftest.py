"""Settings shared by all tests: property tests repeat exactly."""

import gc
import warnings
from collections.abc import Iterator

import pytest
from hypothesis import settings

settings.register_profile("repeatable", deadline=None, derandomize=True)
settings.load_profile("repeatable")

_SERVING = {"test_browser", "test_live", "test_view_command"}


@pytest.fixture(autouse=True, scope="module")
def no_socket_left(request: pytest.FixtureRequest) -> Iterator[None]:
    """Collect what viser leaves of closed pages here, not in a test of something else.

    It stops its event loop without closing the transports of browsers that went away.
    """
    yield
    if request.module.__name__ in _SERVING:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ResourceWarning)
            gc.collect()
