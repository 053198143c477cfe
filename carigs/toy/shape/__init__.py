"""The geometry of the toy head: solids, marching tetrahedra, remeshing, the template mesh."""
