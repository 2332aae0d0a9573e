"""The types of Mitsuba's plug-ins, and of what these take and return, by names for annotations.

Plug-ins begin with "Mi", because the program has classes of the same names. Mitsuba's vectors are annotated as
`Array3f`, to which they convert; an argument is Any where Mitsuba's stubs refuse what Mitsuba accepts.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

if TYPE_CHECKING:
    import mitsuba as mi

    Bitmap: TypeAlias = mi.Bitmap
    BoundingBox: TypeAlias = mi.ScalarBoundingBox3f
    BsdfContext: TypeAlias = mi.BSDFContext
    BsdfSample: TypeAlias = mi.BSDFSample3f
    DirectionSample: TypeAlias = mi.DirectionSample3f
    EmitterPtr: TypeAlias = mi.EmitterPtr
    ImageBlock: TypeAlias = mi.ImageBlock
    Interaction: TypeAlias = mi.Interaction3f
    MediumPtr: TypeAlias = mi.MediumPtr
    MiBsdf: TypeAlias = mi.BSDF
    MiEmitter: TypeAlias = mi.Emitter
    MiFilm: TypeAlias = mi.Film
    MiMedium: TypeAlias = mi.Medium
    MiMesh: TypeAlias = mi.Mesh
    MiObject: TypeAlias = mi.Object
    MiScene: TypeAlias = mi.Scene
    MiSensor: TypeAlias = mi.Sensor
    MiShape: TypeAlias = mi.Shape
    MiVolume: TypeAlias = mi.Volume
    PositionSample: TypeAlias = mi.PositionSample3f
    Properties: TypeAlias = mi.Properties
    Ray: TypeAlias = mi.Ray3f
    RayDifferential: TypeAlias = mi.RayDifferential3f
    Sampler: TypeAlias = mi.Sampler
    ScalarTransform: TypeAlias = mi.ScalarTransform4f
    SceneParameters: TypeAlias = mi.SceneParameters
    ShapePtr: TypeAlias = mi.ShapePtr
    Spectrum: TypeAlias = mi.Spectrum
    Stream: TypeAlias = mi.Stream
    SurfaceInteraction: TypeAlias = mi.SurfaceInteraction3f
