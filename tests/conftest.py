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


_SLOW = {
    *("test_bench", "test_browser", "test_cli", "test_compiled", "test_defaults"),
    *("test_docs", "test_feasibility", "test_figures", "test_generate"),
    *("test_identification", "test_live", "test_log_commands", "test_mcap_file"),
    *("test_monte_carlo", "test_mujoco_link", "test_observed", "test_paper_robot"),
    *("test_plot", "test_posture", "test_public_api", "test_scene_data"),
    *("test_render", "test_report", "test_robot_command", "test_sampled_bounds"),
    *("test_site", "test_speed", "test_sway", "test_tick", "test_trials"),
    *("test_uncompiled", "test_view_command", "test_walk", "test_columns"),
}
"""Files whose tests walk whole robots, start processes or compile anew."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the slow tests, which `-m "not slow"` leaves out."""
    for item in items:
        if item.path.stem in _SLOW:
            item.add_marker(pytest.mark.slow)
