"""Files of bodies and results, from and for other programs.

From the function that users call down to the formats:

    read           read_points, and the table of formats by suffix
    write          write_points: text, CSV and .npz
    vtk            VTK files for ParaView; pdjax.export is this module
    point_data     PointData, the fields and sets of a state of a file
    bodies         the body of a file: dimension, checks, volumes
    contents       what the reader of a format returns
    faults         errors that name the file
    formats        one module for each format
"""
