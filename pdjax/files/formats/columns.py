"""Named columns of numbers become positions, volumes, vectors and sets; the formats with named columns share this.

Names are compared without regard to case and without units in brackets: "X [mm]" is x. Columns of components are
one vector: u_x, u_y, u_z; ux, uy, uz; u:0, u:1, u:2; u_1, u_2, u_3. A column "set:NAME" of zeros and ones is a set.
"""

import re
from collections.abc import Callable

import numpy as np

from ..contents import Contents

COORDINATES = {
    "x": ("x", "coord_x", "points:0", "points_0", "x_coordinate"),
    "y": ("y", "coord_y", "points:1", "points_1", "y_coordinate"),
    "z": ("z", "coord_z", "points:2", "points_2", "z_coordinate"),
}
VOLUME = ("volume", "volumes", "vol", "vfrac", "c_vol", "c_volume", "c_vfrac", "v_vol")
BLOCK = ("block", "block_id", "blockid")
ID = ("id", "global_id", "point_id", "node_id")
MOST_BLOCKS = 256  # with more numbers than this, a column is no list of parts of a body
UNIT = re.compile(r"\s*[\[(][^\])]*[\])]\s*$")
ENDINGS = (  # how the names of components end, and whether a single one is a vector of one component
    (("_x", "_y", "_z"), True),
    ((":0", ":1", ":2"), True),
    (("x", "y", "z"), False),
    (tuple(f"_{k}" for k in range(1, 10)), False),
    (tuple(f"[{k}]" for k in range(1, 10)), False),
)


def plain(name: str) -> str:
    """A column name in lower case, without a unit in brackets."""
    return UNIT.sub("", name).strip().lower()


def found(names: list[str], known: tuple[str, ...]) -> str | None:
    """The first of the names that is one of the known ones, or None."""
    return next((name for name in names if plain(name) in known), None)


def parts(name: str, numbers: np.ndarray) -> dict[str, np.ndarray]:
    """A mask "NAME k" for every number k among the whole numbers of a column."""
    return {f"{name} {int(k)}": numbers == k for k in np.unique(numbers)}


def are_whole(values: np.ndarray) -> bool:
    """Whether all values are whole numbers that an int64 holds."""
    return bool((np.isfinite(values) & (values == np.round(values)) & (np.abs(values) < 2.0**53)).all())


def combined(columns: dict[str, np.ndarray], alone: bool = False) -> dict[str, np.ndarray]:
    """The columns with components joined into vectors and tensors. `alone`: a single u_x is a vector too."""
    out: dict[str, np.ndarray] = {}
    lower, used = {name.lower(): name for name in columns}, set()
    for name in columns:
        if name in used:
            continue
        stem, group, shape = _components(name, lower, alone)
        group = [lower[key] for key in group]
        if len(group) > 1 or shape:
            used.update(group)
            out[stem] = np.stack([columns[key] for key in group], axis=1).reshape(-1, *shape)
        else:
            out[name] = columns[name]
    return out


def _components(name: str, lower: dict[str, str], alone: bool) -> tuple[str, list[str], tuple[int, ...]]:
    """The name without the ending of its first component, all components in lower case, and the shape they have."""
    for size in (3, 2, 1) if name.endswith("_11") else ():
        wanted = [f"{name[:-3].lower()}_{i}{j}" for i in range(1, size + 1) for j in range(1, size + 1)]
        if name[:-3] and all(key in lower for key in wanted) and (size > 1 or alone):
            return name[:-3], wanted, (size, size)
    for endings, may_be_single in ENDINGS:
        stem = name[: -len(endings[0])]
        if name.lower().endswith(endings[0]) and stem.strip("_ "):
            wanted = [stem.lower() + end for end in endings]
            have = next((k for k, key in enumerate(wanted) if key not in lower), len(wanted))
            if have >= (1 if alone and may_be_single else 2):
                return stem, wanted[:have], (have,)
    return name, [name.lower()], ()


def body_of(columns: dict[str, np.ndarray], where: Callable[[int], str], notes: tuple[str, ...] = ()) -> Contents:
    """The contents of a table whose columns have names. Raises ValueError if there is no x, or z without y."""
    names = list(columns)
    at = [found(names, known) for known in COORDINATES.values()]
    listed = ", ".join(names)
    if at[0] is None or (at[2] is not None and at[1] is None):
        raise ValueError(f"expected columns named x, y and z, x and y, or x; got {listed}; rename the columns")
    rest = {name: values for name, values in columns.items() if name not in at}
    volume = found(list(rest), VOLUME)
    volumes = None if volume is None else rest.pop(volume)
    sets: dict[str, np.ndarray] = {}
    said = list(notes)
    block = found(list(rest), BLOCK)
    if block is not None:
        numbers = rest[block]
        if not are_whole(numbers):
            k = int(np.argmin(np.isfinite(numbers) & (numbers == np.round(numbers))))
            raise ValueError(
                f"{where(k)}: expected a whole number in the column {block}; got {numbers[k]}; correct it, or name the"
                " columns in a first line if their order is another"
            )
        if len(np.unique(numbers)) > MOST_BLOCKS:
            said.append(f"The column {block} has more than {MOST_BLOCKS} different numbers and is a field, not sets.")
        else:
            sets |= parts("block", rest.pop(block))
    for name in [name for name in rest if name.lower().startswith("set:")]:
        mask = rest.pop(name)
        if not np.isin(mask, (0.0, 1.0)).all():
            k = int(np.argmin(np.isin(mask, (0.0, 1.0))))
            raise ValueError(f"{where(k)}: expected 0 or 1 in the column {name}, which is a set; got {mask[k]}")
        sets[name[4:]] = mask == 1
    for name in list(rest):
        if plain(name) in ID and are_whole(rest[name]):
            rest["id"] = rest.pop(name).astype(np.int64)
    positions = np.stack([columns[name] for name in at if name is not None], axis=1)
    return Contents(positions, volumes, combined(rest, positions.shape[1] == 1), sets, where, tuple(said))
