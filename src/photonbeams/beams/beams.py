"""The primitive: a photon beam is a truncated cone of light (Talk, section 1; theory of Jarosz et al. 2011).

A beam is the whole path of a photon between two scattering events. It has two ends, a radius at each end, and a power Φ
(RGB flux). In the Talk it is a linear RiCurves primitive with two control points. `Beams` holds many beams as a Dr.Jit
struct of arrays.
"""

from __future__ import annotations

from collections.abc import Iterable
from copy import copy
from typing import Any, ClassVar

import drjit as dr
import numpy as np

from ..numerics.arrays import joined, opaque, taken, to_uint
from ..numerics.given import Numbers
from ..numerics.hashing import hash32, unit_float
from ..runtime.device import Array3f, Float, UInt32
from ..runtime.files import PathLike, atomic_file
from ..runtime.inputs import arrays
from ..scene import Array, SceneError, arguments, shown
from ..scene.declared import unknown
from .fields import NAMING, OPTIONAL, REQUIRED, UNIT, VECTORS, Index, beam_array, check_radii, count_of, positions


class Beams:
    """N photon beams: truncated cones of light, each with a power.

    Parameters
    ----------
    start
        (N, 3) positions where the beams begin, in scene units. Required.
    end
        (N, 3) positions where the beams end, in scene units. Required.
    radius_start
        (N,) radii where the beams begin, in scene units, 0 or more, or one number for all beams. Required.
    radius_end
        (N,) radii where the beams end, given like `radius_start`. Required. One radius of a beam may be zero, but not
        both.
    power
        (N, 3) RGB flux Φ, or one colour for all beams. Required.
    offset
        (N,) distance along the light path from the light to the beam's start, in scene units. With it, falloffs
        continue across the pieces of one light path. Default: 0.
    total
        (N,) length of the whole light path in scene units. Fractions along the beam refer to it. Default: `offset` plus
        the beam's length.
    entry
        (N,) distance along the light path from the light to the point where the medium begins, in scene units.
        Default: 0.
    end_normal
        (N, 3) normal of the surface that stopped the beam. The beam is cut by that plane, so that it does not poke
        through a wall that it meets at a slant. Default: the beam is cut straight across.
    start_normal
        (N, 3) normal of the surface that the beam leaves, or 0. The beam is cut by that plane, so that it does not
        shine through a thin wall behind its start. Default: 0, which cuts nothing.
    side, side_normal
        (N, 3) a point of a surface beside the beam, and its normal toward the beam; give both or neither. The beam is
        cut by that plane, so that it does not shine through a wall that is thinner than the beam is wide. A normal of
        0 cuts nothing. Default: the beam is whole.
    random
        (N,) a random number from 0 to 1 for looks. Default: a hash of `id`.
    id
        (N,) a number that identifies the beam from frame to frame. Pieces of one light path share it. Default: the
        beam's index.
    generation
        (N,) number of times that the beam's light was scattered before. Default: 0.
    start_tangent, end_tangent
        (N, 3) directions of the light at the two ends of a piece of a curve; give both or neither. The piece is cut by
        the planes across these directions, through `start` and `end` (an `end_normal` replaces the plane at the end).
        Radius, falloff, power and direction change smoothly from one plane to the other. Two pieces that share an end,
        its radius and its tangent are therefore one beam there, without a seam. Default: the beam is straight.
    power_end
        (N, 3) RGB flux at the end; the power changes linearly along the beam. Default: `power`.

    Raises
    ------
    SceneError
        If an argument is not numeric or not finite, if shapes do not agree, if a radius is negative or both radii of a
        beam are zero, if one of two arrays that belong together is missing, or if an index is out of range (this error
        is also an IndexError).

    See Also
    --------
    curved : makes the beams of curves, joined without a seam.

    Notes
    -----
    Arrays may be lists, NumPy arrays, or Dr.Jit arrays (an `Array3f`, or a tensor of shape (N, 3)); enabled gradients
    stay enabled. The attributes are Dr.Jit arrays, component by component, as kernels use them; optional ones that were
    not given are None. `arrays` returns NumPy arrays of shape (N, 3) instead.

    Beams are indexed like rows: `beams[3]` and `beams[-1]` hold one beam, `beams[10:20]`, `beams[[1, 5]]` and
    `beams[mask]` hold several. A beam keeps its `id`. `beams + more` holds the beams of both, and `sum` those of many.
    Arrays may be set: `beams.power = [[1, 0, 0], [0, 1, 0]]`.

    References
    ----------
    Jarosz, Nowrouzezahrai, Sadeghi, Jensen, "A Comprehensive Theory of Volumetric Radiance Estimation using Photon
    Points and Beams" (2011).

    Examples
    --------
    >>> beams = pb.Beams([[0, 0, 0], [1, 0, 0]], [[0, 0, 4], [1, 0, 4]], 0.1, 0.5, power=[9, 9, 9])
    >>> beams
    Beams(2)
    >>> beams[1].arrays()["end"].tolist()
    [[1.0, 0.0, 4.0]]
    >>> len(beams + beams[:1])
    3
    """

    DRJIT_STRUCT: ClassVar[dict[str, Any]] = {
        name: (Array3f if name in VECTORS else Float) for name in (*REQUIRED, *OPTIONAL)
    }

    start: Array3f
    end: Array3f
    radius_start: Float
    radius_end: Float
    power: Array3f
    offset: Float | None
    total: Float | None
    entry: Float | None
    end_normal: Array3f | None
    start_tangent: Array3f | None
    end_tangent: Array3f | None
    power_end: Array3f | None
    random: Float | None
    id: Float | None
    generation: Float | None
    start_normal: Array3f | None
    side: Array3f | None
    side_normal: Array3f | None

    @arguments
    def __init__(
        self,
        start: Numbers | None = None,
        end: Numbers | None = None,
        radius_start: Numbers | None = None,
        radius_end: Numbers | None = None,
        power: Numbers | None = None,
        *,
        offset: Numbers | None = None,
        total: Numbers | None = None,
        entry: Numbers | None = None,
        end_normal: Numbers | None = None,
        random: Numbers | None = None,
        id: Numbers | None = None,
        generation: Numbers | None = None,
        start_tangent: Numbers | None = None,
        end_tangent: Numbers | None = None,
        power_end: Numbers | None = None,
        start_normal: Numbers | None = None,
        side: Numbers | None = None,
        side_normal: Numbers | None = None,
    ) -> None:
        given = {name: value for name, value in locals().items() if name in self.DRJIT_STRUCT}
        fields: dict[str, Any] = self.__dict__
        if all(value is None for value in given.values()):  # Dr.Jit creates a struct before it fills it
            fields.update({name: kind() for name, kind in self.DRJIT_STRUCT.items()}, **dict.fromkeys(OPTIONAL))
            return
        count = count_of(start)
        fields.update({name: beam_array(given[name], name, count) for name in REQUIRED})
        for name in OPTIONAL:
            fields[name] = None if given[name] is None else beam_array(given[name], name, count)
        for one, other in (("start_tangent", "end_tangent"), ("side", "side_normal")):
            if (given[one] is None) != (given[other] is None):
                raise SceneError(f"Beams: one of {one} and {other} is given: expected both, or neither")
        check_radii(self.radius_start, self.radius_end)

    def __setattr__(self, name: str, value: Numbers | None) -> None:
        """Set an array, given as to the constructor. While there are no beams, Dr.Jit's arrays may have any length."""
        if name not in self.DRJIT_STRUCT:
            raise SceneError(unknown("Beams", name, self.DRJIT_STRUCT))
        count = len(self)
        fits = isinstance(value, self.DRJIT_STRUCT[name]) and (not count or dr.width(value) == count)
        if not fits and not (value is None and name in OPTIONAL):
            value = beam_array(value, name, count)
            if name in ("radius_start", "radius_end"):
                check_radii(*({**self.__dict__, name: value}[each] for each in ("radius_start", "radius_end")))
        self.__dict__[name] = value

    def __len__(self) -> int:
        """Return the number of beams."""
        return int(dr.width(self.start))

    def __repr__(self) -> str:
        own = [name for name in OPTIONAL if getattr(self, name) is not None]
        return f"Beams({len(self):,}{' with ' if own else ''}{', '.join(own)})"

    def __getitem__(self, index: Index) -> Beams:
        """Return the beams at an index: a number, a slice, or an array of numbers or truth values."""
        result = self.take(to_uint(positions(index, len(self))))
        if self.id is None:
            result.id = Float(positions(index, len(self)))
        return result

    def __add__(self, other: Beams) -> Beams:
        return Beams.join((self, other))

    def __radd__(self, other: Any) -> Beams:
        """Return the beams themselves for 0, with which Python's `sum` begins."""
        return self if isinstance(other, int) and other == 0 else Beams.join((other, self))

    @classmethod
    def join(cls, parts: Iterable[Beams]) -> Beams:
        """Return the beams of all `parts`, in order.

        Parameters
        ----------
        parts
            One or more `Beams`. An optional array that only some of them have gets its default in the others: see the
            parameters of `Beams`. The default of `id` is the beam's index in the result. Parts without beams add
            nothing.

        Raises
        ------
        SceneError
            If there are no parts, or if one of them is not `Beams`.

        Examples
        --------
        >>> one = pb.Beams([[0, 0, 0]], [[0, 0, 1]], 0.1, 0.2, [1, 1, 1])
        >>> pb.Beams.join([one, one, one])
        Beams(3)
        """
        listed = list(parts) if isinstance(parts, Iterable) and not isinstance(parts, Beams | str) else [parts]
        wrong = [each for each in listed if not isinstance(each, Beams)]
        if wrong or not listed:
            raise SceneError(f"beams are joined with {shown(wrong[0]) if wrong else 'none'}: expected Beams")
        listed = [each for each in listed if len(each)] or listed[:1]
        present = {name for name in OPTIONAL for each in listed if getattr(each, name) is not None}
        first = 0
        filled = []
        for each in listed:
            filled.append(each._filled(present, first))
            first += len(each)
        result: Beams = joined(filled)
        return result

    def _filled(self, names: Iterable[str], first: int) -> Beams:
        """Return the beams with all optional arrays of these names; `first` is the first beam's index in the whole."""
        result = copy(self)
        for name in names:
            if getattr(self, name) is None:
                setattr(result, name, self._default(name, first))
        return result

    def _default(self, name: str, first: int) -> Any:
        """Return the default of an optional array."""
        count = len(self)
        nothing = dr.zeros(Float, count)
        axis = self.end - self.start
        length = dr.norm(axis)
        axis = dr.select(length > 0, axis * dr.rcp(length), Array3f(0, 0, 1))
        number = Float(dr.arange(UInt32, count) + dr.opaque(UInt32, first)) if self.id is None else self.id
        offset = nothing if self.offset is None else self.offset
        return {
            "offset": offset, "total": offset + length, "entry": nothing,
            "end_normal": -(axis if self.end_tangent is None else self.end_tangent),
            "start_tangent": axis, "end_tangent": axis,
            "power_end": self.power, "random": unit_float(hash32(UInt32(dr.abs(number)))), "id": number,
            "generation": nothing, "start_normal": dr.zeros(Array3f, count), "side": self.start,
            "side_normal": dr.zeros(Array3f, count),
        }[name]  # fmt: skip

    def arrays(self) -> dict[str, Array]:
        """Return all arrays that are set as NumPy arrays, (N, 3) or (N,), keyed by the constructor's names."""
        present = {name: getattr(self, name) for name in (*REQUIRED, *OPTIONAL)}
        return {
            name: np.ascontiguousarray(value.numpy().T) if dr.depth_v(value) == 2 else value.numpy()
            for name, value in present.items()
            if value is not None
        }

    def numbers(self) -> UInt32:
        """Return the number of each beam's light path, (N,), which all pieces of a path share; without `id`, the index.

        Numbers are whole and not negative: the magnitude of `id`, without its fractional part.
        """
        return dr.arange(UInt32, len(self)) if self.id is None else UInt32(dr.abs(self.id))

    def identity(self) -> Array3f:
        """Return each beam's `random`, `id` and `generation`, or their defaults, as (N, 3)."""
        if not len(self):
            return dr.zeros(Array3f, 0)
        whole = self._filled(NAMING, first=0)
        return Array3f(whole.random, whole.id, whole.generation)

    def take(self, index: UInt32) -> Beams:
        """Return the beams at these indices; `index` is a Dr.Jit UInt32 array, which is not checked."""
        result: Beams = taken(self, index)
        return result

    @arguments
    def save(self, path: PathLike) -> None:
        """Write the beams to a NumPy archive.

        Parameters
        ----------
        path
            File to write, usually with the suffix .npz. Missing folders are created. If writing fails, no partial file
            is left.

        Raises
        ------
        OSError
            If the file cannot be written.

        Examples
        --------
        >>> beams = pb.Beams([[0, 0, 0]], [[0, 0, 1]], 0.1, 0.2, [1, 1, 1])
        >>> beams.save("beams.npz")
        >>> pb.Beams.load("beams.npz")
        Beams(1)
        """
        with atomic_file(path) as file:
            np.savez_compressed(file, **self.arrays())  # type: ignore[arg-type]

    @classmethod
    @arguments
    def load(cls, path: PathLike) -> Beams:
        """Return the beams that `save` wrote to a file.

        Parameters
        ----------
        path
            The NumPy archive (.npz).

        Raises
        ------
        SceneError
            If there is no such file, or if it does not hold beams.
        """
        try:
            found = arrays(path)
            return cls(**{name: found[name] for name in (*REQUIRED, *OPTIONAL) if name in found})
        except SceneError as error:
            raise SceneError(f"{path}: expected beams saved by photonbeams (.npz), but {error}") from None


def between(first: Beams, last: Beams, time: float) -> Beams:
    """Return beams at a `time` between two states of them, 0 and 1; all but what names them is interpolated."""
    part, result = opaque(time), copy(first)
    for name in (*REQUIRED, *OPTIONAL):
        one, other = getattr(first, name), getattr(last, name)
        if name in NAMING or one is None or other is None:
            continue
        value = dr.lerp(one, other, part)
        if name in UNIT:
            there = (dr.squared_norm(one) > 0) & (dr.squared_norm(other) > 0)
            value *= dr.select(there, dr.rsqrt(dr.maximum(dr.squared_norm(value), 1e-30)), 0)
        setattr(result, name, value)
    dr.eval(result)
    return result
