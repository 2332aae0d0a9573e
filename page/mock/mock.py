"""A stand-in for the studio's server, to work on the page without a renderer.

It speaks the studio's protocol and draws two beams that depend on a few of the values. It needs starlette, uvicorn,
websockets, pillow and numpy; `python page/mock/mock.py [PORT]` serves the built page.
"""
# ruff: noqa: D102, D103

from __future__ import annotations

import asyncio
import contextlib
import copy
import io
import json
import struct
import sys
import time
from pathlib import Path

import numpy as np
import uvicorn
from PIL import Image
from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.responses import FileResponse, Response
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.websockets import WebSocketDisconnect

PAGE = Path(__file__).parents[2] / "src/photonbeams/studio/page"
CSP = (
    "default-src 'self'; img-src 'self' blob: data:; style-src 'self' 'unsafe-inline'; "
    "connect-src 'self' ws://127.0.0.1:* ws://localhost:*"
)
KEY, FILL, FOG = "/World/Light/Key", "/World/Light/Fill", "/World/Fog"
SHAFT, DUST = "/World/Looks/Shaft", "/World/Looks/Dust"
PLANNED = 16
PRESETS = {"Ember": [[1, 0.9, 0.7], [1, 0.4, 0.1], [0.3, 0.05, 0.2]], "Ice": [[1, 1, 1], [0.4, 0.8, 1], [0, 0.2, 0.6]]}


def control(path, label, section, kind, default, doc="", **more):
    base = {"path": path, "label": label, "section": section, "kind": kind, "value": default, "default": default}
    rest = {"authored": False, "min": None, "max": None, "soft": None, "choices": None, "doc": doc, "unit": ""}
    return base | rest | more


def light(path, color):
    return [
        control(f"{path}.visibility", "Visibility", "Light", "choice", "inherited", choices=["inherited", "invisible"]),
        control(f"{path}.inputs:intensity", "Intensity", "Light", "number", 1.0, "How bright.", min=0, soft=[0, 10]),
        control(f"{path}.inputs:color", "Color", "Light", "color", color, "The light's colour."),
        control(f"{path}.inputs:exposure", "Exposure", "Light", "number", 0.0, soft=[-5, 5], unit="stops"),
        control(f"{path}.inputs:angle", "Spread", "Light", "number", 20.0, min=0, max=90, soft=[0, 90], unit="°"),
        control(f"{path}.photonbeams:count", "Beams", "Beams", "integer", 1024, min=1, max=1 << 20, soft=[1, 8192]),
        control(f"{path}.photonbeams:beams", "Sends beams", "Beams", "bool", True, "Off: it lights surfaces alone."),
        control(f"{path}.photonbeams:group", "Light group", "Beams", "text", path.rsplit("/", 1)[1].lower()),
        control(
            f"{path}.light:link", "Lights only", "Links", "paths", [], choices=["/World/Door", "/World/Floor", FOG]
        ),
        control(f"{path}.inputs:texture", "Texture", "Light", "asset", ""),
    ]


def look(path):
    ramp = f"{path}.photonbeams:along:ramp"
    value = {"knots": [0, 0.4, 1], "colors": [[1, 0.8, 0.5], [1, 0.3, 0.1], [0.1, 0.1, 0.6]], "interpolation": "linear"}
    empty = {"knots": [], "colors": [], "interpolation": "linear"}
    joins = ["none", "linear", "smooth", "catmullRom", "monotone"]
    parts = {part: f"{ramp}:{part}" for part in ("knots", "colors", "interpolation")}
    falloffs = ["physical", "none", "exponential", "power", "polynomial"]
    return [
        control(f"{path}.photonbeams:along:falloff", "Falloff", "Along", "choice", "physical", choices=falloffs),
        control(f"{path}.photonbeams:along:length", "Length", "Along", "number", 1.0, "How long.", min=0, unit="m"),
        control(f"{path}.photonbeams:along:coefficients", "Coefficients", "Along", "numbers", [1.0, -0.5]),
        control(ramp, "Ramp", "Along", "ramp", empty, "Colours along the beam.", parts=parts, choices=joins)
        | {"value": value, "authored": True},
        control(
            f"{path}.photonbeams:along:expression", "Expression", "Along", "expression", "smoothstep(0, 1, s)",
            "An expression that multiplies the factor, such as smoothstep(0, 1, s) * (0.6 + 0.4 * noise(4 * P)).",
        ),
        control(f"{path}.photonbeams:across:hardness", "Hardness", "Across", "number", 0.0, min=0, max=1, soft=[0, 1]),
    ]  # fmt: skip


