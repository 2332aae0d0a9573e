"""Read materials: convert networks of shader nodes to the inputs of a UsdPreviewSurface, `scene.Material`."""
