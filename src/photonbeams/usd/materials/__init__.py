"""Read materials: convert networks of shader nodes to the inputs of a UsdPreviewSurface, `scene.Material`."""

from .bound import Bound as Bound
from .bound import bound_material as bound_material
from .bound import bound_to as bound_to
from .on_mesh import on_mesh as on_mesh
from .on_mesh import primvars_of as primvars_of
