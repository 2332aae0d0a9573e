"""USD in, EXR out: stages, cameras, lights, meshes, media and looks; image files."""
