/** The progress of the picture, and the problem of the scene if it has one. */

import { ActionIcon, Loader } from "@mantine/core";
import { PauseIcon, PlayIcon, WarningIcon } from "../common/icons";
import { picture, session, show } from "../session/session";
import { useStore } from "../session/store";
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
          <span>{state.seconds.toFixed(1)} s</span>
          <span>{paused ? "paused" : state.problem ? "stopped" : busy ? "rendering" : "done"}</span>
        </>
      ) : (
        <span>waiting for the first picture</span>
      )}
      <span className={styles.filler} />
      {shown && (
        <span>
          {shown.header.layer}
          {shown.header.scale < 1 ? ", preview" : ""}, {shown.bitmap.width} × {shown.bitmap.height}
        </span>
      )}
    </div>
  );
}
