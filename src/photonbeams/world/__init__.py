"""What rays meet: shapes, media, emitters, portals, cameras and the shutter."""
