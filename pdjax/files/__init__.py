"""Files of bodies and results: read and written.

Written:

    vtk          files for ParaView; pdjax.export is this module
    vtu_write    one unstructured grid of VTK

Meshes and results that are read:

    read         the table of formats
    contents     what a reader of a format returns
    meshes       from a mesh to points, sets and fields; cells has the formulas
    gmsh         Gmsh; gmsh_numbers reads its numbers
    vtu          unstructured grids of VTK in XML; xml refuses entities
    legacy_vtk   legacy files of VTK
    exodus       Exodus II
    abaqus       Abaqus
    series       lists of files at several times: PVD and .vtu.series
    faults       errors that name the file
"""
