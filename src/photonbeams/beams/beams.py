"""The primitive: a photon beam is a truncated cone of light (Talk, section 1; theory of Jarosz et al. 2011).

A beam is the whole path of a photon between two events: two ends, a radius at each, and a power Φ (RGB, flux). It is
the Talk's linear RiCurves with two control points. `Beams` holds many of them as a Dr.Jit struct of arrays.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar
from zipfile import BadZipFile

import drjit as dr
import numpy as np
import numpy.typing as npt

from ..numerics.arrays import taken, to_float, to_vectors
from ..numerics.hashing import hash32, unit_float
from ..runtime.device import Array3f, Float, UInt32
from ..runtime.files import PathLike, atomic_path
from ..scene import SceneError

_COLOR = ("start", "end", "power")
_REQUIRED = ("start", "end", "radius_start", "radius_end", "power")
_OPTIONAL = (
    "offset", "total", "entry", "end_normal", "start_tangent", "end_tangent", "power_end", "random", "id", "generation"
)  # fmt: skip
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

    Arrays may be NumPy or Dr.Jit arrays. `start`, ... are then Dr.Jit arrays (`Array3f`, `Float`).

    Raises
    ------
    SceneError
        Shapes that do not agree, numbers that are not finite, negative radii.

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

    def __init__(
        self,
        start: Any = None,
        end: Any = None,
        radius_start: Any = None,
        radius_end: Any = None,
        power: Any = None,
        *,
        offset: Any = None,
        total: Any = None,
        entry: Any = None,
        end_normal: Any = None,
        random: Any = None,
        id: Any = None,
        generation: Any = None,
        start_tangent: Any = None,
        end_tangent: Any = None,
        power_end: Any = None,
    ) -> None:
        if start is None:  # as Dr.Jit makes a struct before it fills it
            for name in _OPTIONAL:
                setattr(self, name, None)
            return
        given = {
            "start": start, "end": end, "radius_start": radius_start, "radius_end": radius_end, "power": power,
            "offset": offset, "total": total, "entry": entry, "end_normal": end_normal,
            "random": random, "id": id, "generation": generation,
            "start_tangent": start_tangent, "end_tangent": end_tangent, "power_end": power_end,
        }  # fmt: skip
        count = _count(start)
        for name in _REQUIRED:
            setattr(self, name, _array(given[name], name, count))
        for name in _OPTIONAL:
            setattr(self, name, None if given[name] is None else _array(given[name], name, count))
        if (start_tangent is None) != (end_tangent is None):
            raise SceneError("Beams: one of start_tangent and end_tangent is given: expected both, or neither")
        _check_radii(self)

    start: Any
    end: Any
    radius_start: Any
    radius_end: Any
    power: Any
    offset: Any
    total: Any
    entry: Any
    end_normal: Any
    start_tangent: Any
    end_tangent: Any
    power_end: Any
    random: Any
    id: Any
    generation: Any

    def __len__(self) -> int:
        """Return the number of beams."""
        return int(dr.width(self.start))

    def __repr__(self) -> str:
        return f"Beams({len(self):,})"

    def arrays(self) -> dict[str, npt.NDArray[np.float32]]:
        """Return all that is set as NumPy arrays, (N, 3) or (N,)."""
        present = {name: getattr(self, name) for name in (*_REQUIRED, *_OPTIONAL)}
        return {
            name: np.ascontiguousarray(value.numpy().T) if dr.depth_v(value) == 2 else value.numpy()
            for name, value in present.items()
            if value is not None
        }

    def numbers(self) -> Any:
        """Return the number of each light path, (N,), that all its pieces share; without any, a beam's place here."""
        return dr.arange(UInt32, len(self)) if self.id is None else UInt32(dr.abs(self.id))

    def identity(self) -> Any:
        """Return random number, number and generation of each beam, (N, 3)."""
        nothing = dr.zeros(Float, len(self))
        number = Float(self.numbers()) if self.id is None else self.id
        random = unit_float(hash32(self.numbers())) if self.random is None else self.random
        return Array3f(random, number, nothing if self.generation is None else self.generation)

    def take(self, index: Any) -> Beams:
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
    return int(dr.width(start)) if dr.is_jit_v(start) else len(np.atleast_2d(np.asarray(start)))


def _array(value: Any, name: str, count: int) -> Any:
    """Return `value` as Float or Array3f of width `count`, checked where it comes from outside."""
    vector = name in _VECTORS
    kind = Array3f if vector else Float
    if value is None:
        raise SceneError(f"Beams: {name} is not given: expected {'(N, 3)' if vector else '(N,)'} numbers")
    if dr.is_jit_v(value):
        result = kind(value)
        if dr.width(result) == 1 and count > 1:  # a number for all: broadcast, so that it can be gathered
            result = result + dr.zeros(Float, count)
        if dr.width(result) != count:
            raise SceneError(f"Beams: {name} has {dr.width(result)} entries: expected {count}, as start has")
        return result
    shape = (count, 3) if vector else (count,)
    try:
        numbers = np.broadcast_to(np.asarray(value, dtype=np.float32), shape)
    except (ValueError, TypeError):
        raise SceneError(f"Beams: {name} has shape {np.shape(value)}: expected {shape}") from None
    if not np.all(np.isfinite(numbers)):
        raise SceneError(f"Beams: {name} of beam {int(np.argwhere(~np.isfinite(numbers))[0][0])} is not finite")
    return to_vectors(numbers) if vector else to_float(numbers)


def _check_radii(beams: Beams) -> None:
    if len(beams) and bool(
        dr.any((beams.radius_start < 0) | (beams.radius_end < 0) | (beams.radius_start + beams.radius_end <= 0))
    ):
        raise SceneError("Beams: expected radii that are not negative, and not both of a beam zero")
