"""The lists of marked tests name tests that exist."""

import re
from pathlib import Path

import pytest

HERE = Path(__file__).parents[1]


@pytest.mark.parametrize("mark", ["long", "smoke"])
def test_every_line_names_a_test(mark):
    lines = (HERE / f"{mark}.txt").read_text(encoding="utf-8").splitlines()
    listed = [line for line in lines if line and not line.startswith("#")]
    assert listed and listed == sorted(set(listed))
    for line in listed:
        file, function = re.fullmatch(r"tests/(\w+/test_\w+\.py)::(test_\w+)(?:\[.*\])?", line).groups()
        assert f"def {function}(" in (HERE / file).read_text(encoding="utf-8"), line
