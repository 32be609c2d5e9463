"""The geometry of a body on the host: points, families of bonds, influence functions, cuts and reports."""
