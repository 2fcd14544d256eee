import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))


@pytest.fixture(scope="session")
def dataset():
    """Folder of the demo's data set, which only the repository has."""
    folder = Path(__file__).parents[3] / "cli" / "data" / "demo"
    if not folder.is_dir():
        pytest.skip("the data set of the demo is not here")
    return folder
