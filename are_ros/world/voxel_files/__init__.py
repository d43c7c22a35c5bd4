"""Files of M3D: octomaps (.bt, .ot), point clouds (PCD, PLY) and meshes (PLY)."""
