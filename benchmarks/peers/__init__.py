"""What a user would pick instead of pdjax: honest opponents for the benchmarks, and nothing that pdjax itself uses.

    lattice_forces   Numba by hand on a uniform lattice, no index list (grid, lattice_kernels, silling_kernel)
    list_forces      Numba by hand on any cloud, a list of neighbours (list_kernels)
    lammps_peri      LAMMPS's PERI package: peri/pmb, peri/lps, dynamical_matrix
    by_differences   NumPy and SciPy: Jacobians, symbols and spectra by finite differences and ARPACK

Each force is an object made once (its reference quantities computed) and called as f(u), (points, 3) → (points, 3).
`pip install -e ".[peers]"` installs what they need; a module whose package is missing raises ImportError when loaded.
"""
