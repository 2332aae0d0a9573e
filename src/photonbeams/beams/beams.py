"""The primitive: a photon beam is a truncated cone of light (Talk, section 1; theory of Jarosz et al. 2011).

A beam is the whole path of a photon between two scattering events: two ends, a radius at each, and a power Φ (RGB,
flux). It is the Talk's linear RiCurves with two control points. `Beams` holds many of them as a Dr.Jit struct of
arrays.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any, ClassVar, TypeAlias, Union
from zipfile import BadZipFile

import drjit as dr
import numpy as np
import numpy.typing as npt

from ..numerics.arrays import joined, taken, to_float, to_uint, to_vectors
from ..numerics.given import Numbers
from ..numerics.hashing import hash32, unit_float
from ..runtime.device import Array3f, Float, UInt32
from ..runtime.files import PathLike, atomic_path
from ..scene import Array, SceneError, arguments, numbers, shown

_COLOR = ("start", "end", "power")
_REQUIRED = ("start", "end", "radius_start", "radius_end", "power")
_OPTIONAL = (
    "offset", "total", "entry", "end_normal", "start_tangent", "end_tangent", "power_end", "random", "id", "generation"
)  # fmt: skip
#: Which beams: a number, a slice, or an array of numbers or of truth values, of NumPy or Dr.Jit, or a list.
Index: TypeAlias = Union[int, slice, npt.ArrayLike, "UInt32"]

_VECTORS = (*_COLOR, "end_normal", "start_tangent", "end_tangent", "power_end")


class Beams:
    """N photon beams.

    Parameters
    ----------
    start, end
        (N, 3) positions of the two ends, scene units.
    radius_start, radius_end
        (N,) radii at the two ends, not negative; a number serves all beams. One may be zero, never both.
    power
        (N, 3) flux Φ, or one colour for all beams.
    offset
        (N,) distance from the light at which the beam starts: falloffs along a light path that was cut in pieces go
        on over the cut. Default 0.
    total
        (N,) length of the whole light path, to which fractions along the beam refer. Default: the end of this beam.
    entry
        (N,) distance from the light at which the medium begins. Default: at the light.
    end_normal
        (N, 3) normal of the surface that stopped the beam: the beam is cut by that plane, not straight across, and
        does not poke through walls that it meets at a slant. Default: cut straight across.
    random, id, generation
        (N,) what looks may ask of a beam: a random number from 0 to 1, a number that names it from frame to frame, and
        how often its light was scattered before. Default: a hash of the number, its place here, 0.
    start_tangent, end_tangent
        (N, 3) directions of the light at the two ends of a piece of a curve, in which `chains.tangents` joins pieces.
        The piece is cut by the planes across them, through `start` and `end` (an `end_normal` takes the place of the
        latter), and radius, falloff, power and direction change smoothly from the one plane to the other: two pieces
        that share an end, its radius and its tangent are one beam there, without a seam. Given both, or neither: then
        the beam is straight.
    power_end
        (N, 3) power at the end, where it changes along the beam, linearly. Default: that of the start.

    Arrays may be lists, NumPy's, or Dr.Jit's: an `Array3f`, or a tensor (N, 3). Gradients stay enabled. The attributes
    are Dr.Jit arrays as kernels hold them, component by component; `arrays()` returns them as NumPy's, (N, 3).

    Beams are indexed as rows: `beams[3]` and `beams[-1]` are beams of one, `beams[10:20]`, `beams[[1, 5]]` and
    `beams[mask]` of several. A beam keeps its number. `beams + more` are both.

    Raises
    ------
    SceneError
        Arguments that are no numbers, shapes that do not agree, numbers that are not finite, negative radii; no beam of
        an index (which is an IndexError, too).

    Examples
    --------
    >>> import photonbeams as pb
    >>> beams = pb.Beams([[0, 0, 0]], [[0, 0, 1]], 0.1, 0.2, [[1, 1, 1]])
    >>> len(beams)
    1
    """

    DRJIT_STRUCT: ClassVar[dict[str, Any]] = {
        **{name: (Array3f if name in _VECTORS else Float) for name in (*_REQUIRED, *_OPTIONAL)},
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
    ) -> None:
        given = {
            "start": start, "end": end, "radius_start": radius_start, "radius_end": radius_end, "power": power,
            "offset": offset, "total": total, "entry": entry, "end_normal": end_normal,
            "random": random, "id": id, "generation": generation,
            "start_tangent": start_tangent, "end_tangent": end_tangent, "power_end": power_end,
        }  # fmt: skip
        if all(value is None for value in given.values()):  # as Dr.Jit makes a struct before it fills it
            for name in _OPTIONAL:
                setattr(self, name, None)
            return
        count = _count(start)
        for name in _REQUIRED:
            setattr(self, name, _array(given[name], name, count))
        for name in _OPTIONAL:
            setattr(self, name, None if given[name] is None else _array(given[name], name, count))
        if (start_tangent is None) != (end_tangent is None):
            raise SceneError("Beams: one of start_tangent and end_tangent is given: expected both, or neither")
        _check_radii(self)

    def __len__(self) -> int:
        """Return the number of beams."""
        return int(dr.width(self.start)) if hasattr(self, "start") else 0

    def __repr__(self) -> str:
        own = [name for name in _OPTIONAL if getattr(self, name) is not None]
        return f"Beams({len(self):,}{' with ' if own else ''}{', '.join(own)})"

    def __getitem__(self, index: Index) -> Beams:
        """Return the beams of a number, a slice, or an array of numbers or truth values."""
        result = self.take(to_uint(_places(index, len(self))))
        if self.id is None:
            result.id = Float(_places(index, len(self)))
        return result

    def __add__(self, other: Beams) -> Beams:
        return Beams.join((self, other))

    @classmethod
    def join(cls, parts: Iterable[Beams]) -> Beams:
        """Return all beams of several as one, in order.

        What some of them have and others have not is filled by its default: see the parameters of `Beams`. A beam
        without a number is named by its place in the whole.

        Raises
        ------
        SceneError
            What is no list of Beams, or an empty one.
        """
        listed = list(parts) if isinstance(parts, Iterable) and not isinstance(parts, Beams | str) else [parts]
        wrong = [each for each in listed if not isinstance(each, Beams)]
        if wrong or not listed:
            raise SceneError(f"beams are joined with {shown(wrong[0]) if wrong else 'none'}: expected Beams")
        present = {name for name in _OPTIONAL for each in listed if getattr(each, name) is not None}
        first = 0
        filled = []
        for each in listed:
            filled.append(each._filled(present, first))
            first += len(each)
        result: Beams = joined(filled)
        return result

    def _filled(self, names: set[str], first: int) -> Beams:
        """Return the beams with all optional numbers of these names; `first` is the first one's place in the whole."""
        result = Beams()
        for name in self.DRJIT_STRUCT:
            value = getattr(self, name)
            missing = value is None and name in names
            setattr(result, name, self._default(name, first) if missing else value)
        return result

    def _default(self, name: str, first: int) -> Any:
        """Return what an optional number is where it is not given."""
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
            "generation": nothing,
        }[name]  # fmt: skip

    def arrays(self) -> dict[str, npt.NDArray[np.float32]]:
        """Return all values that are set as NumPy arrays, (N, 3) or (N,), by the names of the constructor."""
        present = {name: getattr(self, name) for name in (*_REQUIRED, *_OPTIONAL)}
        return {
            name: np.ascontiguousarray(value.numpy().T) if dr.depth_v(value) == 2 else value.numpy()
            for name, value in present.items()
            if value is not None
        }

    def numbers(self) -> UInt32:
        """Return the number of each light path, (N,), that all its pieces share; without any, a beam's place here."""
        return dr.arange(UInt32, len(self)) if self.id is None else UInt32(dr.abs(self.id))

    def identity(self) -> Array3f:
        """Return random number, number and generation of each beam, (N, 3)."""
        nothing = dr.zeros(Float, len(self))
        number = Float(self.numbers()) if self.id is None else self.id
        random = unit_float(hash32(self.numbers())) if self.random is None else self.random
        return Array3f(random, number, nothing if self.generation is None else self.generation)

    def take(self, index: UInt32) -> Beams:
        """Return the beams of these numbers (a Dr.Jit UInt32 array)."""
        result: Beams = taken(self, index)
        return result

    def save(self, path: PathLike) -> None:
        """Write the beams as a NumPy archive (.npz), whole or not at all; makes the folder if there is none.

        Raises
        ------
        OSError
            As `files.atomic_path`.
        """
        with atomic_path(path) as beside, beside.open("wb") as file:
            np.savez_compressed(file, **self.arrays())  # type: ignore[arg-type]

    @classmethod
    def load(cls, path: PathLike) -> Beams:
        """Read beams that `save` wrote; raises SceneError where the file is none of that."""
        try:
            with Path(path).open("rb") as file, np.load(file, allow_pickle=False) as archive:
                return cls(**{name: archive[name] for name in (*_REQUIRED, *_OPTIONAL) if name in archive})
        except FileNotFoundError:
            raise SceneError(f"{path}: no such file") from None
        except (OSError, ValueError, TypeError, EOFError, BadZipFile) as error:
            raise SceneError(f"{path}: expected beams saved by photonbeams (.npz): {error}") from None


