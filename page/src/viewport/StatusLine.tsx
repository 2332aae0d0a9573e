/** The progress of the picture, and the problem of the scene if it has one. */

import { ActionIcon, Button, Loader } from "@mantine/core";
import { useEffect, useState } from "react";
import { CameraIcon, CloseIcon, PauseIcon, PlayIcon, WarningIcon } from "../common/icons";
import { picture, session, show } from "../session/session";
import { useStore } from "../session/store";
import { throughTheCamera } from "./view";
import styles from "./viewport.module.css";

export function Problem() {
  const problem = useStore(session, (state) => state.state?.problem ?? null);
  return (
    <div role="status" className={styles.problemPlace}>
      {problem && (
        <p className={styles.problem}>
          <WarningIcon /> {problem.text}
        </p>
      )}
    </div>
  );
}

/** The seconds since the present version of the picture was begun; the clock stops when the picture is done. */
function Clock({ version, running }: { version: number; running: boolean }) {
  const [seconds, setSeconds] = useState(0);
  useEffect(() => setSeconds(0), [version]);
  useEffect(() => {
    if (!running) return;
    const before = performance.now() - 1000 * seconds;
    const timer = window.setInterval(() => setSeconds((performance.now() - before) / 1000), 100);
    return () => window.clearInterval(timer);
    // The seconds so far count only when the clock goes on.
    // eslint-disable-next-line react-hooks/exhaustive-deps
  }, [version, running]);
  return (
    <span role="timer" aria-label="Seconds since the last edit">
      {seconds.toFixed(1)} s
    </span>
  );
}

/** What is shown only for now, each with the button that ends it: a free view, an area, lights alone. */
function Temporary() {
  const { pose, area, solo } = useStore(session, (state) => state.show);
  return (
    <>
      {pose && (
        <Button
          size="compact-xs"
          leftSection={<CameraIcon />}
          title="Leave the free view and look through the shot's camera"
          onClick={throughTheCamera}
        >
          Through the camera
        </Button>
      )}
      {area && (
        <Button size="compact-xs" variant="light" leftSection={<CloseIcon />} onClick={() => show({ area: null })}>
          Clear area
        </Button>
      )}
      {solo.length > 0 && (
        <Button
          size="compact-xs"
          variant="light"
          color="yellow"
          rightSection={<CloseIcon />}
          title="Show all lights again"
          onClick={() => show({ solo: [] })}
        >
          Solo: {solo.length} {solo.length === 1 ? "light" : "lights"}
        </Button>
      )}
    </>
  );
}

export function StatusLine() {
  const state = useStore(session, (all) => all.state);
  const paused = useStore(session, (all) => all.show.paused);
  const shown = useStore(picture, (all) => all.shown);
  const busy = (state?.busy ?? false) && !paused;
  const label = paused ? "Continue rendering" : "Pause rendering";
  return (
    <div className={styles.status}>
      <ActionIcon
        size="sm"
        variant="subtle"
        color="gray"
        aria-label={label}
        title={label}
        onClick={() => show({ paused: !paused })}
      >
        {paused ? <PlayIcon /> : <PauseIcon />}
      </ActionIcon>
      <span className={styles.loader}>{busy && <Loader size={12} aria-hidden />}</span>
      {state ? (
        <>
          <span>
            {state.passes} of {state.planned} passes
          </span>
          <Clock version={state.version} running={busy && !state.problem} />
          <span>{paused ? "paused" : state.problem ? "stopped" : busy ? "rendering" : "done"}</span>
        </>
      ) : (
        <span>waiting for the first picture</span>
      )}
      <span className={styles.filler} />
      <Temporary />
      {shown && (
        <span>
          {shown.header.layer}
          {shown.header.scale < 1 ? ", preview" : ""}, {shown.bitmap.width} × {shown.bitmap.height}
        </span>
      )}
    </div>
  );
}
