"""Read IES files (IESNA LM-63 of all years): the angles and intensities of a light's profile.

The angles are converted to photometric type C, which most files have: vertical angles from straight down, and
horizontal angles around. Types A and B, for headlights and floodlights, have another polar axis; as in Cycles and
hdEmbree, that axis becomes the light's own.
"""

from __future__ import annotations

import re
from contextlib import suppress
from dataclasses import replace
from functools import lru_cache

import numpy as np

from ...scene import Array, Profile, shown
from ..common.openusd import Sdf, Usd
from ..common.reading import Reading
from ..common.textures import asset_content, resolved, stamp

_NAME = "inputs:shaping:ies:file"
_MOST_ANGLES = 10_000
_MOST_BYTES = 1 << 24
_TYPE_C, _TYPE_B, _TYPE_A = 1, 2, 3
_NO_FACTOR = 1995  # the first LM-63 in which the twelfth number is no factor
_MARK = "\xef\xbb\xbf"  # the byte order mark of UTF-8
_ENDS = "\x00\x1a \t\r\n"  # DOS ends files with \x1a


def read_profile(reading: Reading, prim: Usd.Prim) -> Profile | None:
    """Return a light's IES profile, or None, with a warning if it names a file that cannot be read."""
    asset = reading.value(prim, _NAME)
    if not isinstance(asset, Sdf.AssetPath) or not asset.path:
        return None
    path = resolved(reading, asset)
    if not path:
        reading.lack(prim, f"names {asset.path}, which is not there: the light shines without its IES profile", _NAME)
        return None
    scale = reading.number(prim, "inputs:shaping:ies:angleScale", 0.0)
    normalize = reading.flag(prim, "inputs:shaping:ies:normalize", False)
    try:
        return _profile(path, stamp(path), scale, normalize)
    except ValueError as error:
        text = f"names {path}, which is not an IES profile ({error}): the light shines without it"
        reading.lack(prim, text, _NAME)
        return None


# One object for all times of a shutter, so that its table is on the device only once.
@lru_cache(maxsize=64)
def _profile(path: str, _stamp: tuple[int, int], scale: float, normalize: bool) -> Profile:
    result = parse(asset_content(path, _MOST_BYTES).decode("latin-1"))
    return replace(result.normalized() if normalize else result, angle_scale=scale)


def parse(text: str) -> Profile:
    """Return the profile in the text of an IES file.

    Raises
    ------
    ValueError
        The text is not that of an IES file; the message is one clause.
    """
    text = text.removeprefix(_MARK).replace("\r", "\n")  # which may end lines alone
    found = re.search(r"^\s*TILT\s*=(.*)$", text, re.IGNORECASE | re.MULTILINE)
    if found is None:
        raise ValueError("it has no line TILT=")
    tilted, data = found[1].strip().upper() == "INCLUDE", text[found.end() :].rstrip(_ENDS)
    numbers = _numbers(data, tilted)
    ballast, photometric, _ = numbers.lamp
    # Since 1995 the photometric factor is for future use, and since 2019 it tells where the file comes from.
    year = re.match(r"\s*IES(?:NA)?[:\s]*LM-63-(\d{4})", text, re.IGNORECASE)
    if year and int(year[1]) >= _NO_FACTOR:
        photometric = 1.0
    vertical, horizontal, kind = numbers.vertical, numbers.horizontal, numbers.kind
    intensity = numbers.intensity * (numbers.multiplier * ballast * photometric)
    if kind == _TYPE_C:
        return Profile(vertical, *_all_around(horizontal, intensity))
    if kind == _TYPE_B:
        return Profile(*_about_horizontal_axis(vertical, horizontal, intensity))
    if kind == _TYPE_A:
        return Profile(*_about_vertical_axis(vertical, horizontal, intensity))
    raise ValueError(f"its photometric type is {kind:g}: expected 1, 2 or 3")


def _numbers(data: str, tilted: bool) -> _Numbers:
    """Return the numbers of a file, in which a comma is a space or, if that makes no sense, a decimal point."""
    try:
        return _Numbers(data.replace(",", " "), tilted)
    except ValueError as error:
        with suppress(ValueError):
            return _Numbers(data.replace(",", "."), tilted)
        raise error from None


