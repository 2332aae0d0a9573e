"""Render the frames of a shot one after another: name their files, skip those that exist, report what was done."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from .flags import ContentFlags
from .groups import usage_errors
from .outputs import Output, check_different, check_placeholders, check_product, snapshots_of
from .progress import bar, counted, frame_line, report_line, summary_lines

if TYPE_CHECKING:
    from ..render.passes import Statistics
    from ..shot import Shot
    from ..usd.settings import RenderProduct
    from .request import RenderRequest


class FrameError(Exception):
    """A render ended at a `frame`, "frame 7: " or "", after it had `done` what a message says; its cause says why."""

    def __init__(self, frame: str, written: int, kept: str | None = None) -> None:
        super().__init__(frame, written, kept)
        self.frame = frame
        before = f"{counted(written, 'frame')} {'was' if written == 1 else 'were'} written" if written else None
        self.done = ", ".join(filter(None, (before, kept))) or "nothing was written"


@dataclass(frozen=True)
class Task:
    """A frame to render: its number (None for the stage's default), its name and its files."""

    number: float | None
    name: str
    outputs: tuple[Output, ...]

    def exists(self) -> bool:
        """Return whether all files of the frame exist."""
        return bool(self.outputs) and all(output.exists() for output in self.outputs)

    @property
    def files(self) -> list[Path]:
        """The paths of its outputs."""
        return [output.path for output in self.outputs]

    @property
    def written(self) -> list[Path]:
        """The paths of the files that rendering it writes: its outputs, and snapshots, which are removed again."""
        return [*self.files, *(each.path for each in snapshots_of(self.outputs))]


def frame_numbers(text: str | None, outputs: Sequence[Output]) -> list[float | None]:
    """Return the frames that `--frames` asks for, None for the stage's start; check that their outputs differ."""
    from ..usd.layers.frames import decimals, parse_frames

    if text is None:
        return [None]
    with usage_errors(f"--frames is {text}: "):
        numbers = parse_frames(text)
    check_placeholders(outputs, len(numbers), max(map(decimals, numbers)))
    return [*numbers]


def tasks_of(
    shot: Shot, numbers: Iterable[float | None], outputs: Sequence[Output], products: Sequence[RenderProduct],
    *, anywhere: bool = False, single_part: bool = False,
) -> list[Task]:  # fmt: skip
    """Return the frames to render, each with the files that flags name or, without such flags, its render products.

    `anywhere` says whether render products may lie outside the working folder, and `single_part` whether each is
    written in one part.
    """
    from ..runtime.files import place_of
    from ..usd.common.reading import file_of
    from ..usd.settings import product_file

    tasks = []
    owners: dict[object, str] = {}
    for number in numbers:
        frame = shot.subject.number(number)
        files = outputs or [
            Output(
                product_file(shot.stage, each, shot.time(number)),
                variables=each.variables,
                single_part=each.single_part or single_part,
                deep=each.deep,
            )
            for each in products
        ]
        task = Task(number, f"{frame:.10g}", tuple(each.numbered(frame) for each in files))
        for product, path in zip([] if outputs else products, task.files, strict=False):
            check_product(path, f"{file_of(shot.stage)}: {product.path}.productName", anywhere=anywhere)
        check_different(task.written)
        for path in task.written:
            owner = owners.setdefault(place_of(path), task.name)
            if owner is not task.name:
                raise typer.BadParameter(
                    f"{path} is the output of the frames {owner} and {task.name}: expected one run of # in its "
                    "name, or a name that changes with the frame"
                )
        tasks.append(task)
    return tasks


def opened_frames(
    scene: Path, camera: str | None, target: Output, content: ContentFlags, **programs: Any
) -> tuple[Shot, list[Task]]:
    """Return the shot of a stage from which other files are written, and its frames; `programs` are those of `Shot`."""
    from ..images.color_spaces import REC709
    from ..shot import Shot
    from ..usd.layers.frames import check_frames
    from ..usd.stage import open_stage

    numbers = frame_numbers(content.frames, [target])
    layers, selection = content.layers, content.selection.selection()
    stage = open_stage(  # other files name no space, and are then read as linear Rec. 709
        scene, layers.session_layer or (), layers.overrides or (), selection=selection, working_space=REC709
    )
    check_frames(stage, [each for each in numbers if each is not None])
    shot = Shot(stage, camera, medium=content.fog.on(stage), **programs)
    return shot, tasks_of(shot, numbers, [target], ())


def render_frames(
    tasks: Sequence[Task], passes: int | None, request: RenderRequest,
    finish: Callable[[Task, Callable[..., None]], Statistics], check: Callable[[], None],
) -> None:  # fmt: skip
    """Render frames as a request asks, and report what was done; raise FrameError from an error that ends this.

    Each has `passes` passes, None if that is not known yet. `finish` renders and writes a frame; its second argument is
    called with the number of passes done and a note on them. `check` raises KeyboardInterrupt if Ctrl-C was pressed.
    """
    begin, several, shown = time.perf_counter(), len(tasks) > 1, request.shown
    done: list[tuple[Task, Statistics]] = []

    with bar(shown.progress, shown.quiet, len(tasks), passes) as show:

        def advance(index: int, name: str, passes: int, note: str = "") -> None:
            check()
            show(index, name, passes, note)

        for index, task in enumerate(tasks):
            try:
                check()
                # Ask again for each frame: another machine may have rendered it by now.
                if request.files.skip_existing and task.exists():
                    shown.say(f"frame {task.name}: skipped, all its files exist")
                    continue
                begun = time.perf_counter()
                statistics = finish(task, partial(advance, index, task.name))
                done.append((task, statistics))
                if several:
                    shown.say(frame_line(task.name, statistics, task.files, time.perf_counter() - begun))
            except (Exception, KeyboardInterrupt) as error:
                kept = getattr(error, "done", None)
                raise FrameError(f"frame {task.name}: " if several else "", len(done), kept) from error
    seconds = time.perf_counter() - begin
    if several or not done:
        files = sum(len(task.outputs) for task, _ in done)
        shown.say(report_line([each for _, each in done], len(tasks) - len(done), files, seconds))
    else:
        shown.say("\n".join(summary_lines(done[0][1], tasks[0].files, seconds, passes)))


def plan(what: str, tasks: Sequence[Task], todo: Sequence[Task], layers: Sequence[str]) -> str:
    """Return lines about what a render would do."""
    lines = [f"Ready to render: {what}"]
    if len(tasks) > 1 or not todo:
        lines.append(f"would render {len(todo):,} of {counted(len(tasks), 'frame')}")
    files = " to ".join(", ".join(map(str, task.files)) for task in dict.fromkeys([*todo[:1], *todo[-1:]]))
    lines.append(f"would write {files or 'nothing'}, with the layers {', '.join(layers)}")
    return "\n".join(lines)
