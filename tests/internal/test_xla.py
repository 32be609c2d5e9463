"""Tests of the XLA flag without which some programs never return."""

import subprocess
import sys

import pytest

import pdjax as pd

PROBE = """
import os
{before}
import pdjax
print(os.environ["XLA_FLAGS"])
"""


TWO = "--xla_force_host_platform_device_count=2"


@pytest.mark.parametrize(
    "before, flags",
    [
        ("os.environ.pop('XLA_FLAGS', None)", "{flag}=false"),
        (f"os.environ['XLA_FLAGS'] = '{TWO}'", f"{TWO} {{flag}}=false"),
        ("os.environ['XLA_FLAGS'] = '{flag}=true'", "{flag}=true"),
    ],
)
def test_xla_flags_of_the_user_are_kept(before, flags):
    flag = pd._xla.FLAG
    code = PROBE.format(before=before.format(flag=flag))
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert found.strip() == flags.format(flag=flag)
