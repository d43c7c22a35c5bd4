"""Fixtures that several test modules share."""

import os
from pathlib import Path

import pytest
from hypothesis import settings

settings.register_profile("are", deadline=None)  # kernels compile inside the first example
settings.load_profile("are")


@pytest.fixture(scope="session")
def real_data() -> Path:
    """Return the folder of real recordings, or skip where it is absent."""
    project = Path(__file__).resolve().parents[1]
    folder = Path(os.environ.get("ARE_REAL_DATA", project.parent / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip("no real recordings: neither ARE_REAL_DATA nor ../shared/data is there")
    return folder
