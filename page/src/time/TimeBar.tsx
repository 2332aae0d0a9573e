/** The shot's frames: scrub, step, play. */

import { ActionIcon, Button, Slider } from "@mantine/core";
import { useEffect, useState } from "react";
import { PauseIcon, PlayIcon } from "../common/icons";
import { NumberField } from "../common/NumberField";
import { picture, session, show } from "../session/session";
import { Store, useStore } from "../session/store";
import { flipbook, toggleFlipbook } from "./flipbook";
import styles from "./time.module.css";

export const playback = new Store<{ playing: boolean }>({ playing: false });

/** While playing, ask for the next frame when a picture of the last one has come, and no faster than the shot runs. */
function usePlayback(frames: [number, number], fps: number): void {
  const playing = useStore(playback, (state) => state.playing);
  const collecting = useStore(flipbook, (state) => state.on);
  useEffect(() => {
    if (!playing) return;
    const [first, last] = frames;
    if (flipbook.get().on) return playPages(fps);
    let timer = 0;
    // A picture that was already on its way has a version that was known when the frame was asked for.
    let known = -1;
    let due = 0;

    const next = (): void => {
      const { show: shown, state } = session.get();
      known = Math.max(state?.version ?? -1, picture.get().shown?.header.version ?? -1);
      due = performance.now() + 1000 / (fps || 24);
      show({ frame: shown.frame >= last ? first : shown.frame + 1 });
    };
    const stop = picture.subscribe(() => {
      if ((picture.get().shown?.header.version ?? -1) <= known) return;
      known = Infinity;
      timer = window.setTimeout(next, Math.max(due - performance.now(), 0));
    });
    next();
    return () => {
      stop();
      window.clearTimeout(timer);
    };
  }, [playing, collecting, frames, fps]);
}

/** Play the pages of the flipbook in a loop, at the speed of the shot; returns what ends this. */
function playPages(fps: number): () => void {
  const begin = performance.now();
  const timer = window.setInterval(() => {
    const { frames } = flipbook.get();
    const number = Math.floor(((performance.now() - begin) / 1000) * (fps || 24)) % Math.max(frames.length, 1);
    flipbook.set({ at: frames[number] ?? null });
  }, 1000 / (fps || 24));
  return () => {
    window.clearInterval(timer);
    flipbook.set({ at: null });
  };
}

/** Which frames of the shot the flipbook has, as a line over the slider. */
function Collected({ frames }: { frames: [number, number] }) {
  const collected = useStore(flipbook, (state) => state.frames);
  const [first, last] = frames;
  return (
    <span className={styles.collected} aria-hidden>
      {collected.map((frame) => (
        <span key={frame} style={{ left: `${(100 * (frame - first)) / (last - first + 1)}%`, width: `${100 / (last - first + 1)}%` }} />
      ))}
    </span>
  );
}

function FrameControls({ frames, fps }: { frames: [number, number]; fps: number }) {
  const live = useStore(session, (state) => state.show.frame);
  const { on, frames: collected, at } = useStore(flipbook, (state) => state);
  const frame = at ?? live;
  const playing = useStore(playback, (state) => state.playing);
  const [scrubbing, setScrubbing] = useState(false);
  usePlayback(frames, fps);
  const [first, last] = frames;
  return (
    <div className={styles.bar} role="group" aria-label="Time">
      <ActionIcon
        size="sm"
        variant="default"
        aria-label={playing ? "Pause" : "Play"}
        title={playing ? "Pause" : "Play"}
        onClick={() => playback.set({ playing: !playing })}
      >
        {playing ? <PauseIcon /> : <PlayIcon />}
      </ActionIcon>
      <span className={styles.end}>{first}</span>
      <span className={styles.slider}>
        {on && <Collected frames={frames} />}
        <Slider
        size="sm"
        min={first}
        max={last}
        step={1}
        label={scrubbing ? (value) => value : null}
        thumbLabel="Frame"
        value={frame}
        onChange={(value) => {
          setScrubbing(true);
          playback.set({ playing: false });
          show({ frame: value });
        }}
        onChangeEnd={() => setScrubbing(false)}
        />
      </span>
      <span className={styles.end}>{last}</span>
      <NumberField
        className={styles.number}
        label="Frame, exact"
        integer
        min={first}
        max={last}
        value={frame}
        onChange={(value) => show({ frame: value })}
      />
      <span className={styles.end}>{fps} fps</span>
      <Button
        size="compact-xs"
        variant={on ? "filled" : "default"}
        aria-pressed={on}
        title="Collect a small picture of each frame; Play then shows them at the speed of the shot"
        onClick={() => {
          playback.set({ playing: false });
          toggleFlipbook();
        }}
      >
        Flipbook{on && ` ${collected.length}/${last - first + 1}`}
      </Button>
    </div>
  );
}

export function TimeBar() {
  const frames = useStore(session, (state) => state.scene?.frames ?? null);
  const fps = useStore(session, (state) => state.scene?.fps ?? 24);
  return frames && <FrameControls frames={frames} fps={fps} />;
}
