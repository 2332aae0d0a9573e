"""Frames of given layers, which are written as renders are."""

from photonbeams.images.frame import Frame
from photonbeams.render.passes import Statistics


def write_frame(path, layers, metadata=None, layer="rgba", exposure=0.0, views=None):
    """Write the file of a frame with these layers, or with these of its views."""
    Frame(layers, metadata or {}, Statistics(), dict(views or {})).write(path, layer, exposure)
