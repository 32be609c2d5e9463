"""Writing of figures to files."""

from pathlib import Path
from typing import TYPE_CHECKING

from .checks import written_whole

if TYPE_CHECKING:
    import matplotlib.figure


def write_picture(figure: "matplotlib.figure.Figure", picture: Path) -> None:
    """Write a matplotlib figure as a PNG file. A write that fails leaves no file behind."""
    with written_whole(picture) as stream:
        figure.savefig(stream, format="png", dpi=150)
