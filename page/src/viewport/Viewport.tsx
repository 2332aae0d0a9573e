/** The picture, fitted to the window, with the tools that work on it. */

import { type KeyboardEvent, type PointerEvent, useEffect, useLayoutEffect, useRef, useState } from "react";
import type { Area } from "../protocol";
import { picture, session, show } from "../session/session";
import { useStore } from "../session/store";
import { flipbook, pageOf } from "../time/flipbook";
import { useDragNavigation, useFlight, useWheel } from "./navigation";
import { Problem, StatusLine } from "./StatusLine";
import { inspectAt, view } from "./view";
import styles from "./viewport.module.css";
import { WipeLine } from "./WipeLine";

/** Larger pictures would take the server too long for a live view. */
const LARGEST = 2048;

export interface Box {
  left: number;
  top: number;
  width: number;
  height: number;
}

/** The largest box with an aspect ratio that fits into a window, in the middle of it. */
function fit(width: number, height: number, aspect: number): Box {
  const w = Math.min(width, height * aspect);
  return { left: (width - w) / 2, top: (height - w / aspect) / 2, width: w, height: w / aspect };
}

/** The window's size in CSS pixels; the server is told when it has settled. */
function useWindowSize(element: React.RefObject<HTMLElement | null>): [number, number] {
  const [size, setSize] = useState<[number, number]>([0, 0]);
  useEffect(() => {
    let timer = 0;
    const observer = new ResizeObserver(([entry]) => {
      if (!entry) return;
      const { width, height } = entry.contentRect;
      setSize([width, height]);
      window.clearTimeout(timer);
      timer = window.setTimeout(() => {
        const scale = Math.min(window.devicePixelRatio, LARGEST / Math.max(width, height, 1));
        show({ size: [Math.max(Math.round(width * scale), 16), Math.max(Math.round(height * scale), 16)] });
      }, 150);
    });
    if (element.current) observer.observe(element.current);
    return () => {
      observer.disconnect();
      window.clearTimeout(timer);
    };
  }, [element]);
  return size;
}

/** The full picture's aspect ratio. A preview's own is off by the rounding of its size to whole pixels. */
function useAspect(): number {
  const shown = useStore(picture, (state) => state.shown);
  const aspect = useRef(16 / 9);
  if (shown) {
    const own = shown.bitmap.width / shown.bitmap.height || aspect.current;
    if (shown.header.scale >= 1 || Math.abs(own / aspect.current - 1) > 0.03) aspect.current = own;
  }
  return aspect.current;
}

function Picture({ box }: { box: Box }) {
  const canvas = useRef<HTMLCanvasElement>(null);
  const { shown, other, snapshots } = useStore(picture, (state) => state);
  const page = pageOf(useStore(flipbook, (state) => state.at));
  const wipe = useStore(view, (state) => state.wipe);
  const wipeAt = useStore(view, (state) => state.wipeAt);
  const present = page?.bitmap ?? shown?.bitmap;
  const kept = snapshots.find((snapshot) => snapshot.id === wipe)?.bitmap ?? (page ? page.other : other?.bitmap);

  // Drawn before anything else can happen: a bitmap is freed as soon as the next one arrives.
  useLayoutEffect(() => {
    const context = canvas.current?.getContext("2d");
    if (!context || !present) return;
    const { width, height } = context.canvas;
    context.imageSmoothingEnabled = true;
    context.imageSmoothingQuality = "high";
    context.drawImage(present, 0, 0, width, height);
    if (!kept) return;
    context.save();
    context.beginPath();
    context.rect(0, 0, wipeAt * width, height);
    context.clip();
    context.drawImage(kept, 0, 0, width, height);
    context.restore();
  });

  const scale = window.devicePixelRatio;
  return (
    <canvas
      ref={canvas}
      className={styles.picture}
      width={Math.max(Math.round(box.width * scale), 1)}
      height={Math.max(Math.round(box.height * scale), 1)}
      style={box}
    />
  );
}

/** A rectangle, in fractions of the picture, as CSS percentages of it. */
function percent([x0, y0, x1, y1]: Area): React.CSSProperties {
  return {
    left: `${100 * x0}%`,
    top: `${100 * y0}%`,
    width: `${100 * (x1 - x0)}%`,
    height: `${100 * (y1 - y0)}%`,
  };
}

const CENTRE: Area = [0.25, 0.25, 0.75, 0.75];
const clamp = (x: number): number => Math.min(Math.max(x, 0), 1);

/** Move the rectangle of the area tool by arrow keys, or with Shift (`size`) its lower right corner. */
function moveArea([x0, y0, x1, y1]: Area, dx: number, dy: number, size: boolean): Area {
  if (size) return [x0, y0, Math.max(x0 + 0.02, clamp(x1 + dx)), Math.max(y0 + 0.02, clamp(y1 + dy))];
  const [x, y] = [Math.min(Math.max(x0 + dx, 0), 1 - x1 + x0), Math.min(Math.max(y0 + dy, 0), 1 - y1 + y0)];
  return [x, y, x + x1 - x0, y + y1 - y0];
}

