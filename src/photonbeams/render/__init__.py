"""Pictures from beams: camera paths, surfaces, gathering, passes and layers."""
