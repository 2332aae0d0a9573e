"""What the comparison and its workers say to each other, one JSON object a line."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(frozen=True)
class Request:
    """Render a scene with a seed, and write the picture, (H, W, 3), as .npy; count kernels and launches if wanted."""

    scene: str
    seed: int
    file: str
    counts: bool = False


@dataclass(frozen=True)
class Reply:
    """What a render cost, or the `error` by which it failed.

    `digests` are those of the layers' bits, `seconds` of processor time, `memory` in bytes above what the process had
    before, `kernels` those that the process did not have before.
    """

    digests: dict[str, str] = field(default_factory=dict)
    seconds: float = 0.0
    memory: int | None = None
    launches: int = 0
    kernels: int = 0
    error: str | None = None