def _count(start: Any) -> int:
    if start is None:
        raise SceneError(f"Beams: start is not given: expected {_said('start')[1]}")
    if dr.is_jit_v(start) and not dr.is_tensor_v(start):
        return int(dr.width(start))
    return len(np.atleast_2d(dr.detach(start).numpy() if dr.is_jit_v(start) else numbers(start, *_said("start"))))


def _said(name: str) -> tuple[str, str]:
    """Return the name of an argument in messages, and its expected value."""
    return f"Beams: {name}", f"numbers of shape {'(N, 3)' if name in _VECTORS else '(N,)'}"


def _array(value: Any, name: str, count: int) -> Any:
    """Return `value` as Float or Array3f of width `count`, checked where it comes from outside."""
    vector = name in _VECTORS
    if value is None:
        raise SceneError(f"Beams: {name} is not given: expected {_said(name)[1]}")
    if dr.is_jit_v(value):
        return _broadcast(_of_device(value, name), name, count)
    shape = (count, 3) if vector else (count,)
    found = numbers(value, *_said(name))
    try:
        with np.errstate(over="ignore"):
            wide = np.broadcast_to(found.astype(np.float32, copy=False), shape)
    except ValueError:
        raise SceneError(f"Beams: {name} has shape {found.shape}: expected {shape}") from None
    if not np.all(np.isfinite(wide)):
        raise SceneError(f"Beams: {name} of beam {int(np.argwhere(~np.isfinite(wide))[0][0])} is not finite")
    return to_vectors(wide) if vector else to_float(wide)