const ARROWS: Record<string, [number, number]> = {
  ArrowLeft: [-1, 0],
  ArrowRight: [1, 0],
  ArrowUp: [0, -1],
  ArrowDown: [0, 1],
};

export function Viewport() {
  const element = useRef<HTMLDivElement>(null);
  const [width, height] = useWindowSize(element);
  const aspect = useAspect();
  const box = fit(width, height, aspect);
  const tool = useStore(view, (state) => state.tool);
  const at = useStore(view, (state) => state.at);
  const inspecting = useStore(view, (state) => state.tool === "inspect" || state.panel === "pixel");
  const other = useStore(session, (state) => state.show.other);
  const wiping = useStore(view, (state) => state.wipe !== null) || other !== null;
  const area = useStore(session, (state) => state.show.area);
  const [drawn, setDrawn] = useState<Area | null>(null);
  const begin = useRef<[number, number] | null>(null);

  const navigation = useDragNavigation(() => box.width);
  useWheel(element);
  useFlight(element);

  const fraction = (event: PointerEvent<HTMLElement>): [number, number] => {
    const bounds = event.currentTarget.getBoundingClientRect();
    return [
      clamp((event.clientX - bounds.left - box.left) / box.width),
      clamp((event.clientY - bounds.top - box.top) / box.height),
    ];
  };

  const onPointerDown = (event: PointerEvent<HTMLElement>): void => {
    // The middle button moves the camera whatever the tool.
    if (tool === "navigate" || event.button === 1) return navigation.onPointerDown(event);
    if (event.button !== 0) return;
    event.currentTarget.focus();
    event.currentTarget.setPointerCapture(event.pointerId);
    begin.current = fraction(event);
    if (tool === "inspect") inspectAt(begin.current);
  };
  const onPointerMove = (event: PointerEvent<HTMLElement>): void => {
    navigation.onPointerMove(event);
    if (!begin.current || tool !== "area") return;
    const [x0, y0] = begin.current;
    const [x1, y1] = fraction(event);
    setDrawn([Math.min(x0, x1), Math.min(y0, y1), Math.max(x0, x1), Math.max(y0, y1)]);
  };
  const onPointerUp = (): void => {
    navigation.onPointerUp();
    begin.current = null;
    // A click without a drag is no rectangle.
    if (drawn && drawn[2] - drawn[0] > 0.005 && drawn[3] - drawn[1] > 0.005) show({ area: drawn });
    setDrawn(null);
  };
  const onPointerCancel = (): void => {
    navigation.onPointerCancel();
    begin.current = null;
    setDrawn(null);
  };

  const onKeyDown = (event: KeyboardEvent<HTMLElement>): void => {
    if (event.target !== event.currentTarget) return;
    if (event.key === "Escape") {
      setDrawn(null);
      begin.current = null;
      view.set({ tool: "navigate" });
      return;
    }
    const arrow = ARROWS[event.key];
    const step = event.altKey ? 0.002 : 0.02;
    if (tool === "area" && (arrow || event.key === "Enter")) {
      event.preventDefault();
      const [dx, dy] = arrow ?? [0, 0];
      show({ area: area && arrow ? moveArea(area, dx * step, dy * step, event.shiftKey) : (area ?? CENTRE) });
    } else if (tool === "inspect" && arrow) {
      event.preventDefault();
      view.set({ at: [clamp(at[0] + arrow[0] * step), clamp(at[1] + arrow[1] * step)] });
    } else if (tool === "inspect" && event.key === "Enter") {
      event.preventDefault();
      inspectAt(at);
    }
  };

  const rectangle = drawn ?? area;
  return (
    <section className={styles.column} aria-label="Viewport">
      <div className={styles.window}>
        {/* The role is application since the picture has keys of its own, and no structure that could be read. */}
        <div
          ref={element}
          className={styles.input}
          data-tool={tool}
          role="application"
          aria-label="Picture. W A S D Q E fly, arrow keys turn, question mark for all keys."
          tabIndex={0}
          onPointerDown={onPointerDown}
          onPointerMove={onPointerMove}
          onPointerUp={onPointerUp}
          onPointerCancel={onPointerCancel}
          onKeyDown={onKeyDown}
          onContextMenu={(event) => event.preventDefault()}
        >
          <Picture box={box} />
          <div className={styles.overlay} style={box}>
            {rectangle && <div className={styles.area} style={percent(rectangle)} />}
            {inspecting && (
              <div className={styles.crosshair} style={{ left: `${100 * at[0]}%`, top: `${100 * at[1]}%` }} />
            )}
          </div>
        </div>
        {wiping && <WipeLine box={box} />}
        <Problem />
      </div>
      <StatusLine />
    </section>
  );
}
