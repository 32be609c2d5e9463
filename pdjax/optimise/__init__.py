"""Design by gradient and inverse problems: derivatives of stability, statics and dynamics put to use.

This room stands above the infinite lattice, the finite body and the scenes.
"""
