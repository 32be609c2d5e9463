"""Files of bodies and results for other programs.

There is one module:

    vtk    files for ParaView; pdjax.export is this module
"""