def _of_device(value: Any, name: str) -> Any:
    """Return a Dr.Jit array or tensor as Float or Array3f, attached as it is."""
    vector, shape = name in _VECTORS, tuple(value.shape)
    if dr.is_tensor_v(value):
        if vector and len(shape) in (1, 2) and shape[-1] == 3:
            return dr.unravel(Array3f, Float(value.array))
        if not vector and len(shape) < 2:
            return Float(value.array)
    elif dr.depth_v(value) == 1 or (vector and dr.depth_v(value) == 2 and dr.size_v(value) == 3):
        return Array3f(value) if vector else Float(value)
    raise SceneError(f"Beams: {name} is a {type(value).__name__} of shape {shape}: expected {_said(name)[1]}")


def _broadcast(value: Any, name: str, count: int) -> Any:
    if dr.width(value) == 1 and count > 1:  # a number for all: broadcast, so that it can be gathered
        value = value + dr.zeros(Float, count)
    if dr.width(value) != count:
        raise SceneError(f"Beams: {name} has {dr.width(value)} entries: expected {count}, as start has")
    return value


class _NoSuchBeamError(SceneError, IndexError):
    """No beam has this index: an IndexError, by which Python ends loops."""


def _whole(index: Any) -> Array:
    """Return an index as an array; an empty list is one of no numbers."""
    found = np.asarray(index)
    return found.astype(np.int64) if not found.size and found.ndim == 1 else found


def _places(index: Any, count: int) -> Array:
    """Return the places of the beams of an index, (M,)."""
    if index is not None and dr.is_jit_v(index):
        index = index.numpy()
    try:
        found: Array = np.arange(count)[index if isinstance(index, slice | tuple) else _whole(index)]
    except (IndexError, ValueError, TypeError):
        found = np.zeros((0, 0))
    if found.ndim > 1 or isinstance(index, tuple):
        text = f"{count:,} beams are indexed by {shown(index)}: expected a slice, truth values for each, or numbers"
        raise _NoSuchBeamError(f"{text} from {-count} to {count - 1}")
    return np.atleast_1d(found)


def _check_radii(beams: Beams) -> None:
    if len(beams) and bool(
        dr.any((beams.radius_start < 0) | (beams.radius_end < 0) | (beams.radius_start + beams.radius_end <= 0))
    ):
        raise SceneError("Beams: expected radii that are not negative, and not both of a beam zero")
