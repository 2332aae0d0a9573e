/** Notices: a lost connection, restored edits, a file that another program changed, and edits that were refused. */

import { ActionIcon, Button } from "@mantine/core";
import { useEffect, useState } from "react";
import { CloseIcon, WarningIcon } from "../common/icons";
import { command, connect, dismissChanged, dismissRefused, save, session } from "../session/session";
import { useStore } from "../session/store";
import styles from "./keep.module.css";

/** Seconds until the next try. Not read aloud: it would be a new alert each second. */
function Countdown({ until }: { until: number | null }) {
  const [now, setNow] = useState(Date.now());
  useEffect(() => {
    const timer = window.setInterval(() => setNow(Date.now()), 500);
    return () => window.clearInterval(timer);
  }, []);
  const seconds = until === null ? 0 : Math.max(Math.ceil((until - now) / 1000), 0);
  return <span aria-hidden>{seconds > 0 ? `Next try in ${seconds} s.` : "Trying…"}</span>;
}

/** Milliseconds without a connection, such as at the start, before there is a banner. */
const UNNOTICED = 700;

function useLost(): boolean {
  const open = useStore(session, (state) => state.open);
  const [lost, setLost] = useState(false);
  useEffect(() => {
    const timer = window.setTimeout(() => setLost(!open), open ? 0 : UNNOTICED);
    return () => window.clearTimeout(timer);
  }, [open]);
  return lost;
}

/** Edits that an earlier studio did not save were restored: they can be kept or discarded. */
function Restored() {
  const restored = useStore(session, (state) => state.restored);
  const [dismissed, setDismissed] = useState(false);
  return (
    <div role="status">
      {restored && !dismissed && (
        <div className={styles.notice} data-kind="news">
          <span>The studio ended before all edits were saved. They were restored, but are still not saved.</span>
          <Button size="compact-xs" variant="white" color="dark" onClick={() => command("discard")}>
            Back to what was saved
          </Button>
          <ActionIcon
            size="sm"
            variant="transparent"
            color="white"
            aria-label="Keep the restored edits"
            title="Keep them"
            onClick={() => setDismissed(true)}
          >
            <CloseIcon />
          </ActionIcon>
        </div>
      )}
    </div>
  );
}

/** Another program has changed the file of the edits: they can be merged, or saved in a copy. */
function ChangedElsewhere() {
  const changed = useStore(session, (state) => state.changed);
  if (changed === null) return null;
  return (
    <div role="alert" className={styles.notice}>
      <WarningIcon />
      <span>
        {changed.copy === null
          ? `Not saved: another program has changed ${changed.file}. Merge keeps its changes and yours; where both changed a value, yours.`
          : `Another program has changed ${changed.file}. Your edits are saved in ${changed.copy}, and Save goes on there.`}
      </span>
      {changed.copy === null && (
        <>
          <Button size="compact-xs" variant="white" color="dark" onClick={() => save("merge")}>
            Merge
          </Button>
          <Button size="compact-xs" variant="white" color="dark" onClick={() => save("copy")}>
            Save a copy
          </Button>
        </>
      )}
      <ActionIcon size="sm" variant="transparent" color="white" aria-label="Dismiss" onClick={dismissChanged}>
        <CloseIcon />
      </ActionIcon>
    </div>
  );
}

export function Notices() {
  const lost = useLost();
  const retryAt = useStore(session, (state) => state.retryAt);
  const everOpen = useStore(session, (state) => state.everOpen);
  const refused = useStore(session, (state) => state.refused);
  return (
    <>
      {lost && (
        <div role="alert" className={styles.notice}>
          <WarningIcon />
          <span>
            {everOpen
              ? "The connection to the studio is lost. The page reconnects by itself; edits wait until then."
              : "The studio does not answer. If this continues, open the address that it printed, with its token."}
          </span>
          <Countdown until={retryAt} />
          <Button size="compact-xs" variant="white" color="dark" onClick={connect}>
            Try now
          </Button>
        </div>
      )}
      <Restored />
      <ChangedElsewhere />
      {refused.map((text) => (
        <div role="alert" className={styles.notice} key={text}>
          <WarningIcon />
          <span>{text}</span>
          <ActionIcon
            size="sm"
            variant="transparent"
            color="white"
            aria-label="Dismiss"
            onClick={() => dismissRefused(text)}
          >
            <CloseIcon />
          </ActionIcon>
        </div>
      ))}
    </>
  );
}
