"""Fields and sets of the points of a body that a file holds, at one of its states: `PointData`."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from .contents import Contents
from .formats.columns import combined

ROUNDING = 1e-12  # a component of a vector counts as zero below this fraction of the largest one


@dataclass(frozen=True, eq=False, repr=False)
class PointData:
    """Fields and sets of points at one state of a file, as `read_points` returns them.

    Attributes
    ----------
    fields : dict of str to array, shape (points, …)
        Numbers by name, in the order of the points.
    sets : dict of str to array of bool, shape (points,)
        Masks of named parts, such as "block 1".
    time : float or None
        Time of this state, or None if the file has no times.
    times : tuple of float
        Times of all states of the file.
    step : int
        Number of this state, from 0.
    notes : tuple of str
        What was assumed, left out or computed, in sentences.
    source : pathlib.Path
        The file.

    Examples
    --------
    >>> import tempfile
    >>> body = pd.lattice((3, 2))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = pd.write_points(f"{folder}/plate.csv", body, fields={"u": 0.1 * body.positions})
    ...     _, data = pd.read_points(file)
    >>> data.vector("u", 2)[:2].round(3).tolist()
    [[0.05, 0.05], [0.05, 0.15]]
    """

    fields: dict[str, np.ndarray]
    sets: dict[str, np.ndarray]
    time: float | None
    times: tuple[float, ...]
    step: int
    notes: tuple[str, ...]
    source: Path
    axes: tuple[int, ...] = field(repr=False)  # the components of the file's coordinates that the body has
    load: Callable[[int], Contents] = field(repr=False)  # loads a state of the file

    def __repr__(self) -> str:
        def shown(name: str, values: np.ndarray) -> str:
            return f"{name} {values.shape[1:]}" if values.ndim > 1 else name

        lines = [f"PointData of {self.source.name}"]
        if len(self.times) > 1:
            lines[0] += f", state {self.step} of {len(self.times)}, t = {self.time}"
        elif self.time is not None:
            lines[0] += f", t = {self.time}"
        lines.append("  fields: " + (", ".join(shown(*item) for item in self.fields.items()) or "none"))
        held = ", ".join(f"{name} ({int(mask.sum())} points)" for name, mask in list(self.sets.items())[:20])
        more = f" and {len(self.sets) - 20} more" if len(self.sets) > 20 else ""
        lines.append("  sets: " + (held or "none") + more)
        return "\n".join(lines + [f"  {note}" for note in self.notes])

    def vector(self, name: str, dim: int) -> np.ndarray:
        """A field of vectors with the dimension of the body.

        Parameters
        ----------
        name : str
            Name of the field, in upper or lower case. Scalar fields name_x, name_y, … are taken together.
        dim : int
            Dimension of the body: 1, 2 or 3.

        Returns
        -------
        array, shape (points, dim)
            The components along the axes of the body.

        Raises
        ------
        ValueError
            If there is no such field, or it has fewer components, or a component beyond the body that is not zero.
        """
        known = combined(self.fields, alone=True) | self.fields
        key = name if name in known else next((k for k in known if k.lower() == name.lower()), None)
        if key is None:
            listed = ", ".join(sorted(self.fields)) or "none"
            raise ValueError(f"{self.source.name} has no field {name!r}; its fields are: {listed}")
        values = known[key]
        if values.ndim == 1:
            values = values[:, None]
        if values.ndim != 2 or values.shape[1] < dim:
            raise ValueError(
                f"field {key} must have {dim} components to be a vector of a body in {dim}D; got shape {values.shape}"
            )
        kept = list(self.axes) if len(self.axes) == dim and max(self.axes) < values.shape[1] else list(range(dim))
        beyond = np.delete(values, kept, axis=1)
        if beyond.size and np.abs(beyond).max(initial=0.0) > ROUNDING * np.abs(values).max(initial=0.0):
            raise ValueError(
                f"field {key} has {values.shape[1]} components and the body is {dim}D; expected zeros in the other"
                f" components; got up to {np.abs(beyond).max():g}; read the points with dim={values.shape[1]}"
            )
        return values[:, kept]

    def states(self) -> Iterator["PointData"]:
        """Yield the data of every state of the file, one after the other; only one is in memory.

        Yields
        ------
        PointData
            The data of the next state.

        Raises
        ------
        ValueError
            If a state is damaged or has another number of points.
        """
        for step in range(max(len(self.times), 1)):
            yield self if step == self.step else self.at(step)

    def at(self, step: int) -> "PointData":
        """The data of another state of the file.

        Parameters
        ----------
        step : int
            Number of the state, from 0; negative numbers count from the end.

        Returns
        -------
        PointData
            The data of that state.

        Raises
        ------
        ValueError
            If there is no such state, or it is damaged or has another number of points.
        """
        step = state_number(self.source, self.times, step)
        contents = self.load(step)
        notes = tuple(dict.fromkeys(self.notes + contents.notes))
        time = self.times[step] if self.times else None
        return replace(self, fields=contents.fields, sets=contents.sets, time=time, step=step, notes=notes)


def state_number(source: Path, times: tuple[float, ...], step: int) -> int:
    """The number of a state, from 0. Raises ValueError that lists the states if there is no such state."""
    count = max(len(times), 1)
    if not -count <= step < count:
        some = ", ".join(f"{t:g}" for t in times[:10]) + (", …" if len(times) > 10 else "")
        told = f", at the times {some}" if times else ""
        raise ValueError(
            f"step must be from {-count} to {count - 1}; {source.name} has {count} states{told}; got {step}"
        )
    return step % count
