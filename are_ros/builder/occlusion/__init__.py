"""What a camera sees of the artefacts (equation 2): z-buffer, rays through voxels, and meshes."""
