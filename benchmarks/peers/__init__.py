"""Alternatives to pdjax that the benchmarks compare it with; pdjax itself does not use them.

    lattice_forces   hand-written Numba on a uniform lattice, no index list (grid, lattice_kernels, silling_kernel)
    list_forces      hand-written Numba on any cloud, with a list of neighbours (list_kernels)
    lammps_peri      LAMMPS's PERI package: peri/pmb, peri/lps, dynamical_matrix
    by_differences   NumPy and SciPy: Jacobians, symbols and spectra by finite differences and ARPACK

Each force is an object. Its constructor computes the reference quantities once, and f(u) maps (points, 3) to
(points, 3). `pip install -e ".[peers]"` installs the dependencies. A module whose dependency is missing raises
ImportError on import.
"""