def scene():
    medium = [
        control(
            f"{FOG}.inputs:density", "Density", "Medium", "number", 0.2, "How thick the fog is.", min=0, soft=[0, 2]
        ),
        control(f"{FOG}.inputs:albedo", "Albedo", "Medium", "color", [0.9, 0.9, 0.9]),
        control(f"{FOG}.inputs:g", "Anisotropy", "Medium", "number", 0.0, min=-0.99, max=0.99, soft=[-0.99, 0.99]),
    ]

    def group(path, kind, of, controls, **more):
        return {"path": path, "kind": kind, "label": path.rsplit("/", 1)[1], "type": of, "controls": controls} | more

    return {
        "type": "scene", "name": "keyhole.usda", "cameras": ["/World/Camera", "/World/Flight"], "frames": [1001, 1048],
        "fps": 24, "layers": ["rgba", "beams", "surface", "depth"], "displays": ["sRGB", "Raw"], "focal": 0.9,
        "pose": [1, 0, 0, 0, 0, 1, 0, 1, 0, 0, 1, 6, 0, 0, 0, 1], "up": "Y", "stereo": None, "pair": False,
        "interaxial": 0.065, "presets": [{"name": f"{factor}-{label.lower()}", "label": label, "factor": factor}
                                         for factor in ("look", "along", "across") for label in PRESETS],
        "controls": [
            group(KEY, "light", "RectLight", light(KEY, [1.0, 0.9, 0.7]), uses=[SHAFT]),
            group(FILL, "light", "SphereLight", light(FILL, [0.3, 0.5, 2.4]), uses=[DUST]),
            group(FOG, "medium", "Homogeneous", medium),
            group(SHAFT, "look", "BeamLook", look(SHAFT)),
            group(DUST, "look", "BeamLook", look(DUST)),
        ],
    }  # fmt: skip


class Session:
    """The scene's values and their history, shared by all pages."""

    def __init__(self):
        self.scene = scene()
        self.base, self.authored, self.defaults = {}, {}, {}
        for each in (c for g in self.scene["controls"] for c in g["controls"]):
            for part in each.get("parts", {"": each["path"]}):
                path = each["parts"][part] if part else each["path"]
                self.base[path] = each["value"][part] if part else each["value"]
                self.defaults[path] = each["default"][part] if part else each["default"]
                self.authored[path] = each["authored"]
        self.values, self.edits, self.undone, self.done, self.step = {}, {}, [], [], None
        self.saved, self.version, self.changed, self.problem, self.pages = True, 1, time.monotonic(), None, set()
        self.restored = "--restored" in sys.argv
        self.refresh()

    def refresh(self):
        self.values = dict(self.base)
        for path, value in self.edits.items():
            self.values[path] = self.defaults[path] if value is None else value
        self.version += 1
        self.changed = time.monotonic()
        self.problem = None
        for path, text in self.values.items():
            if path.endswith(":expression") and (wrong := mistake(text)):
                column, reason = wrong
                self.problem = {"text": f'expression "{text}": {reason}', "path": path, "column": column}

    def edit(self, values, step):
        if unknown := [path for path in values if path not in self.values]:
            raise ValueError(f"There is no {unknown[0]}.")
        if step is None or step != self.step:
            self.done.append(dict(self.edits))
        self.step, self.undone, self.saved = step, [], False
        self.edits.update(values)
        self.refresh()

    def travel(self, back):
        source, target = (self.done, self.undone) if back else (self.undone, self.done)
        if source:
            target.append(self.edits)
            self.edits, self.step, self.saved = source.pop(), None, False
            self.refresh()

    def message(self):
        own = {
            path: self.edits[path] is not None if path in self.edits else self.authored[path] for path in self.values
        }
        history = {"canUndo": bool(self.done), "canRedo": bool(self.undone), "saved": self.saved,
                   "restored": self.restored}  # fmt: skip
        return {"type": "values", "values": self.values, "authored": own} | history

    def full_scene(self):
        result = copy.deepcopy(self.scene)
        own = self.message()["authored"]
        for each in (c for g in result["controls"] for c in g["controls"]):
            parts = each.get("parts")
            each["value"] = {k: self.values[p] for k, p in parts.items()} if parts else self.values[each["path"]]
            each["authored"] = any(own[p] for p in parts.values()) if parts else own[each["path"]]
        return result


def mistake(text):
    depth = []
    for column, character in enumerate(text, 1):
        if character in "@#$?!":
            return column, f"{character} has no meaning here"
        if character == "(":
            depth.append(column)
        elif character == ")" and (not depth or not depth.pop()):
            return column, ") closes nothing: expected ( before it"
    return (depth[-1], "( is never closed: expected ) after it") if depth else None


