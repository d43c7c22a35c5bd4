"""Fixtures that several test modules share."""

import os
from pathlib import Path

import pytest
from hypothesis import settings

# Kernels compile inside the first example; the same examples every time, so that CI is stable.
settings.register_profile("are", deadline=None, derandomize=True)
settings.load_profile("are")


@pytest.fixture(scope="session")
def real_data() -> Path:
    """Return the folder of real recordings, or skip where it is absent."""
    project = Path(__file__).resolve().parents[1]
    folder = Path(os.environ.get("ARE_REAL_DATA", project.parent / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip("no real recordings: neither ARE_REAL_DATA nor ../shared/data is there")
    return folder
