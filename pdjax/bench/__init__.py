"""Measurements of speed and accuracy: the cases of `pdjax bench`, their common parts, and `advise`.

A case is one small file with a plan of its measurements, row by row, and a function that draws them. The table
`cases.CASES` lists the cases. `advise` reads the measured rows. It is the only part that the rest of the package
imports, and it needs neither the cases nor matplotlib.
"""
