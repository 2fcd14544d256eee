"""Examples of the README that need no files run as they are."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

TEXT = Path(__file__).parent.parent.joinpath("README.md").read_text(encoding="utf-8")
BLOCKS = [block for block in re.findall(r"```python\n(.*?)```", TEXT, re.S) if block.startswith("import")]


@pytest.mark.parametrize("block", BLOCKS, ids=range(len(BLOCKS)))
def test_block(block):
    exec(compile(block, "README.md", "exec"), {})


def test_blocks_were_found():
    assert len(BLOCKS) == 3