class _Numbers:
    """The numbers below a file's line TILT=; ValueError for another count, or angles that do not ascend."""

    def __init__(self, text: str, tilted: bool) -> None:
        self._words = text.split()
        self._next = 0
        if tilted:
            self.take(1)
            self.take(2 * self.count("angles of tilt"))
        _, _, self.multiplier = self.take(3)
        rows, columns = self.count("vertical angles"), self.count("horizontal angles")
        (self.kind,) = self.take(1)
        self.take(4)  # the units of the luminaire's size, and its size
        self.lamp = self.take(3)
        self.vertical, self.horizontal = self.take(rows), self.take(columns)
        if not (np.all(np.diff(self.vertical) > 0) and np.all(np.diff(self.horizontal) > 0)):
            raise ValueError("its angles do not ascend")
        self.intensity = self.take(rows * columns).reshape(columns, rows)
        if rest := len(self._words) - self._next:
            raise ValueError(f"it has {rest} more numbers than {rows} vertical and {columns} horizontal angles need")

    def take(self, count: int) -> Array:
        """Return the next numbers."""
        words = self._words[self._next : self._next + count]
        if len(words) < count:
            raise ValueError(f"it ends after {len(self._words)} numbers")
        self._next += count
        found = np.array([_number(word) for word in words])
        if not np.all(np.isfinite(found)):
            raise ValueError("it has numbers that are not finite")
        return found

    def count(self, what: str) -> int:
        """Return the next number, which is a count."""
        value = float(self.take(1)[0])
        if not (value == int(value) and 1 <= value <= _MOST_ANGLES):
            raise ValueError(f"it has {value:g} {what}")
        return int(value)


def _number(word: str) -> float:
    try:
        return float(word)
    except ValueError:
        raise ValueError(f"it has {shown(word)} where a number is expected") from None


def _mirrored_at_end(angles: Array, values: Array) -> tuple[Array, Array]:
    """Mirror angles, and their values, at the last of them."""
    return np.append(angles, 2 * angles[-1] - angles[-2::-1]), np.concatenate([values, values[-2::-1]])


def _mirrored_at_begin(angles: Array, values: Array) -> tuple[Array, Array]:
    """Mirror angles, and their values, at the first of them."""
    mirrored, others = _mirrored_at_end(angles[::-1], values[::-1])
    return mirrored[::-1], others[::-1]


def _mirrored(angles: Array, values: Array) -> tuple[Array, Array]:
    """Mirror angles that begin at 0, and their values, to the angles below 0."""
    return (angles, values) if abs(angles[0]) > 1e-4 else _mirrored_at_begin(angles, values)


def _about_horizontal_axis(vertical: Array, horizontal: Array, intensity: Array) -> tuple[Array, Array, Array]:
    """Convert type B to type C: the angles change places, and −90 to 90 degrees become 0 to 180."""
    around, values = _mirrored(vertical, intensity.T)
    down, turned = _mirrored(horizontal, values.T)
    return down + 90, *_dark_beside(around + 90, turned.T)


def _about_vertical_axis(vertical: Array, horizontal: Array, intensity: Array) -> tuple[Array, Array, Array]:
    """Convert type A to type C: horizontal angles from −90 to 90 degrees become 270 to 90."""
    around, values = _mirrored(horizontal, intensity)
    return vertical + 90, *_dark_beside(180 - around[::-1], values[::-1])


def _dark_beside(angles: Array, values: Array) -> tuple[Array, Array]:
    """Extend horizontal angles to 0 to 360, without light outside the given ones."""
    step, dark = 1e-3, np.zeros_like(values[:1])
    if angles[0] > step:
        angles, values = np.append([0.0, angles[0] - step], angles), np.concatenate([dark, dark, values])
    if angles[-1] < 360 - step:
        angles, values = np.append(angles, [angles[-1] + step, 360.0]), np.concatenate([values, dark, dark])
    return angles, values


def _all_around(angles: Array, values: Array) -> tuple[Array, Array]:
    """Extend horizontal angles of type C to 0 to 360: the file may have a quarter, a half or a single angle."""
    if len(angles) == 1:
        return np.zeros(1), values

    def span(first: float, last: float) -> bool:
        return np.allclose(angles[[0, -1]], [first, last])

    if span(90, 270):  # symmetric about the plane of 90 and 270 degrees
        around, mirrored = _mirrored_at_begin(angles, values)
        angles = np.unique([0.0, 360.0, *(around % 360)])
        return angles, np.stack([np.interp(angles, around, each, period=360) for each in mirrored.T], axis=1)
    if span(0, 90):
        angles, values = _mirrored_at_end(angles, values)
    if span(0, 180):
        return _mirrored_at_end(angles, values)
    if span(0, 360):
        return angles, values
    if angles[-1] < 360 and angles[0] < 1e-3:  # against the standard: 360, which equals 0, is missing
        return np.append(angles, 360.0), np.concatenate([values, values[:1]])
    raise ValueError(f"its horizontal angles go from {angles[0]:g} to {angles[-1]:g}")