def draw(session, show, passes, scale):
    v, (w, h) = session.values, show.get("size", [480, 270])
    h = min(h, round(w * 9 / 16))
    w, h = max(int(min(w, h * 16 / 9) * scale), 8), max(int(h * scale), 4)
    y, x = np.mgrid[0:h, 0:w] / [[[h]], [[w]]]
    pose = show.get("pose") or session.scene["pose"]
    x, y = x + 0.15 * pose[3], y - 0.15 * (pose[7] - 1)
    picture = np.full((h, w, 3), 0.01) + 0.02 * (1 - y)[..., None]
    phase = 0.2 * np.sin((show.get("frame", 1001) - 1001) / 8)
    solo = show.get("solo") or [KEY, FILL]
    for path, at, name in ((KEY, 0.35, SHAFT), (FILL, 0.65, DUST)):
        if path not in solo or v[f"{path}.visibility"] == "invisible":
            continue
        knots, colors = v[f"{name}.photonbeams:along:ramp:knots"], v[f"{name}.photonbeams:along:ramp:colors"]
        s = np.clip(x, 0, 1)
        ramp = np.stack([np.interp(s, knots, [c[i] for c in colors]) for i in range(3)], -1) if knots else 1.0
        across = np.exp(-(((y - at - phase * (x - 0.5)) / (0.03 + 0.1 * x)) ** 2))
        power = v[f"{path}.inputs:intensity"] * 2 ** v[f"{path}.inputs:exposure"]
        picture += (
            power * across[..., None] * ramp * np.array(v[f"{path}.inputs:color"]) * 2 * v[f"{FOG}.inputs:density"]
        )
    picture += np.random.default_rng(passes).normal(0, 0.05 / passes**0.5, picture.shape)
    picture = np.clip(picture * 2 ** show.get("exposure", 0), 0, 1)
    file = io.BytesIO()
    Image.fromarray((255 * picture ** (1 / 2.2)).astype(np.uint8)).save(file, "JPEG" if scale < 1 else "PNG")
    header = {
        "version": session.version, "passes": passes, "planned": PLANNED, "width": w, "height": h,
        "layer": show.get("layer", "rgba"), "scale": scale, "mime": "image/jpeg" if scale < 1 else "image/png",
    }  # fmt: skip
    text = json.dumps(header).encode()
    return struct.pack("<I", len(text)) + text + file.getvalue()


def pixel(at):
    a, b = 0.4 + 0.3 * at[0], 1.6
    s = np.linspace(a, b, 65)

    def f(t):
        return np.exp(-1.3 * t) / (0.15 + (t - 0.9) ** 2) * (0.4 + at[1])

    exact = float(np.trapezoid(f(np.linspace(a, b, 20001)), dx=(b - a) / 20000))
    rules = {"gauss": [], "riemann": []}
    for n in range(1, 7):
        p, weight = np.polynomial.legendre.leggauss(n)
        rules["gauss"].append(((b - a) / 2 * p + (a + b) / 2, weight * (b - a) / 2))
        rules["riemann"].append((a + (np.arange(n) + 0.5) * (b - a) / n, np.full(n, (b - a) / n)))
    ray = {"estimator": "2D", "interval": [a, b], "radius": [0.1, 0.35], "length": 2.0, "s": s.tolist(),
           "integrand": f(s).tolist()}  # fmt: skip
    for name, rule in rules.items():
        ray[name] = {
            "n": list(range(1, 7)), "points": [p.tolist() for p, _ in rule], "values": [f(p).tolist() for p, _ in rule],
            "error": [abs(float(f(p) @ w) / exact - 1) for p, w in rule],
        }  # fmt: skip
    layers = {
        "rgba": [0.421, 0.30021, 0.1, 1.0],
        "beams": [0.4, 0.29, 0.09],
        "surface": [0.021, 0.01021, 0.01],
        "depth": [3.2],
    }
    beams = [{"light": KEY, "group": "key", "radiance": [0.3, 0.2, 0.05], "share": 0.71},
             {"light": FILL, "group": "fill", "radiance": [0.05, 0.06, 0.3], "share": 0.22}]  # fmt: skip
    return {"type": "pixel", "at": at, "layers": layers, "beams": beams, "ray": ray}


SESSION = Session()


