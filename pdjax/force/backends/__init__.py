"""Backends of the force density: padded families, slices of a lattice, convolutions on a lattice.

All backends compute the same forces to rounding. `slabs` divides a lattice body over many devices.
"""
