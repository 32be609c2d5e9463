"""Files of bodies and results, from and for other programs.

From the function that users call down to the formats:

    read           read_points, and the table of formats by suffix
    write          write_points: text, CSV and .npz
    point_data     PointData, the fields and sets of a state of a file
    bodies         the body of a file: dimension, checks, volumes
    contents       what the reader of a format returns
    columns        named columns become positions, volumes, vectors and sets
    table          tables of numbers in text files
    text           text and CSV, the meshes of Peridigm and PeriLab
    arrays         NumPy archives (.npz)
    lammps_data    data files of LAMMPS
    lammps_dump    text dumps of LAMMPS
    vtk            VTK files for ParaView; pdjax.export is this module
"""
