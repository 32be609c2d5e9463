"""The formats of files, one module for each.

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
