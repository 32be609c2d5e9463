"""What a reader of one file format returns, before it becomes `Points` and `PointData`.

A reader is one module with one function `states(path) -> States`. It opens a file that may hold several states of one
body, such as the steps of a run, and lists their times without loading them. `at(k)` loads state k. A format that holds
a single state has no times and one state, 0.

A reader does not check volumes, drop coordinates or fill in what is missing: `pdjax.files.read` does this once for all
formats. It checks what only the format knows, and says where in the file a fault is.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np


@dataclass(frozen=True)
class Contents:
    """One state of a file.

    Attributes
    ----------
    positions : array, shape (points, 1 to 3)
        Reference positions [length], with the components that the file has.
    volumes : array, shape (points,), or None
        Volumes [length^dim] if the file has them.
    fields : dict of str to array, shape (points, …)
        Numbers by name. Components that the file lists one by one, such as disp_x and disp_y, are one vector "disp".
    sets : dict of str to array of bool, shape (points,)
        Masks of the named parts: blocks, physical groups, node sets.
    where : function, int → str
        Words for the place of a point in the file, such as "line 12" or "cell 7". Errors use them.
    notes : tuple of str
        What the reader assumed or left out, in sentences.
    dim : int or None
        Dimension of the cells of a mesh, whose measures are the volumes. One layer of hexahedra is a body in 3D,
        although all its centroids have the same z. None if the file does not tell.
    uncertain : str
        What is uncertain if the user gives other volumes, as a part of an error message; "" if nothing is.
    """

    positions: np.ndarray
    volumes: np.ndarray | None = None
    fields: dict[str, np.ndarray] = field(default_factory=dict)
    sets: dict[str, np.ndarray] = field(default_factory=dict)
    where: Callable[[int], str] = "point {}".format
    notes: tuple[str, ...] = ()
    dim: int | None = None
    uncertain: str = ""


class States(NamedTuple):
    """The states of a file: `times`, empty for a format without states, and a function that loads one state."""

    times: tuple[float, ...]
    at: Callable[[int], Contents]
