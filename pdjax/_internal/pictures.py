"""Writing of figures to files."""

from pathlib import Path
from typing import Any

from .checks import written_whole


def write_picture(figure: Any, picture: Path) -> None:
    """Write a matplotlib figure as a PNG file. A write that fails leaves no file behind."""
    with written_whole(picture) as stream:
        figure.savefig(stream, format="png", dpi=150)
