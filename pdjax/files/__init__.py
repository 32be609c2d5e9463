"""Files of bodies and results, from and for other programs.

From the function that users call down to the formats:

    read           read_points, and the table of formats by suffix
    write          write_points: text, CSV and .npz
    vtk            VTK files for ParaView; pdjax.export is this module
    point_data     PointData, the fields and sets of a state of a file
    bodies         the body of a file: dimension, checks, volumes
    contents       what the reader of a format returns
    faults         errors that name the file

Tables of points:

    columns        named columns become positions, volumes, vectors and sets
    table          tables of numbers in text files
    text           text and CSV, the meshes of Peridigm and PeriLab
    arrays         NumPy archives (.npz)
    lammps_data    data files of LAMMPS
    lammps_dump    text dumps of LAMMPS

Meshes:

    meshes         from a mesh to points, sets and fields
    cells          centroids, volumes and facets of cells
    gmsh           Gmsh; gmsh_numbers reads its numbers
    vtu            unstructured grids of VTK in XML; xml refuses entities, vtu_write writes
    legacy_vtk     legacy files of VTK
    exodus         Exodus II
    abaqus         Abaqus
    series         lists of VTK files at several times or in several parts
"""
