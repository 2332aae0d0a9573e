"""Find the emission samples of given rays: invert an emitter's map from samples to rays by Newton's method."""

from __future__ import annotations

import drjit as dr
import numpy as np

from ...numerics.arrays import to_numpy
from ...numerics.sampling import pairs, sobol_points
from ...scene import Array
from ..emission import PathEmitter

# Number of rays among which the nearest is the first guess, number of iterations, and the step of finite differences.
_GUESSES, _STEPS, _DIFFERENCE = 1 << 12, 6, 1e-3
# How near to a face of the unit cube a search may end that begins again at the opposite face, and which fraction of all
# searches have to end there: few do so at the rim of a lamp, half of them at a seam.
_FACE, _MANY = 0.02, 0.1
# A ray is found if it misses by less than this, in units of the spread of the points, or by what rounding does to rays
# that begin so far away: a few units in the last place of single precision.
_NEAR, _ROUNDING = 2e-3, 4 * 2.0**-23


def samples_of(emitter: PathEmitter, point: Array, direction: Array) -> tuple[Array, Array]:
    """Return the emission samples of rays from an emitter, (N, 4), and which of them were found, (N,).

    The rays pass `point`, (N, 3), along `direction`, (N, 3). Maps from samples to rays are continuous but for seams,
    where a number goes from 1 back to 0, as angles around an axis do. Where many searches end at a face of the unit
    cube, they begin once more at the opposite one.
    """
    from scipy.spatial import cKDTree  # takes long to import

    size = max(float(np.sqrt(((point - point.mean(axis=0)) ** 2).sum(axis=1).mean())), 1e-6 * np.abs(point).max())

    def features(origin: Array, along: Array) -> Array:
        to = point.mean(axis=0) - origin
        return np.concatenate([origin + (to * along).sum(axis=1, keepdims=True) * along, size * along], axis=1)

    guesses = sobol_points(_GUESSES, 0, (_GUESSES,)).astype(np.float64)
    origin, along, _ = rays_of(emitter, guesses)
    known = np.isfinite(origin).all(axis=1) & np.isfinite(along).all(axis=1)
    _, nearest = cKDTree(features(origin[known], along[known])).query(features(point, direction))
    best, error, same = _searched(emitter, guesses[known][nearest], point, direction, size)
    near = max(_NEAR * size, _ROUNDING * float(np.abs(origin[known]).max(initial=0)))
    for axis in range(4):
        at_face = np.abs(best[:, axis] - 0.5) > 0.5 - _FACE
        lost = np.flatnonzero((error >= near) & at_face & ~same[:, axis])
        if len(lost) > _MANY * len(point):
            other = best[lost]
            other[:, axis] = np.clip(1 - other[:, axis], 0, 1 - 1e-6)
            other, missed, _ = _searched(emitter, other, point[lost], direction[lost], size)
            better = missed < error[lost]
            best[lost[better]], error[lost[better]] = other[better], missed[better]
    # Axes along which rays are the same, as for a point or for a sun without an angle, are sampled evenly.
    best = np.where(same, sobol_points(len(point), 1, (_GUESSES,)), best)
    return best.astype(np.float32), error < near


def _searched(
    emitter: PathEmitter, current: Array, point: Array, direction: Array, size: float
) -> tuple[Array, Array, Array]:
    """Return the samples that Newton's method finds, (N, 4), by how much they miss, and axes that change nothing."""
    best, error = current.copy(), np.full(len(point), np.inf)
    for _ in range(_STEPS):
        # One step of finite differences along each axis, inward at the edges of the cube.
        steps = np.where(current < 0.5, _DIFFERENCE, -_DIFFERENCE)
        places = np.concatenate([current, *(current + steps * np.eye(4)[axis] for axis in range(4))])
        missed = _missed(*rays_of(emitter, places)[:2], np.tile(point, (5, 1)), np.tile(direction, (5, 1)), size)
        here, *beside = np.split(missed, 5)
        norm = np.linalg.norm(here, axis=1)
        better = norm < error
        best, error = np.where(better[:, None], current, best), np.where(better, norm, error)
        slopes = np.stack([(each - here) / steps[:, axis, None] for axis, each in enumerate(beside)], axis=2)
        slopes, here = np.nan_to_num(slopes), np.nan_to_num(here)
        normal = np.swapaxes(slopes, 1, 2) @ slopes
        diagonal = np.einsum("nii->ni", normal)  # damped by Marquardt's rule, as rays may be the same all along an axis
        damping = (1e-6 * diagonal + 1e-12 * diagonal.max(axis=1, keepdims=True) + 1e-30)[:, :, None] * np.eye(4)
        step = np.linalg.solve(normal + damping, np.swapaxes(slopes, 1, 2) @ here[:, :, None])[:, :, 0]
        current = np.clip(current - np.clip(step, -0.2, 0.2), 0, 1 - 1e-6)
    return best, error, diagonal <= 1e-12 * diagonal.max(axis=1, keepdims=True)


def rays_of(emitter: PathEmitter, samples: Array) -> tuple[Array, Array, Array]:
    """Return origins and directions, (N, 3), of an emitter's rays for samples, (N, 4), and their flux, (N,).

    The flux is that of the brightest channel.
    """
    found = emitter.sample(*pairs(samples.astype(np.float32)))
    flux = dr.select(found.valid, found.flux, 0)
    dr.eval(found.origin, found.direction, flux)
    values = (np.broadcast_to(to_numpy(each), (3, len(samples))).T for each in (found.origin, found.direction, flux))
    origin, direction, flux = (each.astype(np.float64) for each in values)
    return origin, direction, np.nan_to_num(flux.max(axis=1), posinf=0)


def _missed(origin: Array, along: Array, point: Array, direction: Array, size: float) -> Array:
    """Return the vectors by which rays miss points and directions, (N, 6)."""
    to = point - origin
    aside = to - (to * along).sum(axis=1, keepdims=True) * along
    return np.concatenate([-aside, size * (along - direction)], axis=1)
