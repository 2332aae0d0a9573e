"""Streams of samples: a number for each random decision, so that no two decisions of a path use the same samples."""

from __future__ import annotations

from enum import IntEnum, unique


@unique
class Stream(IntEnum):
    """Random decisions, as part of the seed of their samples; see `samples.Samples` and `hashing.hash32`."""

    # Light paths.
    FLIGHT = 1
    LOBE = 2
    TURN = 3
    ROULETTE = 4
    ROUNDING = 5
    WHICH_OPENING = 6
    WHETHER_AIMED = 7
    POINT_OF_OPENING = 8
    FILTER = 9
    # Rays of cameras and sensors.
    LENS = 101
    TIME = 102
    PIXEL = 104
    LATTICE = 105
    HOLDOUT = 106
    # Direct light on surfaces from the lamps of a stage: the number of their group follows, and that of the lamp in it.
    REFLECTION = 201
    LAMP = 202
    # Direct light on surfaces from Mitsuba's emitters.
    EMITTER = 211
    EMITTER_LOBE = 212
    EMITTER_TURN = 213
    EMITTER_SHADOW = 214
    # Camera paths.
    BRANCH_LOBE = 301
    BRANCH_TURN = 302
    BRANCH_ROULETTE = 303
    SEGMENT = 304
    CUTOUT = 305
    GLOW = 306
    BOUNCE = 307
    BOUNCE_TURN = 308
    BOUNCE_WHICH_EMITTER = 310
    BOUNCE_TOWARD = 311
    VIRTUAL = 309
    # Light of domes that media scatter once.
    SCATTERING_POINT = 401
    PHASE_LOBE = 402
    PHASE_TURN = 403
    DOME = 404
    # Paths from the camera.
    PATH_FLIGHT = 501
    PATH_WHICH_EMITTER = 502
    PATH_EMITTER = 503
    PATH_LOBE = 504
    PATH_TURN = 505
    PATH_SHADOW = 506
    PATH_ROULETTE = 507
    PATH_CUTOUT = 508
    PATH_TRACKING = 509
    PATH_VIRTUAL = 510
    # Light that fog scatters along the segments of walks.
    FOG = 601
    FOG_FLIGHT = 602
    TOWARD = 603
    FOG_FIRST_EMITTER = 604