async def send_pictures(socket, show, signal):
    """Send a preview at once, then pass after pass, and begin again when something has changed."""
    while True:
        signal.clear()
        version, begun, passes = SESSION.version, time.monotonic(), 0
        while passes < PLANNED and version == SESSION.version and not signal.is_set():
            if show.get("paused"):
                await asyncio.sleep(0.05)
                continue
            if not SESSION.problem:
                passes += 1
                await socket.send_bytes(draw(SESSION, show, passes, 0.25 if passes == 1 else 1.0))
            state = {"type": "state", "version": SESSION.version, "passes": passes, "planned": PLANNED}
            seconds = time.monotonic() - begun
            busy = passes < PLANNED and not SESSION.problem
            await socket.send_json(state | {"seconds": seconds, "busy": busy, "problem": SESSION.problem})
            if SESSION.problem:
                break
            await asyncio.sleep(0.01 if passes == 1 else 0.12)
        while version == SESSION.version and not signal.is_set():
            await asyncio.sleep(0.02)


async def render(socket, message):
    frames = message["frames"]
    total = message["passes"] * (frames[1] - frames[0] + 1 if frames else 1)
    for done in range(total + 1):
        file = "/result/keyhole.exr?token=mock" if done == total else None
        await socket.send_json({"type": "render", "done": done, "of": total, "file": file, "problem": None})
        await asyncio.sleep(0.05)


async def session(socket):
    await socket.accept()
    SESSION.pages.add(socket)
    show, signal, rendering = {}, asyncio.Event(), None
    await socket.send_json(SESSION.full_scene())
    await socket.send_json(SESSION.message())
    pictures = asyncio.create_task(send_pictures(socket, show, signal))
    try:
        while True:
            message = json.loads(await socket.receive_text())
            kind = message.pop("type")
            if kind == "show":
                show.update(message)
                SESSION.version += 1
                signal.set()
            elif kind == "inspect":
                await socket.send_json(pixel(message["at"]))
            elif kind == "render":
                rendering = asyncio.create_task(render(socket, message))
            elif kind == "cancel" and rendering:
                rendering.cancel()
            else:
                try:
                    if kind == "set":
                        SESSION.edit(message["values"], message["step"])
                    elif kind == "apply":
                        ramp = f"{SHAFT}.photonbeams:along:ramp"
                        colors = PRESETS[message["preset"].partition("-")[2].capitalize()]
                        SESSION.edit({f"{ramp}:knots": [0, 0.5, 1], f"{ramp}:colors": colors}, None)
                        await socket.send_json({"type": "applied", "path": message["path"], "look": SHAFT})
                    elif kind in ("undo", "redo"):
                        SESSION.travel(kind == "undo")
                    elif kind in ("revert", "discard"):
                        SESSION.edit({}, None)
                        SESSION.edits, SESSION.restored = {}, False
                        SESSION.refresh()
                    elif kind == "save":
                        SESSION.saved, SESSION.restored = True, False
                except ValueError as error:
                    await socket.send_json({"type": "refused", "text": str(error)})
                for page in list(SESSION.pages):
                    await page.send_json(SESSION.message())
    except WebSocketDisconnect:
        pass
    finally:
        SESSION.pages.discard(socket)
        for task in (pictures, rendering):
            if task:
                task.cancel()
                with contextlib.suppress(asyncio.CancelledError, Exception):
                    await task


class Policy:
    """Adds the studio's content security policy."""

    def __init__(self, app):
        self.app = app

    async def __call__(self, scope, receive, send):
        async def with_policy(message):
            if message["type"] == "http.response.start":
                message["headers"] = [*message["headers"], (b"content-security-policy", CSP.encode())]
            await send(message)

        await self.app(scope, receive, with_policy)


async def index(request):
    return FileResponse(PAGE / "index.html")


async def preset(request):
    colors = np.array(PRESETS[request.path_params["name"].removesuffix(".png").partition("-")[2].capitalize()])
    row = np.stack([np.interp(np.linspace(0, 1, 144), [0, 0.5, 1], channel) for channel in colors.T], -1)
    file = io.BytesIO()
    Image.fromarray((255 * np.repeat(row[None], 60, axis=0)).astype(np.uint8)).save(file, "PNG")
    return Response(file.getvalue(), media_type="image/png")


async def result(request):
    return Response(b"no picture, just a mock", media_type="image/x-exr")


app = Starlette(
    routes=[
        Route("/", index),
        Route("/result/{name}", result),
        Route("/presets/{name}", preset),
        WebSocketRoute("/session", session),
        Mount("/assets", StaticFiles(directory=PAGE / "assets", check_dir=False)),
    ],
    middleware=[Middleware(Policy)],
)

if __name__ == "__main__":
    uvicorn.run(app, host="127.0.0.1", port=int(sys.argv[1]) if len(sys.argv) > 1 else 8765, log_level="warning")
