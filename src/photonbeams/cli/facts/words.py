"""Numbers of stages in words."""

from __future__ import annotations

from collections.abc import Iterable

# Names of units, by their metres.
_UNITS = {1.0: "m", 0.01: "cm", 0.001: "mm", 1000.0: "km", 0.0254: "in", 0.3048: "ft"}


def triple(values: Iterable[float]) -> str:
    """Return numbers in a row, or one number if all are the same."""
    words = [f"{value:.4g}" for value in values]
    return words[0] if len(set(words)) == 1 else " ".join(words)


def units(length: float, meters: float) -> str:
    """Return a length in scene units: "4.71 units (m)", with the unit's name if it has one."""
    name = next((name for size, name in _UNITS.items() if abs(meters - size) < 1e-6 * size), "")
    return f"{float(f'{length:.3g}'):g} units" + (f" ({name})" if name else "")


def percent(fraction: float) -> str:
    """Return a fraction as "56 %", or as "all", "hardly any" or "none"."""
    if fraction >= 0.995 or fraction < 1e-4:
        return "all" if fraction > 0.5 else "hardly any" if fraction > 0 else "none"
    return f"{100 * fraction:.2g} %"
